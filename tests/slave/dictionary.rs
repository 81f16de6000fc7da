//! Object dictionaries: types, access, ranges and the CoE abort codes of ETG.1000.6.
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::fieldbus::AlState;
use ecmsk::slave::SdoValue;
use ecmsk::slave::dictionary::{
    self, Access, DataType, Device, Object, PdoDirection, Slot, Values, check, join, only_if, rows, slot,
};

/// A device with one object of every kind.
struct Bench {
    values: Values,
    state: AlState,
    live: i16,
    written: u32,
    told: u32,
}

type Row = Object<Bench>;

const OBJECTS: &[Row] = &[
    Row::bool(0x2000, 0, "Switch").rw().default(1),
    Row::i8(0x2001, 0, "Small").rw().range(-5, 5),
    Row::u8(0x2002, 0, "Record").default(4),
    Row::u16(0x2002, 1, "Run").rw().array(3).default(7).accept(|_, at, value| {
        if i64::from(at.sub) == value { Err(AbortCode::PARAMETER_INCOMPATIBLE) } else { Ok(()) }
    }),
    Row::i32(0x2002, 4, "After the run").rw().changed(|bench| bench.told += 1),
    Row::u32(0x2003, 0, "Large").rw().rx(),
    Row::i16(0x2004, 0, "Live").tx().live(|bench| bench.live.into()),
    Row::u32(0x2005, 0, "Live and written").wo().live(|bench| bench.written.into()).setter(|bench, value| {
        bench.written = value as u32;
        Ok(())
    }),
    Row::u16(0x2006, 0, "Early").rw_up_to(AlState::PreOp),
    Row::text(0x2007, 0, "Long name", |_| "TEST bench"),
    Row::text(0x2008, 0, "Short name", |_| "ab"),
    Row::i64(0x2009, 0, "Longer").rw().range(-5_000_000_000, 5_000_000_000).default(-1),
    Row::u64(0x200A, 0, "Longest").rw(),
    Row::u8(0x200B, 0, "Mixed record").default(5),
    Row::u16(0x200B, 1, "Readable"),
    Row::u32(0x200B, 3, "Written").wo().live(|bench| bench.written.into()).setter(|bench, value| {
        bench.written = value as u32;
        Ok(())
    }),
    Row::u8(0x200B, 5, "Both").rw().range(0, 9),
];
const _: () = check(OBJECTS);

const SWITCH: Slot<bool> = slot(OBJECTS, 0x2000, 0);
const SMALL: Slot<i8> = slot(OBJECTS, 0x2001, 0);
const RUN: [Slot<u16>; 3] = [slot(OBJECTS, 0x2002, 1), slot(OBJECTS, 0x2002, 2), slot(OBJECTS, 0x2002, 3)];
const AFTER: Slot<i32> = slot(OBJECTS, 0x2002, 4);

impl Device for Bench {
    fn objects() -> &'static [Row] {
        OBJECTS
    }

    fn values(&self) -> &Values {
        &self.values
    }

    fn values_mut(&mut self) -> &mut Values {
        &mut self.values
    }

    fn al_state(&self) -> AlState {
        self.state
    }
}

fn bench() -> Bench {
    Bench { values: Values::new(OBJECTS), state: AlState::PreOp, live: -2, written: 0, told: 0 }
}

fn read(bench: &Bench, index: u16, sub: u8) -> Result<SdoValue, AbortCode> {
    dictionary::upload(bench, ObjectAddress::new(index, sub))
}

fn write(bench: &mut Bench, index: u16, sub: u8, size: SdoSize, value: u32) -> Result<(), AbortCode> {
    dictionary::download(bench, ObjectAddress::new(index, sub), size, value)
}

const fn value(size: u8, bits: u32) -> Result<SdoValue, AbortCode> {
    Ok(SdoValue { size, bits })
}

/// A table describes its rows for SDO information.
#[test]
fn rows_tell_what_they_are() {
    let row = |index, sub| OBJECTS.iter().find(|row| row.address() == ObjectAddress::new(index, sub)).expect("a row");
    let run = row(0x2002, 1);
    assert_eq!((run.count(), run.name(), run.data_type()), (3, "Run", DataType::U16));
    assert_eq!((run.access(), run.pdo()), (Access::ReadWrite, None));
    assert_eq!((row(0x2001, 0).count(), row(0x2001, 0).data_type()), (1, DataType::I8));
    assert_eq!((row(0x2003, 0).pdo(), row(0x2004, 0).pdo()), (Some(PdoDirection::Rx), Some(PdoDirection::Tx)));
    assert_eq!((row(0x2005, 0).access(), row(0x2007, 0).access()), (Access::WriteOnly, Access::ReadOnly));
    assert_eq!(row(0x2006, 0).access(), Access::ReadWriteUpTo(AlState::PreOp));
}

