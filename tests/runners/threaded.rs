//! The runner of the real clock. No test here asserts durations, only that calls end.

use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use ecmsk::engine::{Board, EngineConfig, RealTime};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::engine::{EngineLink, Keeper, RunOptions};
use ecmsk::link::{Dir, Link, LinkError, Wait};
use ecmsk::sk::{CrcPolicy, CycleTime, DcShift, FIFO_ENTRIES, Frame, MasterCommand, MasterState, RawSlot, StateByte};
use ecmsk::slave::{Drive, DriveConfig};

use crate::client::{Client, MS, SIZE, board, open, open_kept, soft_reset, target};
use crate::slow::Hooked;
use support::heard::{lines_with, listen};

fn options() -> RunOptions {
    RunOptions { virtual_time: false, ..RunOptions::default() }
}

/// A write takes an hour, so that the second one waits.
fn slow_writes() -> RunOptions {
    RunOptions { host_ns: 3_600_000 * MS, ..options() }
}

/// Takes the board when the link is closed.
fn kept() -> (Keeper, Arc<Mutex<Option<Board>>>) {
    let place: Arc<Mutex<Option<Board>>> = Arc::default();
    let keep = Arc::clone(&place);
    (Box::new(move |board| *keep.lock().unwrap() = board), place)
}

/// Calls `end` until `call` has ended in its own thread, and returns its result.
fn ended_by<T: Send>(call: impl FnOnce() -> T + Send, end: impl Fn()) -> T {
    thread::scope(|scope| {
        let call = scope.spawn(call);
        while !call.is_finished() {
            end();
            thread::sleep(Duration::from_millis(1));
        }
        call.join().unwrap()
    })
}

/// SK-9.8 Reports arrive by themselves, complete and one per cycle; SK-9.9 in OP one each EtherCAT cycle.
#[test]
fn one_whole_report_arrives_per_cycle() {
    let (mut client, _) = open(2, options());
    let first = client.read();
    assert_eq!(client.answer().state, StateByte::reached(MasterState::PreOp));
    client.master(MasterCommand::SetDc { cycle: CycleTime::from_us(250).unwrap(), shift: DcShift::Auto });
    client.op();
    let mut last = client.read();
    for _ in 0..400 {
        let next = client.read();
        let reports = next.sequence - last.sequence;
        assert!(reports >= 1 && next.sequence > first.sequence);
        assert_eq!(next.at.0 - last.at.0, reports * 250_000, "on the board's clock each cycle has its report");
        assert!(client.report.check_crc(SIZE, CrcPolicy::Strict).is_ok());
        last = next;
    }
    let stats = client.link.stats();
    assert_eq!(stats.read + last.dropped, last.sequence + 1, "each was read or counted as dropped");
}

/// SK-9.10 The pace of writes loses no frame: each is executed or, where the FIFO was full, counted.
/// LIB-23 A tight writer on the real clock fills the FIFO too.
#[test]
fn paced_writes_lose_no_frame() {
    let (keeper, place) = kept();
    let (mut client, _) = open_kept(1, options(), Some(keeper));
    client.op();
    let before = client.link.stats().written;
    let mut last = 0;
    for n in 0..2000 {
        let at = client.link.write(&target(n, n as u8), Wait::Forever).unwrap();
        assert!(at.0 >= last, "arrivals in order");
        last = at.0;
    }
    assert_eq!(client.link.stats().written, before + 2000);
    client.until("an empty FIFO", |client| client.answer().fifo_free == FIFO_ENTRIES);
    let full_count = client.answer().full_count;
    client.link.close();
    let counters = *place.lock().unwrap().as_ref().unwrap().engine().counters();
    assert_eq!(counters.frames, before + 2000);
    assert_eq!(counters.executed + counters.full, 2000, "{counters:?}");
    assert_eq!(u64::from(full_count), counters.full);
}

/// SK-4.44 A frame whose write has succeeded has arrived, also when the link is closed right after it.
#[test]
fn closing_loses_no_frame() {
    for burst in [1, 2, 30] {
        for _ in 0..20 {
            let (keeper, place) = kept();
            let (client, _) = open_kept(1, RunOptions { host_ns: 0, ..options() }, Some(keeper));
            (0..burst).for_each(|_| client.write(&Frame::new()));
            client.link.close();
            let board = place.lock().unwrap().take().expect("the board comes back");
            assert_eq!(board.engine().counters().frames, burst);
            assert_eq!(client.link.stats().board.unwrap().frames, burst);
        }
    }
}

