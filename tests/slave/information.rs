//! The dictionary of every kind of slave, and the objects that masters read of every slave.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::coe::{ObjectAccess, ObjectCode, ObjectListType};
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::slave::dictionary::{DataTypeCode, EntryValues};
use ecmsk::slave::{AlStatus, Channels, Dp3cl, Drive, DriveConfig, Hsp, HspConfig, Io, ManufacturerObjects, Slave};

const SCRATCH: u16 = 0x4FFF;

/// One of each kind, in PreOP.
fn kinds() -> Vec<Box<dyn Slave>> {
    let mut slaves: Vec<Box<dyn Slave>> = vec![
        Box::new(Drive::new(DriveConfig::default())),
        Box::new(Drive::new(DriveConfig::stepper())),
        Box::new(Hsp::new(HspConfig::with(Channels::One))),
        Box::new(Hsp::new(HspConfig::with(Channels::Two))),
        Box::<Io>::default(),
        Box::<Dp3cl>::default(),
    ];
    for slave in &mut slaves {
        slave.enter(AlState::PreOp).expect("every slave has a mailbox");
    }
    slaves
}

fn is_dp3cl(slave: &dyn Slave) -> bool {
    slave.name() == "dp3cl"
}

fn read(slave: &mut dyn Slave, index: u16, sub: u8) -> Result<Vec<u8>, AbortCode> {
    let mut value = vec![0xA5; 1024];
    let len = slave.read(ObjectAddress::new(index, sub), SdoScope::Entry, &mut value)?;
    value.truncate(len);
    Ok(value)
}

fn write(slave: &mut dyn Slave, index: u16, sub: u8, value: &[u8]) -> Result<(), AbortCode> {
    slave.write(ObjectAddress::new(index, sub), SdoScope::Entry, value)
}

/// A list in the usual order: count 0, items, count.
fn list(slave: &mut dyn Slave, index: u16, items: &[u32], bytes: usize) -> Result<(), AbortCode> {
    write(slave, index, 0, &[0])?;
    for (sub, item) in (1..).zip(items) {
        write(slave, index, sub, &item.to_le_bytes()[..bytes])?;
    }
    write(slave, index, 0, &[items.len() as u8])
}

/// DP3CL-11.1 The objects of each slave, once each and in their order, those of a file among them.
#[test]
fn objects() {
    for mut slave in kinds() {
        let text = "0x2ABC:1 u16 rw 5 Gain\n0x2ABC:3 f32 ro 0 Ratio\n0x9ABC:0 text ro 0x41 Label";
        slave.add_manufacturer_objects(ManufacturerObjects::parse(text).unwrap());
        let objects = slave.object_list(ObjectListType::All);
        assert!(objects.is_sorted_by(|a, b| a < b), "{}", slave.name());
        for index in [0x1000, 0x1001, 0x1008, 0x1018, 0x1600, 0x1A00, 0x1C00, 0x1C12, 0x1C13, 0x2ABC, 0x9ABC] {
            assert!(objects.contains(&index), "{} {index:04X}", slave.name());
        }
        let places = (0x0F00..0x2000).chain(0x2AB0..0x2AC0).chain(0x6000..0x6A00).chain(0x9AB0..0x9AC0);
        let found = places.filter(|index| slave.describe_object(*index).is_ok());
        let in_places =
            |index: &u16| matches!(*index, 0x0F00..0x2000 | 0x2AB0..0x2AC0 | 0x6000..0x6A00 | 0x9AB0..0x9AC0);
        assert!(found.eq(objects.into_iter().filter(in_places)), "{}", slave.name());
        let object = slave.describe_object(0x2ABC).unwrap();
        assert_eq!((object.code, object.max_sub, object.name), (ObjectCode::Record, 3, "Gain"));
        let entry = slave.describe_entry(ObjectAddress::new(0x2ABC, 3)).unwrap();
        assert_eq!((entry.data_type.0, entry.bits, entry.access.0, entry.name), (0x08, 32, 0x07, "Ratio"));
    }
    let second_axis = |slave: &dyn Slave| slave.object_list(ObjectListType::All).contains(&0x6840);
    let with_two: Vec<bool> = kinds().iter().map(|slave| second_axis(&**slave)).collect();
    assert_eq!(with_two, [false, false, false, true, false, false]);
}

