//! Tests that requests are made from fields as users type them.

use super::*;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::xf::request::*;

/// Makes a request of the function `name` from these fields, and passes it to `use_it`. Returns an error text if a
/// field is wrong.
fn request<T>(name: &str, fields: &[&str], use_it: impl FnOnce(&Request<'_>) -> T) -> Result<T, String> {
    let row = find(name)?.0;
    let fields: Vec<_> = fields.iter().map(|field| Assignment::parse(field)).collect::<Result<_, _>>()?;
    let mut data = [0; SEGMENT];
    let draft = draft(row, &fields, &mut data).map_err(|error| error.to_string())?;
    Ok(use_it(&draft.request().expect("it was checked")))
}

#[track_caller]
fn expect<'d>(name: &str, fields: &[&str], wanted: impl Into<Request<'d>>) {
    let wanted = wanted.into();
    request(name, fields, |request| assert_eq!(*request, wanted)).expect("a request");
}

/// XF-18.10 Fields have names, numbers, bits, bytes, texts, objects and sets of slaves as values.
#[test]
fn requests_from_fields() {
    let slave = SlaveNumber::new(2).expect("a slave");
    expect(
        "ECAT_STATE_SET",
        &["slaves=all", "state=preop"],
        StateSet { slaves: Slaves::All, state: ecmsk::xf::EtherCatState::PreOp },
    );
    expect(
        "stateset",
        &["state=8", "slaves=2"],
        StateSet { slaves: slave.into(), state: ecmsk::xf::EtherCatState::Op },
    );
    let data = [1, 2, 0xFF];
    let write = SdoRequest {
        slave,
        object: ObjectAddress::new(0x2000, 1),
        scope: SdoScope::Entry,
        timeout_us: 1_000_000,
        operation: SdoOperation::Write(&data),
    };
    expect("SDO_REQ", &["operation=write", "slave=2", "index=0x2000", "sub=1", "data=0102FF"], write);
    let read = SdoRequest { operation: SdoOperation::Read { bytes: 4 }, timeout_us: 5, ..write };
    expect("SDO_REQ", &["operation=read", "slave=2", "index=8192", "sub=1", "bytes=4", "timeout-us=5"], read);
    let object = |index, bits| MappedObject { index, sub: 0, bits };
    let map = PdoMap::new(0x1600, &[object(0x6040, 16), object(0x607A, 32)]).expect("two objects");
    let set = PdoConfigSet::new(slave, PdoAssignment::Rx, &[map]).expect("one PDO");
    let fields = ["slave=2", "count=1", "assignment=rx", "pdo1=0x1600", "objects1=0x60400010,0x607A0020"];
    expect("PDO_CONFIG_SET", &fields, set);
    let polling = SlaveBits::for_slaves(10).with(SlaveNumber::new(9).expect("a slave")).with(SlaveNumber::default());
    expect("MBX_STAT", &["operation=set-polling", "slaves=0,9"], MailboxStatus::SetPolling(polling));
    let enable = InterruptEnable {
        polarity: Polarity::INT0_HIGH,
        sources: ecmsk::xf::Interrupts::CRC | ecmsk::xf::Interrupts::RX_FIFO_LOW,
        gpio: 0x80,
        peripherals: PeripheralInterrupts::NONE,
    };
    let fields = ["polarity=int0-high", "sources=crc,RX_FIFO_LOW", "gpio=0x80", "peripherals=none"];
    expect("INT_SET_ENABLE", &fields, InterruptSetEnable { enable });
    let motor = MotorNumber::new(1).expect("an axis");
    let state = ecmsk::cia402::DriveState::OperationEnabled;
    expect("402_STATE_SET", &["motor=1", "state=operation-enabled"], HelperStateSet { motor, state });
    let start = FlashAddress::new(0x100).expect("a place");
    expect(
        "FOE_FUNC_REQ",
        &["operation=write-flash", "start=0x100", "data=0102FF"],
        FoeRequest::WriteFlash { start, data: &data },
    );
    let shift = DcTiming { sync0_ns: 1_000_000, shift_ns: -5, ..DcTiming::default() };
    expect("DCSYNC", &["slaves=all", "sync0_ns=1000000", "shift_ns=-5"], DcSync { slaves: Slaves::All, dc: shift });
}

/// XF-18.10 If a field is wrong, missing, given twice or unknown, the error lists the fields of the function.
#[test]
fn wrong_fields_name_those_there_are() {
    let error = |name, fields: &[&str]| request(name, fields, |_| ()).expect_err("it is wrong");
    let all = "its fields: slaves=0..255|all state=init|pre-op|boot|safe-op|op; see `ecmsk xf raw --help`";
    for (fields, why) in [
        (&["slave=1", "state=op"][..], "there is no field `slave`"),
        (&["slaves=1"], "state is missing"),
        (&[], "slaves, state are missing"),
        (&["slaves=1", "state=up"], "state=up is wrong: allowed: init|pre-op|boot|safe-op|op"),
        (&["slaves=1", "state=5"], "EtherCAT state is 5"),
        (&["slaves=256", "state=op"], "slaves is 256"),
        (&["slaves=1", "slaves=2", "state=op"], "`slaves` is given twice"),
    ] {
        let error = error("StateSet", fields);
        assert!(error.contains(why) && error.ends_with(all), "{fields:?}: {error}");
    }
    let read = ["operation=read", "slave=0", "index=0x1000", "data=00"];
    assert!(error("SDO_REQ", &read).contains("`data` means nothing"), "{}", error("SDO_REQ", &read));
    assert!(error("StateGte", &[]).contains("did you mean StateGet"));
    let several = error("ECM_GpioSetMode", &[]);
    assert!(several.contains("GpioSetMode (") && several.contains("GpioSetModeExt ("), "{several}");
    assert!(error("StateSet", &["slaves"]).contains("name=value"));
}
