//! The native API and the board itself: CRC switches, FIFO, reset and the board's return.

use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enable, follow, in_op, open, script, steps, uri};
use ecmsk::ecm::{Config, CrcSwitches, Ecm, EcmError, Options};
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{CommandId, Frame, MasterState, RawSlot, StateByte};

const MINUTE: Duration = Duration::from_secs(60);

fn again(uri: &str) -> (Ecm, Duration) {
    Ecm::open_when_there(uri, Options::default(), MINUTE).unwrap()
}

/// SK-4.43 SK-4.44 After a reset the board is in PreOP again and knows nothing of its configuration; opening takes
/// as long as the board boots, of its own time.
#[test]
fn a_reset_board_comes_back() {
    for keys in ["slaves=drive*2&name=reset", "slaves=drive*2&name=reset-15&fw=1.5&slot=16"] {
        let ecm = enable(open(keys), &Config::drives(2));
        let uri = ecm.link_info().name.clone();
        let mut stream = ecm.stream(16).unwrap();
        follow(&mut stream, 1, 0, 50, 100);
        drop(stream);
        ecm.reset().unwrap();
        let (ecm, took) = again(&uri);
        assert!(took >= Duration::from_millis(50) && took < Duration::from_secs(20), "{took:?}");
        assert_eq!(ecm.state().unwrap(), StateByte::reached(MasterState::PreOp));
        assert!(matches!(ecm.servo_on(&[1]), Err(EcmError::WrongState { .. })));
        enable(ecm, &Config::drives(2));
    }
}

/// API-9 An axis that moves is ramped to a standstill before the board is reset.
#[test]
fn a_moving_axis_is_stopped_before_the_board_is_reset() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config { slaves: vec![csv()], ..Config::default() });
    let mut stream = ecm.stream(16).unwrap();
    stream.csv(1, 50_000).unwrap();
    steps(&mut stream, 300);
    std::mem::forget(stream);
    tap.take();
    ecm.reset().unwrap();
    let frames = tap.take();
    let speeds: Vec<u32> = frames.iter().map(|frame| frame.slot(SIZE, 1).data1).collect();
    assert!(frames.len() > 200, "{}", frames.len());
    assert_eq!(frames.last().unwrap().slot(SIZE, 0).id, CommandId::SoftReset.code());
    let ramp = &speeds[..speeds.len() - 1];
    assert!(ramp.windows(2).all(|pair| pair[1] <= pair[0]), "{ramp:?}");
    assert_eq!(*ramp.last().unwrap(), 0);
}

fn csv() -> ecmsk::ecm::Slave {
    ecmsk::ecm::Slave::Drive(ecmsk::ecm::Axis::CSV)
}

/// API-17 A board that another program resets is lost to this one, in every call, and another one opens it.
#[test]
fn a_board_that_was_reset_by_others_stays_lost() {
    let (tap, ecm) = Tap::enabled("slaves=drive&name=foreign-reset", &Config::drives(1));
    let mut frame = Frame::new();
    frame.put_master(SIZE, &ecmsk::sk::MasterCommand::SoftReset);
    tap.write(&frame, Wait::Now).unwrap();
    for _ in 0..2 {
        let error = ecm.next_cycle(SECOND).unwrap_err();
        assert!(matches!(error, EcmError::Link(LinkError::Lost { .. })), "{error}");
        assert!(error.to_string().ends_with("open it again"), "{error}");
    }
    drop(ecm);
    drop(tap);
    assert!(again(&uri("slaves=drive&name=foreign-reset")).0.state().is_ok());
}

/// A hopeless wait ends at once, and another one after its limit.
#[test]
fn waiting_for_a_board_that_does_not_come() {
    let wrong = Ecm::open_when_there("sim:?slaves=lathe", Options::default(), MINUTE).map(|_| ());
    assert!(matches!(wrong, Err(EcmError::Link(LinkError::Uri(_)))), "{wrong:?}");
    let held = open("slaves=drive&name=held");
    let in_use = Ecm::open_when_there(&uri("slaves=drive&name=held"), Options::default(), MINUTE).map(|_| ());
    assert!(matches!(in_use, Err(EcmError::Link(LinkError::InUse { .. }))), "{in_use:?}");
    drop(held);
    let limit = Duration::from_secs(2);
    let none = Ecm::open_when_there(&uri("slaves=none&name=empty"), Options::default(), limit).map(|_| ());
    let Err(EcmError::Timeout { what: "the board's return", waited, seen, .. }) = none else { panic!("{none:?}") };
    assert!(waited >= limit && seen.contains("it finds no slave"), "{waited:?} {seen}");
}