/// DP3CL-11.2 Code, type, highest sub-index and name, of some objects of each form.
#[test]
fn descriptions_of_objects() {
    use ObjectCode::{Array, Record, Variable};
    for slave in kinds() {
        let (max_entries, max_pdos, name) = if is_dp3cl(&*slave) { (24, 4, "VH3C") } else { (16, 8, "") };
        for (index, code, data_type, max_sub, name) in [
            (0x1000, Variable, 0x07, 0, "Device type"),
            (0x1008, Variable, 0x09, 0, "Device name"),
            (0x1018, Record, 0x23, 4, "Identity"),
            (0x1600, Record, 0x21, max_entries, "RxPDO mapping"),
            (0x1A00, Record, 0x21, max_entries, "TxPDO mapping"),
            (0x1C00, Array, 0x05, 4, "Sync manager types"),
            (0x1C12, Array, 0x06, max_pdos, "RxPDO assignment"),
            (0x1C13, Array, 0x06, max_pdos, "TxPDO assignment"),
            (0x1C32, Record, 0x29, 32, "SM output parameter"),
            (0x1C33, Record, 0x29, 32, "SM input parameter"),
        ] {
            let object = slave.describe_object(index).unwrap();
            assert_eq!((object.index, object.code, object.data_type.0), (index, code, data_type), "{index:04X}");
            assert_eq!((object.max_sub, object.name), (max_sub, name), "{index:04X}");
            if max_sub > 0 {
                let count = slave.describe_entry(ObjectAddress::new(index, 0)).unwrap();
                assert_eq!((count.name, count.bits, count.data_type.0), ("Number of entries", 8, 0x05));
            }
        }
        let text = slave.describe_entry(ObjectAddress::new(0x1008, 0)).unwrap();
        assert!(text.bits >= 32 && (name.is_empty() || usize::from(text.bits) == name.len() * 8));
    }
    let drive = Drive::new(DriveConfig::default());
    for (index, code, data_type, max_sub) in
        [(0x6099, Array, 0x07, 2), (0x607D, Array, 0x04, 2), (0x60C2, Record, 0x00, 2), (0x6040, Variable, 0x06, 0)]
    {
        let object = drive.describe_object(index).unwrap();
        assert_eq!((object.code, object.data_type.0, object.max_sub), (code, data_type, max_sub), "{index:04X}");
    }
}

/// DP3CL-11.3 Type, length and access rights of entries.
/// DP3CL-11.4 Values at power-on and ranges.
#[test]
fn descriptions_of_entries() {
    let drive = Drive::new(DriveConfig::default());
    let dp3cl = Dp3cl::default();
    let cases: [(&dyn Slave, u16, u8, u16, u16, u16); 13] = [
        (&drive, 0x1000, 0, 0x07, 32, 0x007),
        (&drive, 0x1600, 1, 0x07, 32, 0x00F),
        (&drive, 0x1C12, 1, 0x06, 16, 0x00F),
        (&drive, 0x1C32, 1, 0x06, 16, 0x00F),
        (&drive, 0x1C32, 32, 0x01, 1, 0x007),
        (&drive, 0x6040, 0, 0x06, 16, 0x07F),
        (&drive, 0x6041, 0, 0x06, 16, 0x087),
        (&drive, 0x6060, 0, 0x02, 8, 0x07F),
        (&drive, 0x605A, 0, 0x03, 16, 0x03F),
        (&drive, 0x6064, 0, 0x04, 32, 0x087),
        (&dp3cl, 0x2001, 0, 0x06, 16, 0x13F),
        (&dp3cl, 0x3001, 0, 0x03, 16, 0x007),
        (&dp3cl, 0x4000, 0, 0x01, 1, 0x03F),
    ];
    for (slave, index, sub, data_type, bits, access) in cases {
        let entry = slave.describe_entry(ObjectAddress::new(index, sub)).unwrap();
        assert_eq!(
            (entry.data_type.0, entry.bits, entry.access),
            (data_type, bits, ObjectAccess(access)),
            "{index:04X}"
        );
        assert_eq!(entry.at, ObjectAddress::new(index, sub));
    }
    let values = |index, sub| dp3cl.describe_entry(ObjectAddress::new(index, sub)).unwrap().values;
    assert_eq!(values(0x2001, 0), Some(EntryValues { default: 10_000, min: 200, max: 51_200 }));
    assert_eq!(values(0x60C2, 2), Some(EntryValues { default: -3, min: -3, max: -3 }));
    assert_eq!(values(0x6041, 0), None, "it is measured");
    assert_eq!(DataTypeCode::of(ecmsk::slave::dictionary::DataType::U64), DataTypeCode(0x1B));
}

