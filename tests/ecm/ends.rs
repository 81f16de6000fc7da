//! How calls of the native API end that something comes between: another thread, the program's own function, a fault, a
//! limit of any length, targets of any size, and cycles of any length.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enable, enabled, follow, in_op, script};
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Guard, Homing, HomingPhase, Options, Slave};
use ecmsk::link::Link;
use ecmsk::sk::{CommandId, RawSlot};

fn one(axis: Axis) -> Config {
    Config { slaves: vec![Slave::Drive(axis)], ..Config::default() }
}

fn count(tap: &Tap, slot: usize, id: CommandId) -> usize {
    tap.take_slots(slot).iter().filter(|slot| slot.id == id.code()).count()
}

/// Homing that is aborted while its objects are written does not begin; the program's own function may do it.
#[test]
fn homing_that_is_aborted_while_it_is_prepared_does_not_begin() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    tap.take();
    let ended = ecm.home(1, &Homing::method(17), |progress| {
        if progress.phase == HomingPhase::Preparing {
            ecm.abort_homing().unwrap();
        }
    });
    assert_eq!(ended, Err(EcmError::HomingFailed { slave: 1, why: "it was aborted" }));
    assert_eq!(count(&tap, 1, CommandId::GoHome), 0);
    assert_eq!(ecm.sdo_read::<u8>(1, ObjectAddress::new(0x6060, 0)), Ok(8));
}

/// The program's own function is called without a lock: it may abort the homing, and use the board.
#[test]
fn progress_may_use_the_board() {
    let ecm = enabled("slaves=drive", &Config::drives(1));
    let mut moving = 0;
    let ended = ecm.home(1, &Homing::method(17), |progress| {
        assert!(ecm.snapshot().is_ok());
        moving += u32::from(progress.phase == HomingPhase::Moving);
        if moving == 20 {
            ecm.local_inputs().unwrap();
            ecm.abort_homing().unwrap();
        }
    });
    assert_eq!(ended, Err(EcmError::HomingFailed { slave: 1, why: "it was aborted" }));
}

/// A function that takes its time stops no stream of another thread, and that ends as it should.
#[test]
fn slow_progress_stops_no_stream() {
    let tap = Tap::open("slaves=drive*2");
    let options =
        Options { read_limit: Duration::from_millis(50), write_limit: Duration::from_millis(50), ..Options::default() };
    let ecm = enable(tap.ecm(options).unwrap(), &Config::drives(2));
    let (told, is_told) = mpsc::channel();
    let (streamed, has_streamed) = mpsc::channel::<()>();
    thread::scope(|scope| {
        let ecm = &ecm;
        let mut once = Some(told);
        let homing = scope.spawn(move || {
            ecm.home(1, &Homing::method(35), |_| {
                if let Some(told) = once.take() {
                    told.send(()).unwrap();
                    has_streamed.recv().ok();
                }
            })
        });
        is_told.recv().unwrap();
        let mut stream = ecm.stream(4).unwrap();
        follow(&mut stream, 2, 0, 10, 300);
        stream.finish().unwrap();
        streamed.send(()).unwrap();
        homing.join().unwrap().unwrap();
    });
    ecm.stream(4).unwrap().finish().unwrap();
}

/// SK-7.3 An axis that does not switch on in time is commanded off, and the error says so; axes that were on stay on.
/// After an alarm of one axis nothing is sent to the others.
#[test]
fn what_does_not_come_on_stays_off() {
    let file = script("ends-late", "at 1s jam 2 for 4s\nat 8s alarm 2 0x7500\n");
    let tap = Tap::open(&format!("slaves=drive*3&script={file}"));
    let options = Options { servo_limit: Duration::from_millis(500), ..Options::default() };
    let ecm = tap.ecm(options).unwrap();
    in_op(&ecm, &Config::drives(3));
    ecm.servo_on(&[1]).unwrap();
    tap.bend_slot(2, |_, slot| slot.parm = 0x0250);
    match ecm.servo_on(&[1, 2]) {
        Err(EcmError::Timeout { seen, .. }) => assert!(seen.contains("switched off again (SV_OFF)"), "{seen}"),
        other => panic!("{other:?}"),
    }
    tap.bend(|_, _| {});
    cycles(&ecm, 1000);
    let is_on = |slave| ecm.snapshot().unwrap().drive(slave).unwrap().statusword.is_enabled();
    assert!(is_on(1) && !is_on(2));
    while ecm.snapshot().unwrap().drive(2).unwrap().error_code == 0 {
        ecm.next_cycle(SECOND).unwrap();
    }
    assert!(matches!(ecm.servo_on(&[3, 2]), Err(EcmError::Alarm { slave: 2, .. })));
    cycles(&ecm, 1000);
    assert!(is_on(1) && !is_on(3));
}

