//! The native API's SDO access: types, abort codes, the answer that stays in the slot.

use std::time::Duration;

use crate::common::{SIZE, Tap, enabled, follow, in_op, open, script};
use ecmsk::cia402::MODES_OF_OPERATION;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{Config, EcmError, Options, SdoValue};
use ecmsk::link::Link;
use ecmsk::sk::{CommandId, MasterState, RawSlot, SdoCommand, SlotSize};

const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
const WINDOW: ObjectAddress = ObjectAddress::new(0x6065, 0);

fn commands(slots: &[RawSlot]) -> Vec<SdoCommand> {
    slots.iter().map(|slot| SdoCommand::decode(slot, SIZE).unwrap()).collect()
}

/// SK-4.17 SK-4.18 Values of all types, in every state that has SDO, of several slaves, with both slot sizes and firmwares.
#[test]
fn values_of_all_types_are_read_and_written_in_every_state() {
    for keys in ["slaves=drive*2", "slaves=drive*2&slot=16", "slaves=drive*2&fw=1.5"] {
        let ecm = open(keys);
        ecm.configure(&Config::drives(2)).unwrap();
        for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            ecm.set_state(state).unwrap();
            ecm.sdo_write(1, WINDOW, 70_000_u32).unwrap();
            ecm.sdo_write(2, WINDOW, 80_000_u32).unwrap();
            assert_eq!(ecm.sdo_read::<u32>(1, WINDOW).unwrap(), 70_000, "{keys}");
            assert_eq!(ecm.sdo_read::<u32>(2, WINDOW).unwrap(), 80_000);
            ecm.sdo_write(1, ObjectAddress::new(0x607C, 0), -5_i32).unwrap();
            assert_eq!(ecm.sdo_read::<i32>(1, ObjectAddress::new(0x607C, 0)).unwrap(), -5);
            ecm.sdo_write(1, ObjectAddress::new(0x6098, 0), -1_i8).ok();
            assert_eq!(ecm.sdo_read::<u8>(1, ObjectAddress::new(MODES_OF_OPERATION, 0)).unwrap(), 8);
        }
    }
}

/// SK-6.11 Data2 is zero-extended: signed values are read correctly, a value that is too wide for the type is an error.
#[test]
fn signed_values_come_back_and_values_too_wide_are_errors() {
    assert_eq!((i8::from_raw(0xFF), i8::from_raw(0x100), u8::from_raw(0xFF)), (Some(-1), None, Some(255)));
    assert_eq!((i16::from_raw(0x8000), i16::from_raw(0xFFFF_8000)), (Some(i16::MIN), None));
    assert_eq!((u16::from_raw(0xFFFF), u16::from_raw(0x1_0000)), (Some(0xFFFF), None));
    assert_eq!((i32::from_raw(u32::MAX), u32::from_raw(u32::MAX)), (Some(-1), Some(u32::MAX)));
    assert_eq!(((-1_i8).to_raw(), (-2_i16).to_raw(), (-3_i32).to_raw()), (0xFF, 0xFFFE, 0xFFFF_FFFD));
    let ecm = open("slaves=drive");
    ecm.sdo_write(1, WINDOW, 0x0001_0000_u32).unwrap();
    let error = ecm.sdo_read::<i16>(1, WINDOW).unwrap_err();
    assert_eq!(error, EcmError::SdoTooWide { slave: 1, object: WINDOW, value: 0x1_0000, bits: 16 });
}