/// A device's own program may change stored values.
#[test]
fn stored_values_are_set() {
    let mut bench = bench();
    for on in [false, true, false] {
        bench.values.set(SWITCH, on);
        assert_eq!((bench.values.get(SWITCH), read(&bench, 0x2000, 0)), (on, value(1, on.into())));
    }
}

/// SK-6.12 Every way in which a transfer fails has its abort code, number for number.
#[test]
fn abort_codes() {
    let upload = |index, sub| read(&bench(), index, sub).map(|_| ()).map_err(|code| code.0);
    assert_eq!(upload(0x1FFF, 0), Err(0x0602_0000), "no object, before the first");
    assert_eq!(upload(0x3000, 0), Err(0x0602_0000), "no object, after the last");
    assert_eq!(upload(0x2000, 1), Err(0x0609_0011), "no sub-index");
    assert_eq!(upload(0x2002, 5), Err(0x0609_0011), "no sub-index after a run");
    assert_eq!(upload(0x2005, 0), Err(0x0601_0001), "write-only");

    let download = |index, sub, size, bits| write(&mut bench(), index, sub, size, bits).map_err(|code| code.0);
    assert_eq!(download(0x1FFF, 0, SdoSize::One, 0), Err(0x0602_0000), "no object");
    assert_eq!(download(0x2001, 9, SdoSize::One, 0), Err(0x0609_0011), "no sub-index");
    assert_eq!(download(0x2002, 0, SdoSize::One, 1), Err(0x0601_0002), "read-only");
    assert_eq!(download(0x2004, 0, SdoSize::Two, 1), Err(0x0601_0002), "read-only, live");
    assert_eq!(download(0x2007, 0, SdoSize::Four, 1), Err(0x0601_0002), "read-only, text");
    assert_eq!(download(0x2001, 0, SdoSize::Two, 0), Err(0x0607_0012), "length too high");
    assert_eq!(download(0x2002, 1, SdoSize::Four, 0), Err(0x0607_0012), "length too high");
    assert_eq!(download(0x2002, 1, SdoSize::One, 0), Err(0x0607_0013), "length too low");
    assert_eq!(download(0x2003, 0, SdoSize::Two, 0), Err(0x0607_0013), "length too low");
    assert_eq!(download(0x2001, 0, SdoSize::One, 6), Err(0x0609_0031), "value too high");
    assert_eq!(download(0x2001, 0, SdoSize::One, 0xFA), Err(0x0609_0032), "value too low: -6");
    assert_eq!(download(0x2000, 0, SdoSize::One, 2), Err(0x0609_0031), "a BOOLEAN is 0 or 1");
    assert_eq!(download(0x2002, 2, SdoSize::Two, 2), Err(0x0604_0043), "the row's own check");

    let mut late = Bench { state: AlState::SafeOp, ..bench() };
    assert_eq!(write(&mut late, 0x2006, 0, SdoSize::Two, 1).map_err(|code| code.0), Err(0x0800_0022), "AL state");
    assert_eq!(read(&late, 0x2006, 0), value(2, 0), "and is as before");
    late.state = AlState::PreOp;
    assert_eq!(write(&mut late, 0x2006, 0, SdoSize::Two, 1), Ok(()));
}

/// SK-6.11 A read value has the object's size and is zero-extended; text is cut to 4 bytes.
#[test]
fn uploads() {
    let mut bench = bench();
    assert_eq!(read(&bench, 0x2000, 0), value(1, 1));
    assert_eq!(read(&bench, 0x2002, 0), value(1, 4));
    assert_eq!(read(&bench, 0x2002, 3), value(2, 7));
    assert_eq!(read(&bench, 0x2004, 0), value(2, 0xFFFE), "-2, not extended by its sign");
    assert_eq!(read(&bench, 0x2007, 0), value(4, u32::from_le_bytes(*b"TEST")));
    assert_eq!(read(&bench, 0x2008, 0), value(2, u32::from_le_bytes(*b"ab\0\0")));
    write(&mut bench, 0x2001, 0, SdoSize::One, 0xFFFF_FFFB).unwrap();
    assert_eq!(read(&bench, 0x2001, 0), value(1, 0xFB), "only the byte that the size names");
}