/// LIB-48 Closing from another thread ends a blocked read; LIB-35 until then it waits without a limit.
#[test]
fn close_ends_a_blocked_read() {
    let (mut client, network) = open(1, options());
    client.op();
    network.cut_after(0);
    let link = client.link;
    let (started, has_started) = channel();
    thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let mut report = Frame::new();
            started.send(()).unwrap();
            loop {
                if let Err(ended) = link.read(&mut report, Wait::Forever) {
                    return ended;
                }
            }
        });
        has_started.recv().unwrap();
        thread::sleep(Duration::from_millis(20));
        link.close();
        assert_eq!(reader.join().unwrap(), LinkError::Closed);
    });
}

/// LIB-38 A write that has to wait ends after its limit; cancelling ends it too, and so does closing.
#[test]
fn a_blocked_write_ends() {
    let (client, _) = open(1, slow_writes());
    let (link, frame) = (&client.link, Frame::new());
    client.write(&frame);
    let limit = Duration::from_millis(5);
    let timed_out = link.write(&frame, Wait::For(limit)).unwrap_err();
    assert!(
        matches!(timed_out, LinkError::Timeout { dir: Dir::Write, waited, .. } if waited == limit),
        "{timed_out:?}"
    );
    assert!(matches!(link.write(&frame, Wait::Now), Err(LinkError::Timeout { .. })));
    let cancelled = ended_by(|| link.write(&frame, Wait::Forever), || link.cancel(Dir::Write));
    assert_eq!(cancelled, Err(LinkError::Cancelled { dir: Dir::Write }));
    let closed = ended_by(|| link.write(&frame, Wait::Forever), || link.close());
    assert_eq!(closed, Err(LinkError::Closed));
    let stats = link.stats();
    assert_eq!((stats.written, stats.write_errors, stats.board.unwrap().frames), (1, 4, 1));
}

/// Consecutive writes that may not wait at all succeed at the usual pace.
#[test]
fn writes_that_may_not_wait_succeed_at_the_usual_pace() {
    let (client, _) = open(1, options());
    for n in 0..500 {
        assert!(client.link.write(&Frame::new(), Wait::Now).is_ok(), "write {n}");
    }
}

/// Cancelling ends the waiting read; later reads are not affected.
#[test]
fn cancel_ends_a_blocked_read() {
    let (mut client, network) = open(1, options());
    client.op();
    network.cut_after(0);
    let link = &client.link;
    let read = || {
        let mut report = Frame::new();
        loop {
            // Reports made before the cut come first.
            if let Err(ended) = link.read(&mut report, Wait::Forever) {
                return ended;
            }
        }
    };
    for _ in 0..3 {
        assert_eq!(ended_by(read, || link.cancel(Dir::Read)), LinkError::Cancelled { dir: Dir::Read });
    }
    link.cancel(Dir::Write);
    network.heal();
    let mut client = client;
    client.read();
}

/// LIB-36 On a silent bus a read ends after its limit, and reports come again when the cable is repaired. It leaves the
/// buffer unchanged.
#[test]
fn a_read_ends_after_its_limit() {
    let (mut client, network) = open(1, options());
    client.op();
    network.cut_after(0);
    let limit = Duration::from_millis(30);
    let ended = loop {
        let before = client.report.clone();
        if let Err(ended) = client.try_read(Wait::For(limit)) {
            assert_eq!(client.report, before);
            break ended;
        }
    };
    assert!(matches!(ended, LinkError::Timeout { dir: Dir::Read, waited, .. } if waited == limit), "{ended:?}");
    assert!(matches!(client.try_read(Wait::Now), Err(LinkError::Timeout { .. })));
    network.heal();
    client.try_read(Wait::For(Duration::MAX)).unwrap();
    client.link.write(&Frame::new(), Wait::For(Duration::MAX)).unwrap();
}