/// SK-6.14 SK-6.12 SK-6.7 An abort is an error with its code and the code's text.
#[test]
fn an_abort_is_an_error_with_its_code_and_text() {
    let ecm = open("slaves=drive");
    let object = ObjectAddress::new(0x5555, 3);
    let error = ecm.sdo_read::<u32>(1, object).unwrap_err();
    assert_eq!(error, EcmError::SdoAborted { verb: "reading", slave: 1, object, code: AbortCode::NO_OBJECT });
    assert_eq!(
        error.to_string(),
        "reading 0x5555:3 of slave 1 was aborted with 0x06020000 (object does not exist in the object dictionary); \
         check object, size and state in the slave's manual"
    );
    let error = ecm.sdo_write(1, ObjectAddress::new(0x6041, 0), 1_u16).unwrap_err();
    assert!(matches!(error, EcmError::SdoAborted { verb: "writing", code: AbortCode::READ_ONLY, .. }), "{error}");
    let error = ecm.sdo_write(1, WINDOW, 1_u8).unwrap_err();
    assert!(matches!(error, EcmError::SdoAborted { .. }), "{error}");
    let error = ecm.sdo_read::<u8>(2, WINDOW).unwrap_err();
    assert!(matches!(error, EcmError::SdoAborted { slave: 2, code: AbortCode::TIMEOUT, .. }), "no slave 2: {error}");
    for slave in [0, 41, 255] {
        assert_eq!(ecm.sdo_read::<u8>(slave, WINDOW), Err(EcmError::NoSuchSlave { slave, declared: 40 }));
    }
    // A repeated aborted request returns its own abort, and a valid one works.
    assert!(ecm.sdo_read::<u32>(1, object).is_err() && ecm.sdo_read::<u32>(1, object).is_err());
    assert!(ecm.sdo_read::<u32>(1, WINDOW).is_ok());
}

/// SK-6.10 If the slot already shows the request, another object is read first, and only then.
#[test]
fn the_answer_that_stays_is_not_taken_for_a_new_one() {
    let tap = Tap::open("slaves=drive*2");
    let ecm = tap.ecm(Options::default()).unwrap();
    let read = |slave, object| SdoCommand::Read { slave, object };
    let sent = || commands(&tap.take_slots(SIZE.sdo_slot()));
    ecm.sdo_read::<u32>(1, WINDOW).unwrap();
    assert_eq!(sent(), [read(1, WINDOW)]);
    ecm.sdo_read::<u32>(1, WINDOW).unwrap();
    assert_eq!(sent(), [read(1, DEVICE_TYPE), read(1, WINDOW)]);
    // Another slave, another object, or a write in between: no detour.
    ecm.sdo_read::<u32>(2, WINDOW).unwrap();
    ecm.sdo_read::<u32>(1, WINDOW).unwrap();
    ecm.sdo_write(1, WINDOW, 5_u32).unwrap();
    ecm.sdo_read::<u32>(1, WINDOW).unwrap();
    assert_eq!(sent().len(), 4);
    // The device type itself is read after the vendor id.
    ecm.sdo_read::<u32>(1, DEVICE_TYPE).unwrap();
    ecm.sdo_read::<u32>(1, DEVICE_TYPE).unwrap();
    let vendor = ObjectAddress::new(0x1018, 1);
    assert_eq!(sent(), [read(1, DEVICE_TYPE), read(1, vendor), read(1, DEVICE_TYPE)]);
    // A write of another value to the same object.
    ecm.sdo_write(1, WINDOW, 6_u32).unwrap();
    ecm.sdo_write(1, WINDOW, 7_u32).unwrap();
    assert_eq!(ecm.sdo_read::<u32>(1, WINDOW).unwrap(), 7);
    assert_eq!(sent()[1], read(1, DEVICE_TYPE));
}

/// SK-6.10 A value that changes is read anew each time, also when the slot has answers from another program's session.
#[test]
fn every_read_is_fresh() {
    let keys = "slaves=drive&name=fresh";
    let position = ObjectAddress::new(0x6064, 0);
    let ecm = enabled(keys, &Config::drives(1));
    let mut stream = ecm.stream(4).unwrap();
    let mut last = ecm.sdo_read::<i32>(1, position).unwrap();
    for round in 1..20 {
        for n in 0..50 {
            stream.csp(1, (round * 50 + n) * 20).unwrap();
            stream.step().unwrap();
        }
        let now = ecm.sdo_read::<i32>(1, position).unwrap();
        assert!(now > last + 500, "{now} after {last}");
        last = now;
    }
    stream.finish().unwrap();
    ecm.close(ecmsk::ecm::Close::Hold).unwrap();
    let tap = Tap::open(keys);
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.sdo_read::<i32>(1, position).unwrap();
    let sent = commands(&tap.take_slots(SIZE.sdo_slot()));
    assert_eq!(sent[0], SdoCommand::Read { slave: 1, object: DEVICE_TYPE }, "the slot showed it from before");
}