/// DP3CL-11.5 Objects in a list of mappable objects can be mapped, and no others; parameters of a DP3CL are kept.
#[test]
fn lists() {
    for mut slave in kinds() {
        let lists = ObjectListType::LISTS.map(|kind| slave.object_list(kind));
        let [all, rx, tx, backup, settings] = &lists;
        for index in all {
            let subs = slave.describe_object(*index).unwrap().max_sub;
            for (table, mappable) in [(0x1600, rx), (0x1A00, tx)] {
                let mut can_be_mapped = false;
                for sub in 0..=subs {
                    let Ok(entry) = slave.describe_entry(ObjectAddress::new(*index, sub)) else { continue };
                    let item = u32::from(*index) << 16 | u32::from(sub) << 8 | u32::from(entry.bits & 0xFF);
                    can_be_mapped |= list(&mut *slave, table, &[item], 4).is_ok();
                }
                assert_eq!(mappable.contains(index), can_be_mapped, "{} {index:04X} in {table:04X}", slave.name());
            }
        }
        let kept = all.iter().filter(|index| is_dp3cl(&*slave) && (0x2000..0x2900).contains(*index));
        let kept = kept.filter(|index| !matches!(**index, 0x2209 | 0x220A | 0x2401));
        assert!(kept.eq(backup), "{}: {backup:04X?}", slave.name());
        assert!(settings.is_empty());
    }
}

/// DP3CL-11.6 Abort codes of missing objects. DP3CL-11.7 Objects in the dictionary can be read, and no others.
#[test]
fn entries_can_be_read() {
    for mut slave in kinds() {
        for index in slave.object_list(ObjectListType::All) {
            let max_sub = slave.describe_object(index).unwrap().max_sub;
            for sub in 0..=255 {
                let name = format!("{} {index:04X}:{sub}", slave.name());
                let described = slave.describe_entry(ObjectAddress::new(index, sub)).map(|entry| entry.bits);
                let value = read(&mut *slave, index, sub).map(|value| value.len());
                match described {
                    Ok(bits) => {
                        assert!(sub <= max_sub, "{name}");
                        assert_eq!(value, Ok(usize::from(bits).div_ceil(8)), "{name}");
                    }
                    Err(code) => {
                        assert_eq!((code.0, value), (0x0609_0011, Err(code)), "{name}");
                        assert_ne!(sub, max_sub, "{name}");
                    }
                }
            }
        }
        assert_eq!(slave.describe_object(0x7ABC).map_err(|code| code.0), Err(0x0602_0000));
        assert_eq!(slave.describe_entry(ObjectAddress::new(0x7ABC, 0)).map_err(|code| code.0), Err(0x0602_0000));
        assert_eq!(slave.describe_entry(ObjectAddress::new(0x1C12, 9)).map_err(|code| code.0), Err(0x0609_0011));
        assert!(slave.describe_entry(ObjectAddress::new(SCRATCH, 1)).is_err());
    }
}