/// SK-1.15 SK-1.16 The switches act from the next boot on, not before: then a wrong frame is counted.
#[test]
fn crc_switches_act_after_a_boot() {
    let keys = "slaves=drive&name=switches";
    let tap = Tap::open(keys);
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.set_crc(CrcSwitches { check_commands: true, fill_responses: false }).unwrap();
    assert_ne!(ecm.next_cycle(SECOND).unwrap().frame().crc_byte(), 0, "not yet");
    tap.write(&Frame::new(), Wait::Now).unwrap();
    assert_eq!(tap.stats().board.unwrap().crc, 0, "not yet");
    ecm.reset().unwrap();
    drop(tap);
    let (ecm, _) = again(&uri(keys));
    assert_eq!(ecm.next_cycle(SECOND).unwrap().frame().crc_byte(), 0, "reports carry none");
    in_op(&ecm, &Config::drives(1));
    assert!(matches!(
        ecm.set_crc(CrcSwitches { check_commands: false, fill_responses: true }),
        Err(EcmError::WrongState { what: "set_crc", .. })
    ));
    drop(ecm);
    let tap = Tap::open(keys);
    tap.write(&Frame::new(), Wait::Now).unwrap();
    assert_eq!(tap.stats().board.unwrap().crc, 1, "the board checks");
    drop(tap);
    let strict = Options { strict_crc: true, ..Options::default() };
    let tap = Tap::open("slaves=drive");
    let ecm = tap.ecm(strict).unwrap();
    tap.take();
    let refused = ecm.set_crc(CrcSwitches { check_commands: false, fill_responses: false });
    assert!(matches!(refused, Err(EcmError::Setting { .. })), "{refused:?}");
    assert!(tap.take().is_empty());
}

/// SK-5.18 SK-5.22 A cleared FIFO is empty: its entries are never executed, and the axis stays at its position. The
/// stream has ended, since its next targets would begin elsewhere.
#[test]
fn a_cleared_fifo_stops_the_axis() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    let mut stream = ecm.stream(150).unwrap();
    follow(&mut stream, 1, 0, 20, 400);
    let before = tap.stats().board.unwrap().cleared;
    let at = ecm.next_cycle(SECOND).unwrap().position(1).unwrap();
    tap.take();
    ecm.clear_fifo().unwrap();
    assert!(tap.stats().board.unwrap().cleared - before > 140);
    assert!(
        tap.take().iter().all(|frame| RawSlot { index: 0, ..frame.slot(SIZE, 1) }.is_zero()),
        "the newest target would be a jump"
    );
    cycles(&ecm, 200);
    let snapshot = ecm.snapshot().unwrap();
    assert_eq!(snapshot.board.fifo_free, 160);
    let way = snapshot.position(1).unwrap() - at;
    assert!((0..400).contains(&way), "{way} counts, not the 3000 that were ahead");

    assert_eq!(stream.csp(1, 8000), Err(EcmError::Cleared));
    assert_eq!(stream.step(), Err(EcmError::Cleared));
    assert_eq!(stream.finish().unwrap().losses, 0);
    let start = ecm.snapshot().unwrap().position(1).unwrap();
    let mut stream = ecm.stream(20).unwrap();
    stream.csp(1, start + 10).unwrap();
    stream.step().unwrap();
}

/// API-15 Cleared by another thread: the stream ends with its next call, and no target has gone out with the clear.
#[test]
fn a_fifo_that_another_thread_clears() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    std::thread::scope(|scope| {
        let (begun, has_begun) = std::sync::mpsc::channel();
        let ecm = &ecm;
        let streaming = scope.spawn(move || {
            let mut stream = ecm.stream(100).unwrap();
            for n in 0.. {
                if let Err(error) = stream.csp(1, n * 20).and_then(|()| stream.step()) {
                    return error;
                }
                if n == 200 {
                    begun.send(()).unwrap();
                }
            }
            unreachable!("it has no end by itself")
        });
        has_begun.recv().unwrap();
        ecm.clear_fifo().unwrap();
        assert_eq!(streaming.join().unwrap(), EcmError::Cleared);
    });
    let frames = tap.take();
    let clear = frames.iter().position(|frame| frame.slot(SIZE, 0).id == CommandId::SetFifo.code()).unwrap();
    assert!(frames[clear..].iter().all(|frame| RawSlot { index: 0, ..frame.slot(SIZE, 1) }.is_zero()));
}

