//! The native API in several threads: turns, a stream whose thread sleeps, ends caused by other threads.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enabled, follow, script};
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Config, Ecm, EcmError, Options, Slave};
use ecmsk::link::{self, Link, LinkError, Share};
use ecmsk::sk::{CommandId, MasterState};

const WINDOW: ObjectAddress = ObjectAddress::new(0x6065, 0);

type Call = fn(&Ecm) -> Result<(), EcmError>;

fn mixed() -> Config {
    Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSP), Slave::Io, Slave::Io], ..Config::default() }
}

/// API-15 Four threads at once, each with calls of its own kind: every answer is the right one, and nothing is rejected.
#[test]
fn each_thread_gets_its_own_answers() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2,io*2", &mixed());
    std::thread::scope(|scope| {
        for slave in [1, 2] {
            let ecm = &ecm;
            scope.spawn(move || {
                for n in 0..40 {
                    let value = 1000 * u32::from(slave) + n;
                    ecm.sdo_write(slave, WINDOW, value).unwrap();
                    assert_eq!(ecm.sdo_read::<u32>(slave, WINDOW).unwrap(), value);
                }
            });
        }
        for slave in [3, 4] {
            let ecm = &ecm;
            scope.spawn(move || {
                for n in 0..40 {
                    let bits = u16::from(slave) << 8 | n;
                    ecm.set_outputs(slave, bits).unwrap();
                    cycles(ecm, 3);
                    assert_eq!(ecm.inputs(slave).unwrap(), bits);
                }
            });
        }
    });
    let board = tap.stats().board.unwrap();
    assert_eq!((board.rejected_total(), board.full), (0, 0));
}

/// API-15 A stream and an SDO loop in two threads: the axis follows its targets without a gap, and each value is read
/// back.
#[test]
fn one_streams_and_one_reads() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2,io*2", &mixed());
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            for n in 0..30_u32 {
                ecm.sdo_write(2, WINDOW, 5000 + n).unwrap();
                assert_eq!(ecm.sdo_read::<u32>(2, WINDOW).unwrap(), 5000 + n);
            }
            over.store(true, Ordering::Release);
        });
        let mut stream = ecm.stream(16).unwrap();
        let mut target = 0;
        while !over.load(Ordering::Acquire) && !reader.is_finished() {
            target += 5;
            stream.csp(1, target).unwrap();
            stream.step().unwrap();
            std::thread::yield_now();
        }
        let stats = stream.finish().unwrap();
        assert_eq!(stats.losses, 0);
        let position = ecm.snapshot().unwrap().position(1).unwrap();
        assert!(position >= target && position - target < 2000, "{position} after {target}");
    });
    assert_eq!(tap.stats().board.unwrap().rejected_total(), 0);
}

/// API-15 While a stream's thread sleeps, calls of others write themselves: their frames repeat the stream's targets.
#[test]
fn a_stream_that_sleeps_holds_nobody_up() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2,io*2", &mixed());
    let mut stream = ecm.stream(16).unwrap();
    follow(&mut stream, 1, 0, 10, 50);
    tap.take();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            assert!(ecm.sdo_read::<u32>(1, WINDOW).unwrap() > 0);
            ecm.set_outputs(3, 7).unwrap();
            assert!(matches!(ecm.stream(4).map(|_| ()), Err(EcmError::Busy { what: "the stream" })));
        });
    });
    let slots = tap.take_slots(1);
    assert!(!slots.is_empty() && slots.iter().all(|slot| (slot.id, slot.data1) == (CommandId::Csp.code(), 490)));
    stream.csp(1, 500).unwrap();
    stream.step().unwrap();
    drop(stream);
    // The next one may be another thread's.
    std::thread::scope(|scope| {
        scope.spawn(|| ecm.stream(4).unwrap().finish().unwrap());
    });
}

/// A link that is closed in one thread ends all waits in others at once: a report, a state, an SDO.
#[test]
fn closing_ends_what_waits() {
    let file = script("threads-silent", "at 600ms silent\n");
    let waits: [Call; 3] = [
        |ecm| ecm.next_cycle(Duration::from_secs(3600)).map(drop),
        |ecm| ecm.set_state_within(MasterState::PreOp, Duration::from_secs(3600)),
        |ecm| ecm.sdo_read::<u32>(1, WINDOW).map(drop),
    ];
    for wait in waits {
        let link = link::open(&format!("sim:?clock=real&slaves=drive&script={file}"), Share::ByName).unwrap();
        let hour = Duration::from_secs(3600);
        let options = Options { read_limit: hour, sdo_limit: hour, ..Options::default() };
        let ecm = Ecm::over(link.clone(), options).unwrap();
        let (silent, is_silent) = mpsc::channel();
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| {
                // The time of the script, by the board's own clock.
                while ecm.next_cycle(hour).unwrap().meta.at.0 < link.info().opened_at.0 + 590_000_000 {}
                silent.send(()).unwrap();
                loop {
                    if let Err(error) = wait(&ecm) {
                        break error;
                    }
                }
            });
            is_silent.recv().unwrap();
            std::thread::sleep(Duration::from_millis(50));
            link.close();
            let error = waiting.join().unwrap();
            assert_eq!(error, EcmError::Link(LinkError::Closed));
        });
        assert!(ecm.next_cycle(SECOND).is_err());
    }
}

/// SK-4.50 A network that one thread takes out of OP ends the other's stream, with the state that it found.
#[test]
fn leaving_op_ends_the_stream_of_another_thread() {
    let ecm = enabled("slaves=drive", &Config::drives(1));
    std::thread::scope(|scope| {
        let (begun, has_begun) = mpsc::channel();
        let ecm = &ecm;
        let streaming = scope.spawn(move || {
            let mut stream = ecm.stream(8).unwrap();
            loop {
                if let Err(error) = stream.step() {
                    break error;
                }
                begun.send(()).ok();
            }
        });
        has_begun.recv().unwrap();
        ecm.set_state(MasterState::SafeOp).unwrap();
        let error = streaming.join().unwrap();
        assert!(matches!(error, EcmError::WrongState { what: "a stream", .. }), "{error}");
    });
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1]).unwrap();
}

/// API-15 A snapshot in any thread is one whole report, never parts of two.
#[test]
fn a_snapshot_is_of_one_cycle() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2,io*2", &mixed());
    // Both axes show the number of the report.
    tap.bend(|n, frame| {
        for slot in [1, 2] {
            let mut raw = frame.slot(SIZE, slot);
            raw.data1 = n as u32;
            frame.put(SIZE, slot, &raw);
        }
        frame.fill_crc(SIZE);
    });
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let mut last = 0;
                for _ in 0..300 {
                    ecm.next_cycle(SECOND).unwrap();
                    let snapshot = ecm.snapshot().unwrap();
                    assert_eq!(snapshot.position(1), snapshot.position(2));
                    assert!(snapshot.meta.sequence >= last);
                    last = snapshot.meta.sequence;
                }
            });
        }
    });
}
