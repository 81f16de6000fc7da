//! SDOs, mappings, flash memory.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, AlStatus, Ns};
use ecmsk::slave::Slave;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::chip::{FLASH_BYTES, Profile};
use ecmsk::xf::host::HostConfig;
use ecmsk::xf::request::{
    Fifo, FifoPackSizeGet, FlashAddress, FlashBytes, FoeFile, FoeGet, FoeRequest, MappedObject, PdoAssignment,
    PdoConfigForm, PdoConfigGet, PdoConfigRequest, PdoConfigSet, PdoMap, Reconfig, SdoAbortCodeGet, SdoGet,
    SdoOperation, SdoRequest, WarmReset,
};

use super::{MS, OVER_CONTROLLERS, Pair, drive, sdo, to_all};
use crate::slave;

fn reads(bytes: u16) -> SdoOperation<'static> {
    SdoOperation::Read { bytes }
}

/// XF-13.1 XF-11.36 SDO_REQ (XF EN 579) writes an object of a slave, and reads one for SDO_GET (XF EN 606), an entry or
/// all of them. After a read that fails SDO_GET has no bytes.
#[test]
pub fn objects() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.is_refused(&SdoGet);
    pair.write(1, 0x6065, 0, &20_000_u32.to_le_bytes());
    assert_eq!(pair.object(1, 0x6065, 0), 20_000);
    assert_ne!(pair.object(0, 0x6065, 0), 20_000, "of the other drive");
    let read = pair.read(&sdo(1, 0x6065, 0, reads(4)), &SdoGet, <[u8]>::to_vec);
    assert_eq!(read, Ok(20_000_u32.to_le_bytes().to_vec()));
    let all = SdoRequest { scope: SdoScope::Complete, ..sdo(0, 0x1C12, 0, reads(64)) };
    let read = pair.read(&all, &SdoGet, |data| data[..4].to_vec());
    assert_eq!(read, Ok(vec![1, 0, 0x00, 0x16]));
    let name = pair.read(&sdo(2, 0x1008, 0, reads(64)), &SdoGet, <[u8]>::to_vec);
    assert_eq!(name, Ok(b"IO16 simulated digital IO".to_vec()));
    pair.ends_in_failure(&sdo(2, 0x5FFF, 0, reads(4)));
    pair.get(&SdoGet, |data| assert_eq!(data, [0; 0]));
}

/// A slave that aborts every transfer.
struct Aborting {
    state: AlState,
    code: AbortCode,
}

impl Slave for Aborting {
    fn name(&self) -> &str {
        "aborting"
    }

    fn state(&self) -> AlState {
        self.state
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.state = target;
        Ok(())
    }

    fn read(&mut self, _: ObjectAddress, _: SdoScope, _: &mut [u8]) -> Result<usize, AbortCode> {
        Err(self.code)
    }

    fn write(&mut self, _: ObjectAddress, _: SdoScope, _: &[u8]) -> Result<(), AbortCode> {
        Err(self.code)
    }

    fn exchange(&mut self, _: Option<&[u8]>, _: &mut [u8]) {}

    fn step(&mut self, _: Ns) {}
}

/// The codes of the list at SDO_ABORTCODE_GET (XF EN 1358), without 0 for no error.
#[rustfmt::skip]
const ABORT_CODES: [u32; 29] = [
    0x0503_0000, 0x0504_0000, 0x0504_0001, 0x0504_0005, 0x0601_0000, 0x0601_0001, 0x0601_0002, 0x0601_0003,
    0x0601_0004, 0x0602_0000, 0x0604_0041, 0x0604_0042, 0x0604_0043, 0x0604_0047, 0x0606_0000, 0x0607_0010,
    0x0607_0012, 0x0607_0013, 0x0609_0011, 0x0609_0030, 0x0609_0031, 0x0609_0032, 0x0609_0033, 0x0609_0036,
    0x0800_0000, 0x0800_0020, 0x0800_0021, 0x0800_0022, 0x0800_0023,
];

