//! Opening a chip, its network, its slaves and their objects.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::AL_STATUS;
use ecmsk::ethercat::sii::VENDOR_WORD;
use ecmsk::link::chip::ChipError;
use ecmsk::xf::host::HostError;
use ecmsk::xf::request::{
    DcTiming, EepromGet, EepromOperation, EepromRequest, FifoEnable, FlashAddress, FoeFile, FoeRequest, RawGet,
    RawOperation, RawRequest, SlaveNumber, Slaves, SpiPackSizeGet, WarmReset,
};
use ecmsk::xf::{CommandCode, DataSize, EtherCatState};
use ecmsk::xf_api::{NetworkConfig, Xf, XfError};

use super::{MODE, opened, safe_op, started};

/// XF-17.1 Every chip starts, with any n, with INT0 and without, in virtual and in real time.
#[test]
fn every_chip_starts() {
    for (keys, n, version) in [
        ("", 1024, 0x22),
        ("&chip_fw=old", 112, 0x0E),
        ("&chip_fw=xfu", 992, 0x22),
        ("&n=32", 32, 0x22),
        ("&chip_fw=old&n=1408", 1408, 0x0E),
        ("&int0=yes", 1024, 0x22),
        ("&use_n=256", 256, 0x22),
        ("&speed=100k&idle_us=0", 1024, 0x22),
    ] {
        for clock in ["virtual", "real"] {
            let link = format!("xf-sim:?clock={clock}{keys}");
            if clock == "real" && keys.contains("speed") {
                continue;
            }
            let mut xf = Xf::open(&link).unwrap_or_else(|error| panic!("{link}: {error}"));
            assert_eq!(xf.host().size(), DataSize::new(n).unwrap(), "{link}");
            assert_eq!(xf.run(&SpiPackSizeGet).unwrap().bytes(), n, "{link}");
            assert_eq!(xf.host().version().unwrap().version, version, "{link}");
        }
    }
}

/// XF-17.12 A program accesses more than the slaves' objects: registers by datagrams, EEPROMs, files; not over
/// `network=models`.
#[test]
fn a_program_reaches_registers_eeproms_and_files() {
    let (mut xf, chip) = opened("xf-sim:?clock=virtual&slaves=drive,io");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    let al_status = RawRequest {
        operation: RawOperation::Brd,
        adp: 0,
        ado: AL_STATUS,
        logical: 0,
        timeout_us: 10_000,
        data: &[0; 2],
    };
    xf.run(&al_status).unwrap();
    let answer = xf.run(&RawGet).unwrap();
    assert_eq!((answer.working_counter, answer.data), (2, &[2, 0][..]));
    let slave = SlaveNumber::new(1).unwrap();
    let vendor = EepromRequest { slave, position: VENDOR_WORD, timeout_us: 10_000, operation: EepromOperation::Read };
    xf.run(&vendor).unwrap();
    let read = xf.run(&EepromGet).unwrap().data.to_vec();
    let known = xf.slave_description(1).unwrap();
    assert_eq!(read, [known.vendor.to_le_bytes(), known.product.to_le_bytes()].concat());
    let file = FoeFile {
        slave: SlaveNumber::new(0).unwrap(),
        password: 0,
        bytes: 0,
        timeout_us: 100_000,
        start: FlashAddress::new(0).unwrap(),
        name: b"firmware",
    };
    xf.run(&FoeRequest::Upload(file)).unwrap();
    assert!(chip.chip().chip().flash().starts_with(b"firmware of a simulated drive"));
    let error = xf.run(&FoeRequest::Upload(FoeFile { name: b"none", ..file })).unwrap_err();
    assert!(matches!(error, XfError::Chip(HostError::Failed { code: CommandCode::FoeRequest, .. })), "{error}");

    let (mut xf, _) = opened("xf-sim:?clock=virtual&slaves=drive,io&network=models");
    xf.start_network(&NetworkConfig::default()).unwrap();
    let error = xf.run(&al_status).unwrap_err();
    assert!(error.to_string().contains("the chip refused ECM_CMD_RAW_ECAT_FUNC_REQ"), "{error}");
}