/// SK-6.3 A request that meets a transfer under way runs next, and the right answer is found.
#[test]
fn an_sdo_of_a_slow_slave_is_repeated_up_to_its_limit() {
    let file = script("slow", "sdo-delay 1 400ms\n");
    let tap = Tap::open(&format!("slaves=drive*2&script={file}"));
    let short = Options { sdo_limit: Duration::from_millis(100), ..Options::default() };
    let ecm = tap.ecm(short).unwrap();
    let error = ecm.sdo_read::<u32>(1, WINDOW).unwrap_err();
    assert!(matches!(error, EcmError::Timeout { what: "an SDO read", .. }), "{error}");
    assert!(error.to_string().contains("slave 1 has not answered for 0x6065:0"), "{error}");
    drop(ecm);
    let tap = Tap::open(&format!("slaves=drive*2&script={file}"));
    let ecm = tap.ecm(Options::default()).unwrap();
    assert!(ecm.sdo_read::<u32>(1, WINDOW).is_ok());
    // Another program's request is in progress: this one's runs next.
    let mut frame = ecmsk::sk::Frame::new();
    frame.put_sdo(SIZE, &SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1018, 2) });
    tap.write(&frame, ecmsk::link::Wait::Now).unwrap();
    assert_eq!(ecm.sdo_read::<u32>(2, DEVICE_TYPE).unwrap(), 0x0002_0192);
    assert_eq!(tap.stats().board.unwrap().rejected_total(), 0);
}

/// SK-4.35 In Init there is no SDO.
#[test]
fn no_sdo_in_init() {
    let ecm = open("slaves=drive");
    ecm.set_state(MasterState::Init).unwrap();
    let error = ecm.sdo_read::<u32>(1, DEVICE_TYPE).unwrap_err();
    assert!(matches!(error, EcmError::WrongState { needs: "PreOP, SafeOP or OP", .. }), "{error}");
}

/// API-15 SK-6.1 Threads take turns: each gets its own answers.
#[test]
fn each_thread_gets_the_answers_to_its_own_sdos() {
    let tap = Tap::open("slaves=drive*4");
    let ecm = tap.ecm(Options { sdo_limit: Duration::from_secs(60), ..Options::default() }).unwrap();
    in_op(&ecm, &Config::drives(4));
    std::thread::scope(|scope| {
        for slave in 1..=4_u8 {
            let ecm = &ecm;
            scope.spawn(move || {
                for n in 0..20 {
                    let value = u32::from(slave) * 1000 + n;
                    ecm.sdo_write(slave, WINDOW, value).unwrap();
                    assert_eq!(ecm.sdo_read::<u32>(slave, WINDOW).unwrap(), value);
                }
            });
        }
    });
    assert_eq!(tap.stats().board.unwrap().rejected_total(), 0);
}

/// SK-5.20 In the middle of a full FIFO a request waits for its entry, and is not sent twice.
#[test]
fn an_sdo_behind_a_full_fifo_is_asked_once() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    let mut stream = ecm.stream(150).unwrap();
    follow(&mut stream, 1, 0, 1, 300);
    tap.take();
    ecm.sdo_read::<u32>(1, WINDOW).unwrap();
    let frames = tap.take();
    let asked = frames.iter().filter(|frame| frame.slot(SIZE, SlotSize::Bytes12.sdo_slot()).id != 0).count();
    assert_eq!(asked, 1);
    assert!(frames.iter().all(|frame| frame.slot(SIZE, 1).id == CommandId::Csp.code()), "the target is repeated");
}