/// XF-11.37 A refused access ends with the drive's abort code, which is kept until the next transfer.
#[test]
fn refused_transfers() {
    let mut pair = Pair::in_state(EtherCatState::SafeOp);
    for (index, sub, operation, abort) in [
        (0x5FFF, 0, reads(4), AbortCode::NO_OBJECT),
        (0x1018, 9, reads(4), AbortCode::NO_SUB_INDEX),
        (0x1000, 0, SdoOperation::Write(&[1, 2, 3, 4]), AbortCode::READ_ONLY),
        (0x6065, 0, SdoOperation::Write(&[1, 2]), AbortCode::TOO_SHORT),
        (0x6065, 0, SdoOperation::Write(&[1, 2, 3, 4, 5]), AbortCode::TOO_LONG),
        (0x1C12, 0, SdoOperation::Write(&[0]), AbortCode::DEVICE_STATE),
    ] {
        assert_eq!(pair.ends_in_failure(&sdo(0, index, sub, operation)), Some(abort), "{index:04X}:{sub}");
        assert_eq!(pair.get(&SdoAbortCodeGet, |code| code), abort, "it is kept");
    }
    pair.is_refused(&sdo(3, 0x1000, 0, reads(4)));
}

/// XF-13.1 XF-11.37 SDO_ABORTCODE_GET (XF EN 1358): a read and a write that the slave aborts end with its code,
/// whichever of the manual's list it is, and a transfer that succeeds ends with 0.
#[test]
pub fn abort_codes() {
    for code in ABORT_CODES.map(AbortCode) {
        // A device that aborts everything gives no content for its EEPROM: behind a controller a script makes it abort.
        let aborting: Box<dyn Slave> = Box::new(Aborting { state: AlState::Init, code });
        let slave = if OVER_CONTROLLERS.get() { drive() } else { aborting };
        let mut pair = Pair::running_with(Profile::NEW, HostConfig::DEFAULT, vec![slave, drive()]);
        pair.bring_to(EtherCatState::PreOp);
        pair.chip().network().handle().abort_sdo(1, Some(code));
        for operation in [reads(4), SdoOperation::Write(&[1])] {
            // A slave that aborts with "timeout" counts as silent, too: both cases wait for the time limit.
            assert_eq!(pair.ends_in_failure(&sdo(0, 0x2000, 1, operation)), Some(code));
            assert_eq!(pair.get(&SdoAbortCodeGet, |abort| abort), code);
        }
        pair.run(&sdo(1, 0x1000, 0, reads(4)));
        assert_eq!(pair.get(&SdoAbortCodeGet, |abort| abort), AbortCode(0));
    }
}

/// XF-13.1 XF-11.38 The chip waits for a silent slave until the time limit of SDO_REQ, in microseconds (XF EN 579), and
/// so for a slave in Init, where no mailbox answers.
#[test]
fn objects_of_a_slave_that_does_not_answer() {
    for (state, is_silent) in [(EtherCatState::PreOp, true), (EtherCatState::Init, false)] {
        let mut pair = Pair::in_state(state);
        pair.silence(0, is_silent);
        let since = pair.now;
        let read = SdoRequest { timeout_us: 250_000, ..sdo(0, 0x1000, 0, reads(4)) };
        assert_eq!(pair.ends_in_failure(&read), Some(AbortCode::TIMEOUT), "{state:?}");
        assert!((250 * MS..270 * MS).contains(&(pair.now - since)), "{state:?}");
    }
}