/// `servo_on` and `clear_alarm` put nothing into the slot of an axis that is on: it contains a stream's next target.
#[test]
fn a_streaming_axis_keeps_its_slot() {
    let tap = Tap::open("slaves=drive*2");
    let ecm = tap.ecm(Options::default()).unwrap();
    in_op(&ecm, &Config::drives(2));
    ecm.servo_on(&[1]).unwrap();
    tap.take();
    let (ends, runs) = (AtomicBool::new(false), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut stream = ecm.stream(4).unwrap();
            let mut n = 0;
            while !ends.load(Ordering::Acquire) {
                n += 1;
                stream.csp(1, n).unwrap();
                stream.step().unwrap();
                runs.store(true, Ordering::Release);
            }
        });
        while !runs.load(Ordering::Acquire) {
            thread::yield_now();
        }
        ecm.servo_on(&[1, 2]).unwrap();
        ecm.clear_alarm(&[1, 2]).unwrap();
        ends.store(true, Ordering::Release);
    });
    let slots = tap.take_slots(1);
    assert!(slots.iter().all(|slot| slot.id == CommandId::Csp.code() || slot.id == 0), "{slots:?}");
    let mut targets = slots.iter().filter(|slot| slot.id == CommandId::Csp.code()).map(|slot| slot.data1 as i32);
    let first = targets.next().unwrap();
    assert!(
        targets.try_fold(first, |last, target| (target - last <= 1).then_some(target)).is_some(),
        "no step is double"
    );
}

/// A stream that does not step: snapshots and targets go by what the board reports now.
#[test]
fn a_stream_that_waits_sees_what_happens() {
    let file = script("ends-waits", "at 3s alarm 1 0x7500\n");
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive&script={file}"), &Config::drives(1));
    let mut stream = ecm.stream(4).unwrap();
    for _ in 0..100 {
        stream.csp(1, 0).unwrap();
        stream.step().unwrap();
    }
    tap.pass(5 * SECOND).unwrap();
    assert!(matches!(stream.csp(1, 10), Err(EcmError::Alarm { slave: 1, code: 0x7500 })));
    assert!(!ecm.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled());
    let seen = stream.snapshot().unwrap().meta.sequence;
    tap.pass(SECOND).unwrap();
    assert!(stream.snapshot().unwrap().meta.sequence > seen + 900);
}

/// Limits of any length are limits: nothing overflows, in any call.
#[test]
fn a_limit_of_any_length_does_not_overflow() {
    let endless = Options {
        read_limit: Duration::MAX,
        write_limit: Duration::MAX,
        state_limit: Duration::MAX,
        sdo_limit: Duration::MAX,
        servo_limit: Duration::MAX,
        ..Options::default()
    };
    for clock in ["virtual", "real"] {
        let uri = format!("sim:?slaves=drive&clock={clock}&name=ends-{clock}");
        let (ecm, _) = Ecm::open_when_there(&uri, endless, Duration::MAX).unwrap();
        let ecm = enable(ecm, &Config::drives(1));
        ecm.next_cycle(Duration::MAX).unwrap();
        ecm.home(1, &Homing { limit: Duration::MAX, ..Homing::method(35) }, |_| {}).unwrap();
        ecm.local_inputs().unwrap();
        ecm.sdo_read::<u8>(1, ObjectAddress::new(0x6060, 0)).unwrap();
        let mut stream = ecm.stream(4).unwrap();
        stream.csp(1, ecm.snapshot().unwrap().position(1).unwrap()).unwrap();
        stream.step().unwrap();
        stream.finish().unwrap();
        ecm.set_state_within(ecmsk::sk::MasterState::PreOp, Duration::MAX).unwrap();
        ecm.close(Close::Hold).unwrap();
    }
}

/// API-10 Two targets half the range apart: nothing overflows, and what is left of the way to the last one is not gone beyond it.
#[test]
fn targets_half_the_range_apart() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &one(Axis { guard: Guard::Off, ..Axis::CSP }));
    // A following error of any size is none.
    ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..10 {
        stream.csp(1, if n % 2 == 0 { 0 } else { i32::MIN }).unwrap();
        stream.step().unwrap();
    }
    tap.take();
    stream.finish().ok();
    let targets: Vec<i32> = tap.take_slots(1).iter().map(|slot| slot.data1 as i32).collect();
    assert!(
        !targets.is_empty() && targets.iter().all(|target| *target <= 0),
        "from where it is towards it: {targets:?}"
    );
}