/// DP3CL-11.8 The objects that masters read of every slave; the identity is readable in any state.
#[test]
fn usual_objects() {
    for mut slave in kinds() {
        let (identity, serial) = slave.identity().map(|(identity, serial)| (*identity, serial)).unwrap();
        let numbers = [identity.vendor_id, identity.product_code, identity.revision, serial];
        for (sub, number) in (1..).zip(numbers) {
            assert_eq!(read(&mut *slave, 0x1018, sub), Ok(number.to_le_bytes().to_vec()));
        }
        for sub in 1..=4 {
            assert_eq!(read(&mut *slave, 0x1018, sub).unwrap().len(), 4);
            assert_eq!(read(&mut *slave, 0x1C00, sub), Ok(vec![sub]));
        }
        assert_eq!((read(&mut *slave, 0x1018, 0), read(&mut *slave, 0x1C00, 0)), (Ok(vec![4]), Ok(vec![4])));
        for index in [0x1C32, 0x1C33] {
            assert_eq!(read(&mut *slave, index, 0), Ok(vec![32]));
            for sub in 1..=33 {
                let is_there = matches!(sub, 1 | 2 | 4 | 5 | 6 | 8..=12 | 32);
                assert_eq!(read(&mut *slave, index, sub).is_ok(), is_there, "{} {index:04X}:{sub}", slave.name());
            }
            let supported = read(&mut *slave, index, 4).unwrap();
            assert_eq!(supported[0] & 0b100 != 0, slave.has_dc(), "SYNC0 is for those with distributed clocks");
        }
    }
}

/// DP3CL-11.9 Octets of any length.
#[test]
fn long_values() {
    for mut slave in kinds() {
        if is_dp3cl(&*slave) {
            assert_eq!(read(&mut *slave, SCRATCH, 0), Err(AbortCode::NO_OBJECT));
            continue;
        }
        assert_eq!(read(&mut *slave, SCRATCH, 0), Ok(vec![]));
        for len in [1, 2, 3, 4, 5, 7, 8, 100, 300, 512, 0] {
            let octets: Vec<u8> = (0..len).map(|n| (n * 7 + 1) as u8).collect();
            assert_eq!(write(&mut *slave, SCRATCH, 0, &octets), Ok(()));
            assert_eq!(read(&mut *slave, SCRATCH, 0), Ok(octets));
        }
        write(&mut *slave, SCRATCH, 0, &[9]).unwrap();
        assert_eq!(write(&mut *slave, SCRATCH, 0, &[0; 513]).map_err(|code| code.0), Err(0x0607_0012));
        assert_eq!(
            (read(&mut *slave, SCRATCH, 0), read(&mut *slave, SCRATCH, 1)),
            (Ok(vec![9]), Err(AbortCode::NO_SUB_INDEX))
        );
    }
}

/// DP3CL-11.10 Complete access of each object is its entries.
#[test]
fn complete_access() {
    for mut slave in kinds() {
        for index in slave.object_list(ObjectListType::All) {
            let mut value = [0xA5; 1024];
            let at = ObjectAddress::new(index, 0);
            let answer = slave.read(at, SdoScope::Complete, &mut value);
            let (data_type, max_sub) =
                slave.describe_object(index).map(|object| (object.data_type, object.max_sub)).unwrap();
            if is_dp3cl(&*slave) {
                assert_eq!(answer.map_err(|code| code.0), Err(0x0601_0000), "{index:04X}");
                continue;
            }
            if matches!(data_type, DataTypeCode(0x09) | DataTypeCode::OCTET_STRING) {
                assert_eq!(answer.map_err(|code| code.0), Err(0x0601_0004), "{index:04X}");
                continue;
            }
            let is_list = (0x1600..0x1C00).contains(&index) || matches!(index, 0x1C12 | 0x1C13);
            let count = read(&mut *slave, index, 0).unwrap();
            let last = if is_list { count[0] } else { max_sub };
            let mut expected = count;
            expected.extend((max_sub > 0).then_some(0));
            for sub in 1..=last {
                expected.extend(read(&mut *slave, index, sub).unwrap_or_default());
            }
            let len = answer.unwrap();
            assert_eq!(value[..len], expected, "{} {index:04X}", slave.name());
        }
    }
}