/// XF-13.1 XF-11.39 PDO_CONFIG_SET (XF EN 468) writes a slave's mapping, PDO_CONFIG_REQ (XF EN 517) reads it for
/// PDO_CONFIG_GET (XF EN 533), with room for 3 PDOs or, newer, 4; process data are laid out by it.
#[test]
pub fn mapping() {
    for (profile, form) in [(Profile::OLD, PdoConfigForm::Three), (Profile::NEW, PdoConfigForm::Four)] {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![drive(), drive()]);
        pair.bring_to(EtherCatState::PreOp);
        let object = |index, bits| MappedObject::new(ObjectAddress::new(index, 0), bits);
        for (assignment, index, objects) in [
            (PdoAssignment::Rx, 0x1600, vec![object(0x6040, 16), object(0x607A, 32), object(0x6060, 8)]),
            (PdoAssignment::Tx, 0x1A00, vec![object(0x6041, 16), object(0x6064, 32)]),
        ] {
            let maps = [PdoMap::new(index, &objects).expect("at most 8")];
            pair.run(&PdoConfigSet::new(slave(1), assignment, &maps).expect("at most 3"));
            assert_eq!(pair.object(1, index, 0), objects.len() as u32);
            assert_eq!(pair.object(1, index, 2) >> 16, u32::from(objects[1].index));
            let request = PdoConfigRequest { slave: slave(1), assignment };
            let read = pair.read(&request, &PdoConfigGet, |config| config).expect("it was read");
            assert_eq!((read.maps(), read.form(), read.assignment), (&maps[..], form, assignment));
        }
        pair.run(&Reconfig);
        let sizes = [Fifo::Rx, Fifo::Tx].map(|fifo| pair.get(&FifoPackSizeGet { fifo }, |bytes| bytes));
        assert_eq!(sizes, [6 + 7, 10 + 6]);
        pair.run(&to_all(EtherCatState::Op));
    }
}

/// XF-13.1 XF-11.40 A mapping that the slave refuses makes PDO_CONFIG_SET fail (XF EN 468), with its abort code.
#[test]
fn refused_mapping() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    let maps = [PdoMap::new(0x1600, &[MappedObject::new(ObjectAddress::new(0x5FFF, 0), 16)]).expect("at most 8")];
    pair.ends_in_failure(&PdoConfigSet::new(slave(0), PdoAssignment::Rx, &maps).expect("at most 3"));
    assert_ne!(pair.get(&SdoAbortCodeGet, |code| code), AbortCode(0));
    pair.is_refused(&PdoConfigGet);
}

/// XF-13.1 XF-11.41 FOE_FUNC_REQ (XF EN 1598) writes and reads the flash memory, FOE_FUNC_GET (XF EN 1621) returns the
/// data; the memory keeps its content over WARM_RESET. Slave models do not have files of slaves, operations 1 and 2.
#[test]
pub fn flash() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    let at = |place| FlashAddress::new(place).expect("below 0x40000");
    assert_eq!(pair.chip().flash().len(), FLASH_BYTES);
    let data: Vec<u8> = (0..=255).collect();
    for start in [0x100, 0x3_FF00] {
        pair.run(&FoeRequest::WriteFlash { start: at(start), data: &data });
        assert_eq!(pair.chip().flash()[start as usize..][..256], data);
    }
    let request = FoeRequest::ReadFlash { start: at(0x1FE), bytes: FlashBytes::new(4).expect("at most 256") };
    assert_eq!(pair.read(&request, &FoeGet, <[u8]>::to_vec), Ok(vec![254, 255, 0xFF, 0xFF]));
    let file = FoeFile { slave: slave(0), password: 0, bytes: 10, timeout_us: 1000, start: at(0), name: b"a" };
    if !OVER_CONTROLLERS.get() {
        pair.is_refused(&FoeRequest::Upload(file));
        pair.is_refused(&FoeRequest::Download(file));
    }
    let behind = FlashBytes::new(2).expect("at most 256");
    pair.is_refused(&FoeRequest::ReadFlash { start: at(0x3_FFFF), bytes: behind });
    pair.submit(&WarmReset);
    pair.until("the reset", |host| host.counters().chip_resets == 1);
    assert_eq!(pair.chip().flash()[0x100..0x200], data);
}
