//! Answers of the native API belong to its own commands, although frames get lost, other threads send commands, too,
//! and slots have old values.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enabled, in_op, script};
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Homing, Options, Slave};
use ecmsk::sk::{CommandId, Frame, MasterState};

fn config() -> Config {
    Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() }
}

fn options() -> Options {
    Options { servo_limit: Duration::from_millis(600), ..Options::default() }
}

fn is(slot: usize, id: CommandId) -> impl FnMut(&Frame) -> bool + Send {
    move |frame| frame.slot(SIZE, slot).id == id.code()
}

/// A stream of axis 1 in another thread, while `run` does its work.
fn beside_a_stream(ecm: &Ecm, axis: u8, run: impl FnOnce()) {
    let (ends, runs) = (AtomicBool::new(false), AtomicBool::new(false));
    thread::scope(|scope| {
        let streaming = scope.spawn(|| {
            let mut stream = ecm.stream(4).unwrap();
            while !ends.load(Ordering::Acquire) {
                stream.csp(axis, 0).unwrap();
                // A frame that the board did not take: the next step tries again.
                stream.step().ok();
                runs.store(true, Ordering::Release);
                // Virtual time passes with each step: limits would be over before a busy machine lets the other thread run.
                thread::yield_now();
            }
        });
        while !runs.load(Ordering::Acquire) && !streaming.is_finished() {
            thread::yield_now();
        }
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
        ends.store(true, Ordering::Release);
        streaming.join().unwrap();
        done.unwrap();
    });
}

fn timed_out<T>(done: Result<T, EcmError>) -> bool {
    matches!(done, Err(EcmError::Timeout { .. }))
}

/// SK-8.3 The board's inputs are read while another thread sets its outputs, whose results are 0.
#[test]
fn inputs_are_those_of_the_own_entry() {
    let file = script("answers-inputs", "inputs 0x3F\n");
    let ecm = enabled(&format!("slaves=drive,io&script={file}"), &config());
    let ends = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut bits = 0;
            while !ends.load(Ordering::Acquire) {
                bits = (bits + 1) & 0x3F;
                ecm.set_local_outputs(bits).unwrap();
            }
        });
        let wrong = (0..300).filter(|_| ecm.local_inputs() != Ok(0x3F)).count();
        ends.store(true, Ordering::Release);
        assert_eq!(wrong, 0);
    });
}

/// SK-3.9 A lost request has no answer, whatever the slot shows, in OP and outside.
#[test]
fn a_lost_request_has_no_answer() {
    for state in [MasterState::PreOp, MasterState::Op] {
        let tap = Tap::open("slaves=drive,io");
        let ecm = tap.ecm(options()).unwrap();
        ecm.configure(&config()).unwrap();
        ecm.set_state(state).unwrap();
        ecm.local_inputs().unwrap();
        tap.lose(is(0, CommandId::LocalRead));
        assert!(timed_out(ecm.local_inputs()), "{state}");
        ecm.set_local_outputs(1).unwrap();
        tap.lose(is(0, CommandId::LocalWrite));
        assert!(timed_out(ecm.set_local_outputs(0x3F)), "{state}");
    }
}

/// The same for IO slaves, without a stream and during one; and a command that arrives later is answered.
#[test]
fn a_lost_io_command_is_not_reported_as_done() {
    let (tap, ecm) = Tap::enabled("slaves=drive,io", &config());
    ecm.set_outputs(2, 0x0101).unwrap();
    tap.lose(is(2, CommandId::IoWrite));
    assert!(timed_out(ecm.set_outputs(2, 0x0101)));
    beside_a_stream(&ecm, 1, || assert!(timed_out(ecm.set_outputs(2, 0xBEEF))));
    let mut lost = 0;
    tap.lose(move |frame| {
        let is_it = frame.slot(SIZE, 2).id == CommandId::IoWrite.code();
        lost += u32::from(is_it);
        is_it && lost == 1
    });
    beside_a_stream(&ecm, 1, || ecm.set_outputs(2, 0xBEEF).unwrap());
    assert_eq!(ecm.inputs(2), Ok(0xBEEF), "inputs are wired to outputs");
}