/// API-10 A lost velocity has not been executed: its axis is at rest, and the ramp does not start it.
#[test]
fn a_velocity_that_never_arrived_is_not_ramped() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &one(Axis::CSV));
    let stood = ecm.snapshot().unwrap().position(1).unwrap();
    let velocities = |slots: Vec<RawSlot>| -> Vec<u32> {
        slots.iter().filter(|slot| slot.id == CommandId::Csv.code()).map(|slot| slot.data1).collect()
    };
    let mut stream = ecm.stream(4).unwrap();
    tap.lose(|frame| frame.slot(SIZE, 1).id == CommandId::Csv.code());
    for _ in 0..20 {
        stream.csv(1, 100_000).unwrap();
        stream.step().unwrap();
    }
    // All that was on its way has passed, and the board runs dry.
    cycles(&ecm, 50);
    tap.lose(|_| false);
    tap.take();
    stream.finish().unwrap();
    assert_eq!(ecm.next_cycle(SECOND).unwrap().position(1).unwrap(), stood);
    ecm.close(Close::Hold).unwrap();
    let sent = velocities(tap.take_slots(1));
    assert!(!sent.is_empty() && sent.iter().all(|velocity| *velocity == 0), "{sent:?}");
}

/// API-9 An encoder that flickers is no motion: closing ends, and the axis is off.
#[test]
fn a_flickering_encoder_does_not_keep_closing_from_ending() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    tap.bend_slot(1, |n, slot| slot.data1 = slot.data1.wrapping_add(if n % 3 == 0 { 6 } else { 0 }));
    cycles(&ecm, 5);
    ecm.close(Close::ServoOff).unwrap();
    assert!(count(&tap, 1, CommandId::ServoOff) > 0);
}

/// An axis that does not come to rest is switched off all the same, and the error says that it moved.
#[test]
fn an_axis_that_does_not_come_to_rest_is_switched_off() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    tap.bend_slot(1, |n, slot| slot.data1 = n as u32 * 1000);
    cycles(&ecm, 5);
    let closed = ecm.close(Close::ServoOff);
    assert!(matches!(closed, Err(EcmError::Timeout { what: "a standstill", .. })), "{closed:?}");
    assert!(count(&tap, 1, CommandId::ServoOff) > 0);
}

/// A stream whose frames ahead could not end within the limit of closing is refused, with what is allowed; at the
/// limit it ends. A ramp has several frames, however long the cycle.
#[test]
fn a_stream_is_no_deeper_than_closing_can_wait_for() {
    for cycle_us in [1000, 16_000, 32_000, 128_000, 256_000] {
        let (tap, ecm) = Tap::enabled("slaves=drive", &Config { cycle_us, ..one(Axis::CSV) });
        let deepest = match ecm.stream(150).map(drop) {
            Ok(()) => 150,
            Err(EcmError::TooDeep { found: 150, max, cycle }) => {
                assert_eq!(cycle, Duration::from_micros(cycle_us.into()));
                assert!(matches!(ecm.stream(max + 1).map(drop), Err(EcmError::TooDeep { .. })));
                max
            }
            Err(other) => panic!("{other}"),
        };
        assert_eq!(deepest == 150, cycle_us == 1000);
        let mut stream = ecm.stream(deepest).unwrap();
        for _ in 0..200 {
            stream.csv(1, 50_000).unwrap();
            stream.step().unwrap();
        }
        tap.take();
        stream.finish().unwrap_or_else(|error| panic!("{cycle_us} us: {error}"));
        let ramp = tap.take_slots(1);
        let least = if cycle_us < 256_000 { 4 } else { 2 };
        assert!(ramp.len() >= least && ramp.last().unwrap().data1 == 0, "{cycle_us} us: {} frames", ramp.len());
    }
}

/// API-9 A stream that cannot have the board when it ends is over all the same: the next one begins.
#[test]
fn a_stream_that_ended_is_over() {
    let tap = Tap::open("slaves=drive");
    let short = Duration::from_millis(20);
    let options = Options { read_limit: short, write_limit: short, ..Options::default() };
    let ecm = enable(tap.ecm(options).unwrap(), &Config::drives(1));
    let mut stream = ecm.stream(4).unwrap();
    stream.csp(1, 0).unwrap();
    stream.step().unwrap();
    let (told, is_told) = mpsc::channel();
    let (ended, has_ended) = mpsc::channel::<()>();
    let mut once = Some((told, has_ended));
    // A read that takes long, in another thread.
    tap.bend(move |_, _| {
        if let Some((told, has_ended)) = once.take() {
            told.send(()).unwrap();
            has_ended.recv().ok();
        }
    });
    thread::scope(|scope| {
        let reading = scope.spawn(|| ecm.next_cycle(SECOND).map(drop));
        is_told.recv().unwrap();
        assert!(matches!(stream.finish(), Err(EcmError::Busy { .. })));
        ended.send(()).unwrap();
        reading.join().unwrap().unwrap();
    });
    ecm.stream(4).unwrap().finish().unwrap();
}