/// XF-17.2 A link to a board, a wrong key and a wrong value are errors that say what is allowed.
#[test]
fn a_wrong_link_is_an_error() {
    for (link, parts) in [
        ("sim:", &["is a board and not an ECM-XF", "xf-sim:?slaves=drive*2"][..]),
        ("xf-sim:?slave=io", &["no key `slave`", "did you mean `slaves`", "chip_fw"]),
        ("xf-sim:?n=31", &["key `n`", "32 to 1408"]),
        ("xf-sim:?chip_fw=9", &["new, old, xfu"]),
        ("xf-sim:?serial=12", &["no key `serial`"]),
        ("xf-sim:?slaves=drives", &["did you mean `drive`"]),
        ("xf-sim:?slaves=drive:objects@/none", &["/none"]),
    ] {
        let error = Xf::open(link).err().unwrap_or_else(|| panic!("{link} is no link")).to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{link}: {error}");
    }
}

/// XF-17.3 The start of a network counts its slaves, reads their descriptions, and can be repeated in any state.
#[test]
fn a_network_is_started_again_and_again() {
    let (mut xf, _) = started("drive*2,io,step");
    for state in [EtherCatState::Init, EtherCatState::PreOp, EtherCatState::SafeOp, EtherCatState::Op] {
        assert_eq!(xf.start_network(&NetworkConfig::default()).unwrap(), 4, "{state:?}");
        for up_to in [EtherCatState::PreOp, EtherCatState::SafeOp, EtherCatState::Op] {
            if up_to.code() <= state.code() {
                xf.set_state(Slaves::All, up_to).unwrap();
            }
        }
        let found = xf.state().unwrap().state().expect("a state");
        assert!(found.code() >= state.code(), "{found:?} {state:?}");
    }
    let drive = xf.slave_description(0).unwrap();
    let io = xf.slave_description(2).unwrap();
    assert!(drive.vendor != 0 && !drive.name.is_empty() && drive.output_bytes > 0, "{drive:?}");
    assert_eq!((io.output_bytes, io.input_bytes, io.state.state()), (2, 2, Some(EtherCatState::Op)));
    assert_ne!(drive.product, io.product);
}

/// XF-17.3 The slave that did not reach a state is named, with its AL status code.
#[test]
fn the_slave_that_refuses_is_named() {
    let (mut xf, chip) = started("drive*3");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    chip.chip().chip().network().handle().silence(2, true);
    let error = xf.set_state(Slaves::All, EtherCatState::SafeOp).unwrap_err();
    let XfError::StateStuck { wanted: EtherCatState::SafeOp, slaves } = &error else { panic!("{error}") };
    assert_eq!(slaves.iter().find(|slave| slave.1.is_none()), Some(&(1, None, 0)), "{error}");
    assert!(error.to_string().contains("slave 1 does not answer"), "{error}");
    // The others can still be used.
    assert_eq!(xf.sdo_read::<i8>(2, MODE).unwrap(), xf.sdo_read::<i8>(0, MODE).unwrap());
    // One slave only.
    chip.chip().chip().network().handle().silence(2, false);
    xf.set_state(Slaves::One(SlaveNumber::new(1).unwrap()), EtherCatState::PreOp).unwrap();
}