/// Firmware 1.5 shows the mode in byte 1: there the count of entries is used instead.
#[test]
fn firmware_1_5_is_understood_too() {
    let file = script("answers-15", "inputs 0x15\n");
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive,io&fw=1.5&script={file}"), &config());
    ecm.set_outputs(2, 0xBEEF).unwrap();
    assert_eq!(ecm.inputs(2), Ok(0xBEEF));
    assert_eq!(ecm.local_inputs(), Ok(0x15));
    beside_a_stream(&ecm, 1, || {
        ecm.set_outputs(2, 0x1234).unwrap();
        assert_eq!(ecm.inputs(2), Ok(0x1234));
    });
    ecm.clear_fifo().unwrap();
    ecm.home(1, &Homing::method(35), |_| {}).unwrap();
    // The firmware of a running board is recognised by the index that it does not repeat.
    let adopted = Ecm::over(tap.clone(), Options::default()).unwrap();
    adopted.adopt(&config()).unwrap();
    assert_eq!(adopted.local_inputs(), Ok(0x15));
}

/// A frame that the board does not take keeps the commands of other threads in it.
#[test]
fn a_refused_frame_loses_no_command() {
    let (tap, ecm) = Tap::enabled("slaves=drive,io", &config());
    let mut refused = false;
    tap.refuse(move |frame| {
        let is_it = !refused && frame.slot(SIZE, 2).id == CommandId::IoWrite.code();
        refused |= is_it;
        is_it
    });
    beside_a_stream(&ecm, 1, || ecm.set_outputs(2, 0xBEEF).unwrap());
    assert_eq!(ecm.inputs(2), Ok(0xBEEF));
}

/// A target whose frame the board did not take is not sent with another frame.
#[test]
fn a_target_of_a_refused_step_is_not_sent() {
    let (tap, ecm) = Tap::enabled("slaves=drive,io", &config());
    let mut stream = ecm.stream(4).unwrap();
    stream.csp(1, 0).unwrap();
    stream.step().unwrap();
    tap.refuse(|frame| frame.slot(SIZE, 1).data1 == 500);
    stream.csp(1, 500).unwrap();
    assert!(stream.step().is_err());
    tap.refuse(|_| false);
    tap.take();
    ecm.local_inputs().unwrap();
    stream.finish().unwrap();
    assert!(tap.take().iter().all(|frame| frame.slot(SIZE, 1).data1 != 500));
}

/// SK-7.20 GO_HOME that is lost, or rejected, while bits 10 and 12 of an earlier homing are still set, does not count
/// as home.
#[test]
fn bits_of_an_earlier_homing_are_not_taken_for_home() {
    for stream in [false, true] {
        let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
        tap.lose(is(1, CommandId::GoHome));
        tap.bend_slot(1, |_, slot| slot.parm |= 1 << 12 | 1 << 10);
        let home = || {
            let ended = ecm.home(1, &Homing { limit: 5 * SECOND, ..Homing::method(33) }, |_| {});
            assert!(matches!(ended, Err(EcmError::HomingFailed { slave: 1, .. })), "{ended:?}");
        };
        if stream {
            beside_a_stream(&ecm, 2, home);
        } else {
            home();
        }
    }
}

/// Another thread's commands hide GO_HOME in the slot; the homing is noticed all the same.
#[test]
fn homing_beside_a_thread_that_polls() {
    let ecm = enabled("slaves=drive,io", &config());
    let ends = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            while !ends.load(Ordering::Acquire) {
                ecm.local_inputs().unwrap();
            }
        });
        let homed: Vec<_> = (0..5).map(|_| ecm.home(1, &Homing::method(35), |_| {})).collect();
        ends.store(true, Ordering::Release);
        assert!(homed.iter().all(Result::is_ok), "{homed:?}");
    });
}