/// Dropped entries are no underruns, and hide none of a later stream.
#[test]
fn underruns_after_a_clear_count() {
    let (tap, ecm) = Tap::enabled("slaves=drive&queue=64", &Config::drives(1));
    let mut cleared = ecm.stream(100).unwrap();
    (0..200).for_each(|_| cleared.step().map(drop).unwrap());
    ecm.clear_fifo().unwrap();
    assert_eq!(cleared.stats().unwrap().underruns, 0);
    drop(cleared);
    let mut stream = ecm.stream(100).unwrap();
    (0..300).for_each(|_| stream.step().map(drop).unwrap());
    assert_eq!(stream.stats().unwrap().underruns, 0);
    let entries = u64::from(160 - stream.snapshot().unwrap().board.fifo_free);
    tap.pass(Duration::from_millis(entries + 30)).unwrap();
    (0..50).for_each(|_| stream.step().map(drop).unwrap());
    let gaps = stream.stats().unwrap().underruns;
    assert!(gaps.abs_diff(30) <= 1, "{gaps} gaps");
}

/// SK-5.12 SK-5.13 A stream with a prefill begins when that many frames are there: no axis moves before, no
/// gap comes after though the program is late, and waiting is no underrun.
#[test]
fn a_prefilled_stream_begins_with_its_reserve() {
    // With room for one report a late program does not see every cycle.
    for keys in ["slaves=drive", "slaves=drive&fw=1.5&slot=16", "slaves=drive&queue=1"] {
        let (tap, ecm) = Tap::enabled(keys, &Config::drives(1));
        let start = ecm.snapshot().unwrap().position(1).unwrap();
        let mut stream = ecm.stream(50).unwrap();
        assert!(matches!(stream.prefill(51), Err(EcmError::Setting { .. })));
        assert!(matches!(stream.prefill(1), Err(EcmError::Setting { .. })));
        stream.prefill(50).unwrap();
        for n in 0..49 {
            stream.csp(1, start + n * 20).unwrap();
            stream.step().unwrap();
            tap.pass(Duration::from_millis(3)).unwrap();
        }
        let waiting = ecm.next_cycle(SECOND).unwrap();
        assert_eq!((waiting.board.fifo_free, waiting.position(1)), (111, Some(start)), "{keys}");
        for n in 49..300 {
            stream.csp(1, start + n * 20).unwrap();
            stream.step().unwrap();
            if n % 60 == 0 {
                tap.pass(Duration::from_millis(40)).unwrap();
            }
        }
        assert!(matches!(stream.prefill(10), Err(EcmError::Setting { .. })), "it runs already");
        let stats = stream.finish().unwrap();
        assert_eq!((stats.underruns, stats.losses), (0, 0), "{keys}");
    }
}

/// API-9 A stream that ends while the board still collects drops what is there: no axis moves.
#[test]
fn a_prefill_that_is_not_reached_is_dropped() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    let start = ecm.snapshot().unwrap().position(1).unwrap();
    let mut stream = ecm.stream(50).unwrap();
    stream.prefill(20).unwrap();
    follow(&mut stream, 1, start, 100, 10);
    stream.finish().unwrap();
    cycles(&ecm, 100);
    assert_eq!(ecm.snapshot().unwrap().position(1).unwrap(), start);
    assert_eq!(tap.stats().board.unwrap().cleared, 10);
    // The threshold is gone too: a call's one frame is executed.
    ecm.servo_off(&[1]).unwrap();
}

/// A reset that the board does not hear ends with its limit.
#[test]
fn a_reset_that_is_not_heard() {
    let file = script("board-deaf", "at 1s silent\n");
    let ecm = open(&format!("slaves=drive&script={file}"));
    while ecm.next_cycle(SECOND).is_ok() {}
    // It is reset while no reports are read: the link reports the reset.
    ecm.reset().unwrap();
    let ecm = Ecm::open("sim:?slaves=drive&clock=virtual&fault.drop.write=1").unwrap();
    let error = ecm.reset().unwrap_err();
    assert!(matches!(error, EcmError::Timeout { what: "SW_RESET", .. }), "{error}");
}