/// A download reaches the device: stored values by their slots, live ones by their setters.
#[test]
fn downloads() {
    let mut bench = bench();
    assert!(bench.values.get(SWITCH));
    write(&mut bench, 0x2000, 0, SdoSize::One, 0).unwrap();
    write(&mut bench, 0x2001, 0, SdoSize::One, 0xFB).unwrap();
    write(&mut bench, 0x2002, 2, SdoSize::Two, 0xBEEF).unwrap();
    write(&mut bench, 0x2002, 4, SdoSize::Four, -70_000_i32 as u32).unwrap();
    write(&mut bench, 0x2005, 0, SdoSize::Four, 0xDEAD_BEEF).unwrap();
    assert!(!bench.values.get(SWITCH));
    assert_eq!(bench.values.get(SMALL), -5);
    assert_eq!(RUN.map(|slot| bench.values.get(slot)), [7, 0xBEEF, 7]);
    assert_eq!((bench.values.get(AFTER), bench.told), (-70_000, 1));
    assert_eq!(bench.written, 0xDEAD_BEEF);
}

/// SK-7.53 SK-6.11 A mailbox moves numbers of 64 bits whole; a board reads the first 4 bytes and writes none.
#[test]
fn numbers_of_64_bits() {
    let mut bench = bench();
    let whole = |bench: &Bench, index| {
        let mut value = [0xEE; 9];
        let len = dictionary::read(bench, ObjectAddress::new(index, 0), SdoScope::Entry, &mut value);
        (len, value)
    };
    let put = |bench: &mut Bench, index, value: &[u8]| {
        dictionary::write(bench, ObjectAddress::new(index, 0), SdoScope::Entry, value).map_err(|code| code.0)
    };
    assert_eq!(whole(&bench, 0x2009), (Ok(8), [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xEE]));
    assert_eq!(read(&bench, 0x2009, 0), value(4, u32::MAX));
    assert_eq!(write(&mut bench, 0x2009, 0, SdoSize::Four, 1), Err(AbortCode::TOO_SHORT));
    assert_eq!(put(&mut bench, 0x2009, &4_999_999_999_i64.to_le_bytes()), Ok(()));
    assert_eq!(put(&mut bench, 0x2009, &5_000_000_001_i64.to_le_bytes()), Err(0x0609_0031));
    assert_eq!(put(&mut bench, 0x2009, &(-5_000_000_001_i64).to_le_bytes()), Err(0x0609_0032));
    assert_eq!(put(&mut bench, 0x2009, &[0; 9]), Err(0x0607_0012));
    for number in [0, 1, u64::MAX, 1 << 63] {
        assert_eq!(put(&mut bench, 0x200A, &number.to_le_bytes()), Ok(()));
        assert_eq!(whole(&bench, 0x200A).1[..8], number.to_le_bytes());
    }
}

/// SK-7.53 Complete access of a record with gaps, and with values that are read-only or write-only.
#[test]
fn complete_access_of_a_record() {
    let mut bench = Bench { written: 0x0403_0201, ..bench() };
    let at = |sub| ObjectAddress::new(0x200B, sub);
    let mut record = [0xEE; 10];
    assert_eq!(dictionary::read(&bench, at(0), SdoScope::Complete, &mut record), Ok(9));
    assert_eq!(record, [5, 0, 0, 0, 0, 0, 0, 0, 0, 0], "zeros instead of what can only be written");
    assert_eq!(dictionary::read(&bench, at(1), SdoScope::Complete, &mut record), Ok(7));
    let mut write =
        |sub, value: &[u8]| dictionary::write(&mut bench, at(sub), SdoScope::Complete, value).map_err(|code| code.0);
    assert_eq!(write(0, &[9, 0, 9, 9, 0x78, 0x56, 0x34, 0x12, 7]), Ok(()), "what can only be read is left out");
    assert_eq!(write(1, &[9, 9, 1, 0, 0, 0, 10]), Err(0x0609_0031), "the last one is too high");
    for wrong in [0, 1, 3, 5, 10] {
        assert_eq!(write(0, &[0; 10][..wrong]), Err(0x0607_0010), "{wrong} bytes");
    }
    assert_eq!((bench.written, read(&bench, 0x200B, 5), read(&bench, 0x200B, 1)), (1, value(1, 7), value(2, 0)));
}