/// SK-6.10 The answer to a write that came too late is not that of the next one.
#[test]
fn a_late_sdo_answer_is_not_taken_for_another() {
    let file = script("answers-late", "sdo-delay 1 400ms\n");
    let tap = Tap::open(&format!("slaves=drive&script={file}"));
    let impatient = Options { sdo_limit: Duration::from_millis(300), ..Options::default() };
    let ecm = tap.ecm(impatient).unwrap();
    let object = ObjectAddress::new(0x6065, 0);
    assert!(timed_out(ecm.sdo_write(1, object, 1000_u32)));
    let second = ecm.sdo_write(1, object, 2000_u32);
    cycles(&ecm, 2000);
    let patient = Ecm::over(tap.clone(), Options::default()).unwrap();
    let value = patient.sdo_read::<u32>(1, object).unwrap();
    assert!(timed_out(second.clone()) || value == 2000, "{second:?}, and it is {value}");
}

/// A write after one that was late is done.
#[test]
fn an_sdo_write_after_a_late_one_is_done() {
    let file = script("answers-later", "sdo-delay 1 400ms\nat 2s sdo-delay 1 1ms\n");
    let tap = Tap::open(&format!("slaves=drive&script={file}"));
    let ecm = tap.ecm(Options { sdo_limit: Duration::from_millis(300), ..Options::default() }).unwrap();
    let object = ObjectAddress::new(0x6065, 0);
    assert!(timed_out(ecm.sdo_write(1, object, 1000_u32)));
    cycles(&ecm, 3000);
    ecm.sdo_write(1, object, 3000_u32).unwrap();
    assert_eq!(ecm.sdo_read::<u32>(1, object), Ok(3000));
}

/// SK-4.3 A lost part of the configuration is sent again until its own answer has arrived.
#[test]
fn a_lost_part_of_the_configuration_is_sent_again() {
    let tap = Tap::open("slaves=drive*16");
    let ecm = tap.ecm(Options::default()).unwrap();
    let mut groups = 0;
    tap.lose(move |frame| {
        let is_it = frame.slot(SIZE, 0).id == CommandId::SetAxis.code();
        groups += u32::from(is_it);
        is_it && groups == 2
    });
    in_op(&ecm, &Config::drives(16));
    ecm.servo_on(&(1..=16).collect::<Vec<_>>()).unwrap();
    // A mode that never arrives is reported.
    let tap = Tap::open("slaves=drive");
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.configure(&Config::drives(1)).unwrap();
    tap.lose(is(1, CommandId::DriveMode));
    let velocity = Config { slaves: vec![Slave::Drive(Axis::CSV)], ..Config::default() };
    assert!(timed_out(ecm.configure(&velocity)));
}

/// SK-4.61 A slave that is lost in OP: its targets are refused, and switching it or closing reports that, soon.
#[test]
fn a_lost_slave_is_named() {
    let file = script("answers-lost", "at 3s lose 2\n");
    let ecm = enabled(&format!("slaves=drive*2&script={file}"), &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    let is_two = |error: &EcmError| matches!(error, EcmError::SlaveLost { slave: Some(2), found } if found.is_failed());
    let mut refused = None;
    for n in 0..5000 {
        stream.csp(1, n * 10).unwrap();
        if let Err(error) = stream.csp(2, n * 10) {
            refused.get_or_insert(error);
        }
        stream.step().unwrap();
    }
    assert!(is_two(&refused.expect("the lost one's target is refused")));
    stream.finish().unwrap();
    assert!(is_two(&ecm.servo_on(&[2]).unwrap_err()));
    assert!(is_two(&ecm.servo_off(&[2]).unwrap_err()));
    ecm.servo_on(&[1]).unwrap();
    assert!(is_two(&ecm.close(Close::ServoOff).unwrap_err()));
}