/// XF-17.4 Objects are read and written with their types; errors are reported.
#[test]
fn objects_have_types() {
    let (mut xf, _) = started("drive,io");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    let window = ObjectAddress::new(0x6065, 0);
    xf.sdo_write(0, window, 20_000_u32).unwrap();
    assert_eq!(xf.sdo_read::<u32>(0, window).unwrap(), 20_000);
    let error = xf.sdo_read::<u8>(0, ObjectAddress::new(0x5555, 0)).unwrap_err();
    assert!(matches!(error, XfError::SdoAborted { slave: 0, abort: AbortCode::NO_OBJECT, .. }), "{error}");
    let error = xf.sdo_read::<u64>(0, window).unwrap_err();
    assert!(matches!(error, XfError::SdoSize { found: 4, wanted: 8, .. }), "{error}");
    assert!(error.to_string().contains("has 4 bytes, not 8"), "{error}");
    let error = xf.sdo_read::<u8>(2, window).unwrap_err();
    assert_eq!(error, XfError::NoSuchSlave { slave: 2, found: 2 });
    let name = xf.sdo_read_bytes(1, ObjectAddress::new(0x1008, 0), SdoScope::Entry).unwrap();
    assert!(String::from_utf8(name).unwrap().len() > 1);
    let error = xf.sdo_write_bytes(0, window, SdoScope::Entry, &[0; 257]).unwrap_err();
    assert!(error.to_string().contains("256"), "{error}");
}

/// XF-17.5 A chip that loses its power is an error for pending commands, and can be used again.
#[test]
fn wires_that_fail_are_an_error_and_no_command_is_left_in_the_queue() {
    let (mut xf, chip) = started("drive");
    for _ in 0..20 {
        chip.cut_after(0);
        let error = xf.run(&FifoEnable { on: false }).unwrap_err();
        assert!(matches!(error, XfError::Link(ChipError::Wires { .. })), "{error}");
        chip.cut_after(u32::MAX);
    }
    xf.run(&FifoEnable { on: false }).unwrap();
    assert_eq!(xf.start_network(&NetworkConfig::default()).unwrap(), 1);
}

/// XF-12.5 A chip that was reset has its earlier n, with INT0 as with idle time: it is found again.
#[test]
fn a_chip_that_was_reset_to_another_n_is_found() {
    for keys in ["", "&int0=yes"] {
        let (mut xf, _) = opened(&format!("xf-sim:?clock=virtual&slaves=drive{keys}"));
        safe_op(&mut xf, 8).unwrap();
        assert_eq!(xf.host().size(), DataSize::MANUAL);
        // Whether its only answer comes before the reset is undefined.
        let _ = xf.run(&WarmReset);
        let again = (0..50).find_map(|_| xf.start_network(&NetworkConfig::default()).ok());
        assert_eq!((again, xf.host().counters().chip_resets), (Some(1), 1), "{keys}: {:?}", xf.host().state());
    }
}

/// XF-12.12 A cycle too short to transfer the process data to the chip is refused with the calculation.
#[test]
fn a_cycle_that_cannot_be_held_is_refused() {
    let (mut xf, _) = opened("xf-sim:?clock=virtual&slaves=drive*40");
    let dc = DcTiming { sync0_ns: 250_000, assign_activate: 0x0300, ..DcTiming::default() };
    xf.start_network(&NetworkConfig { dc, ..NetworkConfig::default() }).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    xf.set_state(Slaves::All, EtherCatState::SafeOp).unwrap();
    let error = xf.process_data().unwrap_err().to_string();
    assert!(error.contains("a cycle of 250 us cannot be held: 2 exchange(s) of"), "{error}");
}

/// DP3CL-10.2 A DP3CL behind a chip gets the cycle of SYNC0: an unsupported one is refused with 0x0035; without
/// distributed clocks any is valid.
#[test]
fn a_dp3cl_knows_the_cycle_of_sync0() {
    for (assign_activate, sync0_ns, is_good) in
        [(0x0300, 1_000_000, true), (0x0300, 4_000_000, true), (0x0300, 3_000_000, false), (0, 3_000_000, true)]
    {
        let (mut xf, _) = started("dp3cl");
        let dc = DcTiming { sync0_ns, assign_activate, ..DcTiming::default() };
        xf.start_network(&NetworkConfig { dc, ..NetworkConfig::default() }).unwrap();
        xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
        let reached = xf.set_state(Slaves::All, EtherCatState::SafeOp).map_err(|error| error.to_string());
        match reached {
            Ok(_) => assert!(is_good, "{sync0_ns}"),
            Err(error) => assert!(!is_good && error.contains("0x0035"), "{sync0_ns}: {error}"),
        }
    }
}