/// SK-4.34 SW_RESET drops the connection. LIB-35 A reader that waits ends then. LIB-49 It stays lost although the board
/// has booted.
#[test]
fn a_reset_board_is_lost() {
    let (keeper, place) = kept();
    let (mut client, network) = open_kept(1, options(), Some(keeper));
    let link = Arc::clone(&client.link);
    client.op();
    network.cut_after(0);
    let reader = thread::spawn(move || {
        let ended = loop {
            if let Err(ended) = client.try_read(Wait::Forever) {
                break ended;
            }
        };
        (client, ended)
    });
    link.write(&soft_reset(), Wait::Forever).unwrap();
    let (mut client, ended) = reader.join().unwrap();
    assert!(matches!(ended, LinkError::Lost { .. }), "{ended:?}");
    network.heal();
    for _ in 0..500 {
        assert!(matches!(client.try_read(Wait::Forever), Err(LinkError::Lost { .. })));
        assert!(matches!(link.write(&Frame::new(), Wait::Forever), Err(LinkError::Lost { .. })));
        assert!(matches!(link.check(), Err(LinkError::Lost { .. })));
        thread::sleep(Duration::from_millis(1));
    }
    link.close();
    let mut board = place.lock().unwrap().take().expect("the board comes back");
    assert!(board.boot(60_000 * MS));
    let mut again = Client::on(Arc::new(EngineLink::open("again", board, options(), None).unwrap()));
    again.read();
    assert_eq!(again.answer().state, StateByte::reached(MasterState::PreOp));
}

/// Dropping a link ends its thread and returns the board, also in the longest cycle and on a silent bus.
#[test]
fn dropping_gives_the_board_back() {
    let (keeper, place) = kept();
    let (mut client, network) = open_kept(1, options(), Some(keeper));
    client.master(MasterCommand::SetDc { cycle: CycleTime::from_us(512_000).unwrap(), shift: DcShift::Auto });
    client.op();
    network.cut_after(0);
    let link = Arc::clone(&client.link);
    let reader = thread::spawn(move || {
        let mut report = Frame::new();
        while link.read(&mut report, Wait::For(Duration::from_millis(10))).is_ok() {}
        // The last owner of the link drops it.
    });
    drop(client);
    reader.join().unwrap();
    assert!(place.lock().unwrap().is_some());
}

/// LIB-35 No call waits for a board whose thread has ended.
#[test]
fn a_dead_runner_ends_the_waits() {
    let mut cycles_left = 2000_u32;
    let breaks = move || cycles_left = cycles_left.checked_sub(1).expect("this bus breaks now");
    let bus = Hooked(SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]), breaks);
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.boot(2000 * MS));
    let mut client = Client::on(Arc::new(EngineLink::open("broken", board, options(), None).unwrap()));
    let ended = loop {
        if let Err(ended) = client.try_read(Wait::Forever) {
            break ended;
        }
    };
    assert_eq!(ended, LinkError::Closed);
    assert_eq!(client.link.write(&Frame::new(), Wait::Forever), Err(LinkError::Closed));
}

/// Settings that the system refuses are warnings: the board runs all the same.
#[test]
fn a_refused_real_time_priority_is_a_warning() {
    let _turn = listen();
    // No system has priority 200.
    let real_time = RealTime { priority: Some(200), cpu: None, lock_memory: false };
    let (board, _) = board(1);
    let link = EngineLink::open("wishes", board, RunOptions { real_time, ..options() }, None).unwrap();
    let mut report = Frame::new();
    for n in 0..20 {
        assert!(link.read(&mut report, Wait::Forever).unwrap().sequence >= n);
    }
    link.close();
    let late = link.lateness().expect("on the real clock");
    assert!(late.cycles >= 20, "{late:?}");
    let told = lines_with(&["a priority of 200", "refused", "ulimit -r 200"]);
    assert!(!told.is_empty(), "{:?}", lines_with(&[]));
}

/// SK-4.39 A rejection is logged with its reason, from the host's calls, on either clock.
#[test]
fn rejections_are_logged() {
    let _turn = listen();
    for (id, virtual_time) in [(0x71, true), (0x72, false)] {
        let (mut client, _) = open(1, RunOptions { virtual_time, ..options() });
        let mut frame = Frame::new();
        frame.put(SIZE, 3, &RawSlot { id, ..RawSlot::ZERO });
        client.write(&frame);
        let id = format!("0x{id:02X}");
        let reads = (0..2000).find(|_| {
            client.read();
            !lines_with(&[&id, "slot 3", "no such command"]).is_empty()
        });
        assert!(reads.is_some(), "{id}: {:?}", lines_with(&[]));
    }
}