/// DP3CL-11.11 Padding before, between and behind objects.
#[test]
fn padding() {
    let mut drive = Drive::new(DriveConfig::default());
    drive.enter(AlState::PreOp).unwrap();
    list(&mut drive, 0x1600, &[0x0000_0003, 0x6040_0010, 0x0000_0005, 0x607A_0020, 0x0000_0001], 4).unwrap();
    list(&mut drive, 0x1A00, &[0x0000_0004, 0x6061_0008, 0x0000_0002, 0x6041_0010], 4).unwrap();
    assert_eq!(list(&mut drive, 0x1601, &[0x0000_0000], 4), Err(AbortCode::NOT_MAPPABLE), "padding has a length");
    drive.set_sync_managers(8, 4);
    for state in [AlState::SafeOp, AlState::Op] {
        drive.enter(state).unwrap();
    }
    let mut outputs = [0; 8];
    let image = 0b111 | 0x0006 << 3 | 0b11111 << 19 | 0x1234_5678_u64 << 24 | 1 << 56;
    outputs.copy_from_slice(&image.to_le_bytes());
    let mut inputs = [0xFF; 4];
    drive.exchange(Some(&outputs), &mut inputs);
    drive.step(1_000_000);
    drive.exchange(Some(&outputs), &mut inputs);
    assert_eq!(read(&mut drive, 0x6040, 0), Ok(vec![6, 0]));
    assert_eq!(read(&mut drive, 0x607A, 0), Ok(0x1234_5678_u32.to_le_bytes().to_vec()));
    let word = read(&mut drive, 0x6041, 0).unwrap();
    let seen = u32::from_le_bytes(inputs);
    assert_eq!(seen & 0xF, 0);
    assert_eq!((seen >> 4 & 0xFF, seen >> 12 & 0b11, seen >> 30), (8, 0, 0));
    assert_eq!(seen >> 14 & 0xFFFF, u32::from(u16::from_le_bytes([word[0], word[1]])));
}

/// DP3CL-11.12 The AL status code of each mistake, and that it can be read until a change is made.
#[test]
fn al_status_codes() {
    for mut slave in kinds() {
        for pdo in [0x1C12, 0x1C13] {
            list(&mut *slave, pdo, &[], 2).unwrap();
        }
        for (lengths, status) in [((1, 0), 0x001D), ((0, 1), 0x001E)] {
            slave.set_sync_managers(lengths.0, lengths.1);
            assert_eq!(slave.enter(AlState::SafeOp), Err(AlStatus(status)), "{}", slave.name());
            assert_eq!((slave.al_status(), slave.state()), (AlStatus(status), AlState::PreOp));
        }
        slave.set_sync_managers(0, 0);
        assert_eq!((slave.enter(AlState::SafeOp), slave.al_status()), (Ok(()), AlStatus(0)));
        slave.enter(AlState::PreOp).unwrap();
        assert_eq!((slave.enter(AlState::Op), slave.al_status()), (Err(AlStatus(0x0011)), AlStatus(0x0011)));
        assert_eq!(
            (slave.request_state(RequestedState::from_code(9)), slave.al_status()),
            (Err(AlStatus(0x0012)), AlStatus(0x0012))
        );
        assert_eq!(slave.request_state(RequestedState::from_code(3)), Err(AlStatus(0x0013)));
    }
    let mut hsp = Hsp::new(HspConfig::with(Channels::Two));
    hsp.enter(AlState::PreOp).unwrap();
    let long = [0x607A_0020; 10];
    for (assignment, pdos, entry, status) in
        [(0x1C13, [0x1A00, 0x1A10], 0x6064_0020, 0x0024), (0x1C12, [0x1600, 0x1610], long[0], 0x0025)]
    {
        let mut hsp = hsp.clone();
        for pdo in pdos {
            list(&mut hsp, pdo, &[entry; 10], 4).unwrap();
        }
        list(&mut hsp, assignment, &pdos.map(u32::from), 2).unwrap();
        assert_eq!(hsp.enter(AlState::SafeOp), Err(AlStatus(status)));
    }
    let mut drive = Drive::new(DriveConfig::default());
    for state in [AlState::PreOp, AlState::SafeOp, AlState::Op] {
        drive.set_sync_managers(6, 10);
        drive.enter(state).unwrap();
    }
    drive.expire_watchdog();
    assert_eq!((drive.state(), drive.al_status()), (AlState::SafeOp, AlStatus(0x001B)));
}
