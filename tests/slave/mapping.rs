//! Process data of a slave as a master maps them: the rules of the mapping objects, and images that carry exactly the
//! mapped objects.

use ecmsk::cia402::{Controlword, DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::ethercat::AlState;
use ecmsk::slave::process_data::{ENTRIES_MAX, IMAGE_BYTES_MAX, MAPPED_MAX, PDOS_MAX};
use ecmsk::slave::{AlStatus, Channels, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use proptest::prelude::*;

use AlState::*;

use crate::wired::in_preop;

const RX: u16 = 0x1C12;
const TX: u16 = 0x1C13;

fn drive() -> Drive {
    in_preop(Drive::new(DriveConfig::default()))
}

fn write(slave: &mut impl Slave, index: u16, sub: u8, value: u32) -> Result<(), AbortCode> {
    let size = match (index, sub) {
        (_, 0) => SdoSize::One,
        (RX | TX, _) => SdoSize::Two,
        _ => SdoSize::Four,
    };
    slave.download(ObjectAddress::new(index, sub), size, value)
}

fn read(slave: &mut impl Slave, index: u16, sub: u8) -> u32 {
    slave.upload(ObjectAddress::new(index, sub)).expect("it can be read").bits
}

/// A list in the usual order: count 0, items, count.
fn list(slave: &mut impl Slave, index: u16, items: &[u32]) -> Result<(), AbortCode> {
    write(slave, index, 0, 0)?;
    for (sub, item) in (1..).zip(items) {
        write(slave, index, sub, *item)?;
    }
    write(slave, index, 0, items.len() as u32)
}

/// Maps exactly these objects; returns the lengths of the images in bytes.
fn map(slave: &mut impl Slave, outputs: &[u32], inputs: &[u32]) -> (usize, usize) {
    for (assignment, pdo, entries) in [(RX, 0x1600, outputs), (TX, 0x1A00, inputs)] {
        list(slave, pdo, entries).expect("they may be mapped");
        list(slave, assignment, &[pdo.into()]).expect("it has the PDO");
    }
    let bytes = |entries: &[u32]| entries.iter().map(|entry| entry & 0xFF).sum::<u32>().div_ceil(8) as usize;
    let lengths = (bytes(outputs), bytes(inputs));
    slave.set_sync_managers(lengths.0 as u16, lengths.1 as u16);
    lengths
}

fn to_op(slave: &mut impl Slave) {
    slave.enter(SafeOp).expect("the mapping is good");
    slave.enter(Op).expect("SafeOP is behind it");
}

/// SK-7.49 Count 0, items, count: an item is refused while the count is not 0, and everything outside PreOP.
#[test]
fn lists_are_written_in_the_usual_order() {
    let mut drive = drive();
    for index in [0x1600, 0x1A00, RX, TX] {
        let item = read(&mut drive, index, 1);
        assert_eq!(write(&mut drive, index, 1, item).map_err(|code| code.0), Err(0x0601_0003), "{index:04X}");
    }
    list(&mut drive, 0x1600, &[0x6040_0010, 0x60FF_0020]).unwrap();
    assert_eq!([0, 1, 2, 3].map(|sub| read(&mut drive, 0x1600, sub)), [2, 0x6040_0010, 0x60FF_0020, 0]);
    let most = |index| if matches!(index, RX | TX) { PDOS_MAX } else { ENTRIES_MAX };
    for index in [0x1600, RX] {
        let beyond = most(index) as u8 + 1;
        assert_eq!(write(&mut drive, index, 0, beyond.into()).map_err(|code| code.0), Err(0x0609_0031), "{index:04X}");
        assert_eq!(write(&mut drive, index, beyond, 0).map_err(|code| code.0), Err(0x0609_0011), "{index:04X}");
    }
    for (at, size, code) in [
        ((0x1600, 0), SdoSize::Two, 0x0607_0012),
        ((0x1600, 1), SdoSize::Two, 0x0607_0013),
        ((RX, 1), SdoSize::Four, 0x0607_0012),
    ] {
        let refused = drive.download(ObjectAddress::new(at.0, at.1), size, 0).map_err(|code| code.0);
        assert_eq!(refused, Err(code), "{at:04X?}");
    }
    assert_eq!(write(&mut drive, 0x1608, 0, 0).map_err(|code| code.0), Err(0x0602_0000), "it has no such PDO");
    map(&mut drive, &[0x6040_0010], &[0x6041_0010]);
    drive.enter(SafeOp).unwrap();
    for (index, sub) in [(0x1600, 0), (0x1A00, 0), (RX, 0), (TX, 0)] {
        assert_eq!(write(&mut drive, index, sub, 0).map_err(|code| code.0), Err(0x0800_0022), "{index:04X} in SafeOP");
    }
    drive.enter(Init).unwrap();
    assert_eq!(write(&mut drive, 0x1600, 0, 0), Err(AbortCode::TIMEOUT), "no mailbox");
}

/// SK-7.50 An invalid entry is refused when it is written, an incomplete PDO when its count is written.
#[test]
fn only_what_may_be_mapped_is() {
    let mut drive = drive();
    for index in [0x1600, 0x1A00, RX, TX] {
        write(&mut drive, index, 0, 0).unwrap();
    }
    for (pdo, entry, code, why) in [
        (0x1600, 0x6041_0010, 0x0604_0041, "an input among the outputs"),
        (0x1A00, 0x6040_0010, 0x0604_0041, "an output among the inputs"),
        (0x1600, 0x607C_0020, 0x0604_0041, "no process data"),
        (0x1600, 0x1600_0108, 0x0604_0041, "a mapping object"),
        (0x1600, 0x6040_0020, 0x0604_0041, "too long"),
        (0x1600, 0x607A_0010, 0x0604_0041, "too short"),
        (0x1600, 0x6040_0000, 0x0604_0041, "no bits"),
        (0x1600, 0x0000_0110, 0x0602_0000, "padding has no sub-index"),
        (0x1600, 0x5FFF_0010, 0x0602_0000, "no object"),
        (0x1600, 0x6040_0110, 0x0609_0011, "no sub-index"),
        (RX, 0x1A00, 0x0604_0041, "a TxPDO among the RxPDOs"),
        (TX, 0x1600, 0x0604_0041, "an RxPDO among the TxPDOs"),
        (RX, 0x1608, 0x0604_0041, "no PDO of this drive"),
        (RX, 0x1C12, 0x0604_0041, "no PDO at all"),
    ] {
        assert_eq!(write(&mut drive, pdo, 1, entry).map_err(|code| code.0), Err(code), "{why}: {entry:08X}");
    }
    assert_eq!(write(&mut drive, 0x1600, 1, 0x6040_0010), Ok(()));
    assert_eq!(write(&mut drive, 0x1600, 2, 0), Ok(()), "nothing");
    assert_eq!(write(&mut drive, 0x1600, 0, 2).map_err(|code| code.0), Err(0x0604_0041), "nothing cannot be counted");
    let long = [0x0000_00FF; 3];
    assert_eq!(list(&mut drive, 0x1600, &long).map_err(|code| code.0), Err(0x0604_0042), "765 bits of padding");
    assert_eq!(IMAGE_BYTES_MAX, 64, "512 bits");
    assert_eq!(list(&mut drive, RX, &[0x1600, 0x1600]).map_err(|code| code.0), Err(0x0604_0043), "assigned twice");
}

/// SK-7.51 The image has the entries one behind the other, the lowest bit first, with no gap but padding.
#[test]
fn an_image_is_packed() {
    let mut drive = drive();
    let outputs = [0x6098_0008, 0x0000_0004, 0x6072_0010, 0x6065_0020];
    let inputs = [0x0000_0003, 0x6061_0008, 0x6041_0010];
    assert_eq!(map(&mut drive, &outputs, &inputs), (8, 4));
    to_op(&mut drive);
    let mut image = [0xFF; 5];
    drive.exchange(Some(&[0x21, 0x4F, 0x23, 0x81, 0x67, 0x45, 0x23, 0xF1]), &mut image);
    assert_eq!(read(&mut drive, 0x6098, 0), 0x21);
    assert_eq!(read(&mut drive, 0x6072, 0), 0x1234, "behind 4 bits of padding");
    assert_eq!(read(&mut drive, 0x6065, 0), 0x1234_5678, "its last 4 bits are no object's");
    let Statusword(word) = drive.axis().measured().statusword;
    let expected = u32::from(word) << 11 | 8 << 3;
    assert_eq!(image, [expected as u8, (expected >> 8) as u8, (expected >> 16) as u8, (expected >> 24) as u8, 0xFF]);
}

/// SK-7.51 Unmapped objects keep what SDOs wrote.
#[test]
fn a_controlword_by_sdo_is_in_force() {
    let mut drive = drive();
    map(&mut drive, &[0x607A_0020], &[0x6041_0010, 0x6064_0020]);
    to_op(&mut drive);
    let mut image = [0; 6];
    let mut last = DriveState::NotReadyToSwitchOn;
    for word in [Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION] {
        drive.download(ObjectAddress::new(0x6040, 0), SdoSize::Two, word.0.into()).unwrap();
        for _ in 0..300 {
            drive.exchange(Some(&500_i32.to_le_bytes()), &mut image);
            drive.step(1_000_000);
        }
        last = Statusword(u16::from_le_bytes([image[0], image[1]])).state().expect("a state");
    }
    assert_eq!(last, DriveState::OperationEnabled);
    assert_eq!(i32::from_le_bytes(image[2..].try_into().unwrap()), 500, "it followed the target that is mapped");
}

/// SK-7.51 A mapping that is too much, or that the sync managers do not fit, is refused on the way to SafeOP.
#[test]
fn a_bad_mapping_is_refused() {
    let refused = |outputs: &[u32], inputs: &[u32], lengths: Option<(u16, u16)>| {
        let mut drive = drive();
        map(&mut drive, outputs, inputs);
        if let Some((outputs, inputs)) = lengths {
            drive.set_sync_managers(outputs, inputs);
        }
        let entered = drive.enter(SafeOp);
        assert_eq!(drive.state(), if entered.is_ok() { SafeOp } else { PreOp });
        entered
    };
    let (out, input) = (&[0x6040_0010][..], &[0x6041_0010][..]);
    assert_eq!(refused(out, input, None), Ok(()));
    for lengths in [(0, 2), (1, 2), (3, 2), (0, 0)] {
        assert_eq!(refused(out, input, Some(lengths)), Err(AlStatus(0x001D)), "{lengths:?}");
    }
    for lengths in [(2, 0), (2, 1), (2, 4)] {
        assert_eq!(refused(out, input, Some(lengths)), Err(AlStatus(0x001E)), "{lengths:?}");
    }
    // Each PDO is short enough, all of them together are not.
    let pdos = [0x1600, 0x1601, 0x1602];
    let mut drive_of_96_bytes = drive();
    for pdo in pdos {
        list(&mut drive_of_96_bytes, pdo, &[0x6072_0010, 0x0000_00F0]).unwrap();
    }
    list(&mut drive_of_96_bytes, RX, &pdos.map(u32::from)).unwrap();
    drive_of_96_bytes.set_sync_managers(96, 10);
    assert_eq!(drive_of_96_bytes.enter(SafeOp), Err(AlStatus(0x0025)), "96 bytes of outputs");
    let mut hsp = in_preop(Hsp::new(HspConfig::with(Channels::Two)));
    for pdo in [0x1A00, 0x1A10] {
        list(&mut hsp, pdo, &[0x6064_0020; ENTRIES_MAX]).unwrap();
    }
    hsp.set_sync_managers(20, 96);
    assert_eq!(hsp.enter(SafeOp), Err(AlStatus(0x0024)), "96 bytes of inputs");
    let mut drive_of_36_objects = drive();
    for pdo in pdos {
        list(&mut drive_of_36_objects, pdo, &[0x6098_0008; ENTRIES_MAX]).unwrap();
    }
    list(&mut drive_of_36_objects, RX, &pdos.map(u32::from)).unwrap();
    drive_of_36_objects.set_sync_managers(36, 10);
    assert_eq!((drive_of_36_objects.enter(SafeOp), MAPPED_MAX), (Err(AlStatus(0x0025)), 32), "36 objects");
}

/// SK-7.51 A direction without a PDO has no image, and a slave without outputs misses none.
#[test]
fn a_direction_may_be_empty() {
    let mut drive = drive();
    list(&mut drive, RX, &[]).unwrap();
    drive.set_sync_managers(0, 10);
    to_op(&mut drive);
    for _ in 0..1000 {
        drive.step(1_000_000);
    }
    assert_eq!(drive.state(), Op, "no watchdog of outputs that there are not");
    let mut image = [0xA5; 12];
    drive.exchange(Some(&[]), &mut image);
    assert_eq!((&image[..2], &image[10..]), (&0x0250_u16.to_le_bytes()[..], &[0xA5; 2][..]), "10 bytes and no more");
}

/// SK-7.52 A slave accepts the mapping that it shows at power-on.
#[test]
fn what_is_mapped_at_power_on_is_good() {
    fn goes(mut slave: impl Slave, lengths: (u16, u16)) {
        slave.enter(PreOp).unwrap();
        assert_eq!(slave.enter(SafeOp), Err(AlStatus(0x001D)), "no sync managers");
        assert_eq!([0, 1, 2, 3, 4].map(|sub| read(&mut slave, 0x1C00, sub)), [4, 1, 2, 3, 4]);
        slave.set_sync_managers(lengths.0, lengths.1);
        to_op(&mut slave);
    }
    goes(Drive::new(DriveConfig::default()), (6, 10));
    goes(Drive::new(DriveConfig::stepper()), (6, 10));
    goes(Hsp::default(), (10, 10));
    goes(Hsp::new(HspConfig::with(Channels::Two)), (20, 20));
    goes(Io::default(), (2, 2));
}

/// SK-7.53 Complete access: all sub-indices in one transfer, sub-index 0 with a byte of padding behind it.
#[test]
fn complete_access() {
    let mut drive = drive();
    let mut complete = |index, sub, room: usize| {
        let mut value = vec![0xEE; room];
        let len = drive.read(ObjectAddress::new(index, sub), SdoScope::Complete, &mut value)?;
        Ok::<_, AbortCode>((len, value))
    };
    assert_eq!(complete(0x1600, 0, 10), Ok((10, vec![2, 0, 0x10, 0, 0x40, 0x60, 0x20, 0, 0x7A, 0x60])));
    assert_eq!(complete(0x1600, 1, 4), Ok((8, vec![0x10, 0, 0x40, 0x60])), "as much as there is room for");
    assert_eq!(complete(RX, 0, 4), Ok((4, vec![1, 0, 0x00, 0x16])));
    assert_eq!(complete(0x1C00, 0, 6), Ok((6, vec![4, 0, 1, 2, 3, 4])));
    assert_eq!(complete(0x6041, 0, 2).map(|(len, _)| len), Ok(2), "one that has no more");
    let (len, limits) = complete(0x607D, 0, 10).unwrap();
    assert_eq!((len, &limits[..6]), (10, &[2, 0, 0, 0, 0, 0x80][..]));
    for (index, sub, code) in [
        (0x1600, 2, 0x0601_0000),
        (0x607D, 2, 0x0601_0000),
        (0x1008, 0, 0x0601_0004),
        (0x5FFF, 0, 0x0602_0000),
        (0x6041, 1, 0x0609_0011),
    ] {
        assert_eq!(complete(index, sub, 8).map_err(|code| code.0), Err(code), "{index:04X}:{sub}");
    }
    let mut write = |index, sub, value: &[u8]| {
        drive.write(ObjectAddress::new(index, sub), SdoScope::Complete, value).map_err(|code| code.0)
    };
    assert_eq!(write(0x1600, 0, &[2, 0, 0x10, 0, 0x40, 0x60, 0x20, 0, 0xFF, 0x60]), Ok(()));
    assert_eq!(write(0x1600, 0, &[1, 0, 0x10, 0, 0x41, 0x60]), Err(0x0604_0041), "an input");
    assert_eq!(write(0x1600, 0, &[2, 0, 0x10, 0, 0x40, 0x60]), Err(0x0607_0010), "an entry is missing");
    assert_eq!(write(0x1600, 0, &[1]), Err(0x0607_0010));
    assert_eq!(write(0x1600, 1, &[0x10, 0, 0x40, 0x60]), Err(0x0601_0000));
    assert_eq!(
        write(0x607D, 0, &[2, 0, 1, 0, 0, 0, 2, 0, 0, 0]),
        Ok(()),
        "the count can only be read, and is left out"
    );
    assert_eq!(write(0x607D, 1, &[5, 0, 0, 0]), Ok(()), "the first one alone");
    assert_eq!(write(0x607D, 1, &[5, 0, 0]), Err(0x0607_0010));
    assert_eq!(write(0x607D, 1, &[5, 0, 0, 0, 6, 0, 0, 0, 7]), Err(0x0607_0010));
    assert_eq!(read(&mut drive, 0x1600, 2), 0x60FF_0020);
    assert_eq!([1, 2].map(|sub| read(&mut drive, 0x607D, sub)), [5, 2]);
}

/// SK-7.53 A text comes whole; the board shows its first 4 bytes (SK-6.11).
#[test]
fn a_text_comes_whole() {
    let mut drive = drive();
    let mut name = [0; 64];
    let len = drive.read(ObjectAddress::new(0x1008, 0), SdoScope::Entry, &mut name).unwrap();
    assert_eq!(&name[..len], b"SRVO simulated servo drive");
    assert_eq!(
        drive.upload(ObjectAddress::new(0x1008, 0)).map(|value| (value.size, value.bits.to_le_bytes())),
        Ok((4, *b"SRVO"))
    );
}

/// Objects of a drive that may be mapped into an RxPDO, and that an SDO reads back unchanged for every value.
const OUTPUTS: [u32; 9] = [
    0x6040_0010,
    0x6065_0020,
    0x6066_0010,
    0x6071_0010,
    0x6072_0010,
    0x607F_0020,
    0x6098_0008,
    0x6099_0120,
    0x60FF_0020,
];
/// Objects that may be mapped into a TxPDO.
const INPUTS: [u32; 8] =
    [0x603F_0010, 0x6041_0010, 0x6061_0008, 0x6062_0020, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x60FD_0020];

fn entries(of: &'static [u32]) -> impl Strategy<Value = Vec<u32>> {
    let padding = (1..=40_u32).boxed();
    let entry = prop_oneof![4 => prop::sample::select(of).boxed(), 1 => padding];
    prop::collection::vec(entry, 0..=ENTRIES_MAX)
}

/// The bits of an entry in an image.
fn bits(image: &[u8], from: usize, bits: u32) -> u64 {
    (0..bits as usize).map(|n| u64::from(image[(from + n) / 8] >> ((from + n) % 8) & 1) << n).sum()
}

/// An SDO download to a mapping object, good or bad.
fn mapping_write() -> impl Strategy<Value = (u16, u8, Vec<u8>, bool)> {
    let index = prop::sample::select(vec![0x1600, 0x1601, 0x1602, 0x1A00, RX, TX, 0x1603, 0x1C00]);
    let item = prop_oneof![
        prop::sample::select(&OUTPUTS[..]),
        prop::sample::select(&INPUTS[..]),
        prop::sample::select(&[0, 1, 2, 3, 4, 12, 13, 255, 0x1600, 0x1601, 0x1A00, 0x0000_0008, 0x0000_00FF][..]),
        any::<u32>(),
    ];
    let value = prop_oneof![
        item.clone().prop_map(|item| item.to_le_bytes().to_vec()),
        item.clone().prop_map(|item| item.to_le_bytes()[..2].to_vec()),
        item.prop_map(|item| item.to_le_bytes()[..1].to_vec()),
        prop::collection::vec(any::<u8>(), 0..20),
    ];
    (index, 0..15_u8, value, prop::bool::weighted(0.1))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// SK-7.51 Every accepted mapping moves exactly the mapped objects: each object takes its bits of the outputs, and
    /// shows its bits among the inputs; padding is 0.
    #[test]
    fn what_is_mapped_moves(
        outputs in entries(&OUTPUTS),
        inputs in entries(&INPUTS),
        image in prop::collection::vec(any::<u8>(), 64),
    ) {
        let mut drive = drive();
        let (sent_bytes, answer_bytes) = map(&mut drive, &outputs, &inputs);
        to_op(&mut drive);
        let mut answer = [0xA5; 80];
        drive.exchange(Some(&image[..sent_bytes]), &mut answer);
        let (mut at, mut mapped) = (0, Vec::new());
        for entry in &outputs {
            mapped.push((*entry, bits(&image, at, entry & 0xFF)));
            at += (entry & 0xFF) as usize;
        }
        for (n, (entry, value)) in mapped.iter().enumerate() {
            let is_last = !mapped[n + 1..].iter().any(|(other, _)| other == entry);
            if entry >> 16 != 0 && is_last {
                prop_assert_eq!(u64::from(read(&mut drive, (entry >> 16) as u16, (entry >> 8) as u8)), *value);
            }
        }
        let mut at = 0;
        for entry in &inputs {
            let shown = if entry >> 16 == 0 { 0 } else { read(&mut drive, (entry >> 16) as u16, (entry >> 8) as u8) };
            prop_assert_eq!(bits(&answer, at, entry & 0xFF), u64::from(shown));
            at += (entry & 0xFF) as usize;
        }
        prop_assert!(answer[answer_bytes..].iter().all(|byte| *byte == 0xA5), "and no byte behind them");
    }

    /// SK-7.49 SK-7.50 Whatever is written to the mapping objects nothing panics; the resulting mapping is either
    /// refused at SafeOP or moved.
    #[test]
    fn any_writes(writes in prop::collection::vec(mapping_write(), 0..60), lengths in (0..70_u16, 0..70_u16)) {
        let mut drive = drive();
        for (index, sub, value, complete) in writes {
            let scope = if complete { SdoScope::Complete } else { SdoScope::Entry };
            let _ = drive.write(ObjectAddress::new(index, sub), scope, &value);
            let _ = drive.read(ObjectAddress::new(index, sub), scope, &mut [0; 7]);
        }
        let length = |drive: &mut Drive, assignment| {
            let pdos = read(drive, assignment, 0) as u8;
            let pdos: Vec<u16> = (1..=pdos).map(|sub| read(drive, assignment, sub) as u16).collect();
            let entries = |drive: &mut Drive, pdo| {
                let count = read(drive, pdo, 0) as u8;
                (1..=count).map(|sub| read(drive, pdo, sub) & 0xFF).sum::<u32>()
            };
            pdos.into_iter().map(|pdo| entries(drive, pdo)).sum::<u32>().div_ceil(8)
        };
        let mapped = (length(&mut drive, RX), length(&mut drive, TX));
        drive.set_sync_managers(lengths.0, lengths.1);
        if (u32::from(lengths.0), u32::from(lengths.1)) != mapped {
            prop_assert!(drive.enter(SafeOp).is_err());
        }
        drive.set_sync_managers(mapped.0 as u16, mapped.1 as u16);
        if drive.enter(SafeOp).is_ok() {
            drive.enter(Op).unwrap();
            drive.exchange(Some(&[0xFF; 64]), &mut [0; 64]);
            drive.exchange(Some(&[]), &mut []);
            drive.step(1_000_000);
        } else {
            prop_assert!(mapped.0 > 31 || mapped.1 > 31, "{mapped:?}");
        }
    }
}