/// A row has the directions in which it may be mapped.
#[test]
fn pdo_mappability() {
    let directions: Vec<_> = OBJECTS.iter().filter_map(|row| Some((row.address().index, row.pdo()?))).collect();
    assert_eq!(directions, [(0x2003, PdoDirection::Rx), (0x2004, PdoDirection::Tx)]);
}

/// A table out of order stops the compiler; the check itself is shown here at run time.
#[test]
fn tables_are_checked() {
    let rejected = |rows: &'static [Row]| std::panic::catch_unwind(|| check(rows)).is_err();
    const TWICE: &[Row] = &[Row::u8(0x2000, 0, "a"), Row::u8(0x2000, 0, "b")];
    const OVERLAP: &[Row] = &[Row::u8(0x2000, 0, "a").array(3), Row::u8(0x2000, 2, "b")];
    const UNSORTED: &[Row] = &[Row::u8(0x2001, 0, "a"), Row::u8(0x2000, 0, "b")];
    const WIDE: &[Row] = &[Row::u8(0x2000, 0, "a").rw().range(0, 256)];
    const OUTSIDE: &[Row] = &[Row::u8(0x2000, 0, "a").rw().range(1, 2)];
    const NOWHERE: &[Row] = &[Row::u8(0x2000, 0, "a").rw().live(|bench| bench.told.into())];
    const DEAF: &[Row] = &[Row::u8(0x2000, 0, "a").rx()];
    const ENDLESS: &[Row] = &[Row::text(0x2000, 0, "a", |_| "b").tx()];
    for rows in [TWICE, OVERLAP, UNSORTED, WIDE, OUTSIDE, NOWHERE, DEAF, ENDLESS] {
        assert!(rejected(rows), "{}", rows[0].name());
    }
    assert!(!rejected(OBJECTS));
}

/// A device whose table has several parts; it may have the last one or not.
struct Parts {
    values: Values,
    full: bool,
}

type Part = Object<Parts>;

const PARTS: [&[Part]; 4] = [
    &[Object::u8(0x2000, 0, "Always").rw().default(1), Object::u8(0x2001, 1, "Part of a record").rw().default(2)],
    &[],
    &[Part::u8(0x2001, 2, "Only in a full one").only_if(|parts| parts.full).rw().default(3)],
    &only_if(
        |parts: &Parts| parts.full,
        [Part::u8(0x2002, 0, "And this").rw().default(4), Object::u8(0x2003, 0, "And that")],
    ),
];
const JOINED: &[Object<Parts>] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(JOINED);
const LAST: Slot<u8> = slot(JOINED, 0x2002, 0);

impl Device for Parts {
    fn objects() -> &'static [Object<Self>] {
        JOINED
    }

    fn values(&self) -> &Values {
        &self.values
    }

    fn values_mut(&mut self) -> &mut Values {
        &mut self.values
    }

    fn al_state(&self) -> AlState {
        AlState::PreOp
    }
}

/// A table of several parts acts as one; objects that a device of the table does not have are missing for SDOs, and do
/// not shift other objects.
#[test]
fn tables_of_parts_that_not_every_device_has() {
    let objects = [(0x2000, 0, 1), (0x2001, 1, 2), (0x2001, 2, 3), (0x2002, 0, 4), (0x2003, 0, 0)];
    for full in [true, false] {
        let mut parts = Parts { values: Values::new(JOINED), full };
        for (index, sub, default) in objects {
            let at = ObjectAddress::new(index, sub);
            let absent = match (full || default == 1 || default == 2, index) {
                (true, _) => None,
                (false, 0x2001) => Some(AbortCode::NO_SUB_INDEX),
                (false, _) => Some(AbortCode::NO_OBJECT),
            };
            let expected = absent.map_or(Ok(SdoValue { size: 1, bits: default }), Err);
            assert_eq!(dictionary::upload(&parts, at), expected, "{index:04X}:{sub} {full}");
            let written = dictionary::download(&mut parts, at, SdoSize::One, default + 10);
            let refused = absent.or((index == 0x2003).then_some(AbortCode::READ_ONLY));
            assert_eq!(written, refused.map_or(Ok(()), Err), "{index:04X}:{sub} {full}");
        }
        assert_eq!(parts.values.get(LAST), if full { 14 } else { 4 });
    }
}
