//! The runner of the real clock on a machine that stalls for a while, or is too slow for its cycles. No test here
//! asserts durations, only progress.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{CycleDone, Fieldbus, Inputs, Ns};
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{FIFO_ENTRIES, Frame};
use ecmsk::slave::{Drive, DriveConfig};

use crate::client::{Client, MS, PATIENCE, target};
use support::hand_on;

/// A bus that calls the test's hook at the beginning of every cycle.
pub struct Hooked<F>(pub SimBus, pub F);

impl<F: FnMut() + Send> Fieldbus for Hooked<F> {
    hand_on!(0: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        (self.1)();
        self.0.poll(now, inputs)
    }
}

/// A link to a board with one drive that has booted; from then on `hook` is called with the number of each cycle.
fn open(mut hook: impl FnMut(u64) + Send + 'static) -> (Client, Arc<EngineLink>) {
    let bus = SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]);
    let (booted, has_booted) = std::sync::mpsc::channel();
    let mut cycle = None;
    let hooked = Hooked(bus, move || {
        if let Some(cycle) = &mut cycle {
            *cycle += 1;
            hook(*cycle);
        } else if has_booted.try_recv().is_ok() {
            cycle = Some(0);
        }
    });
    let mut board = Board::new(EngineConfig::default(), Box::new(hooked));
    assert!(board.boot(60_000 * MS));
    booted.send(()).expect("the bus waits for it");
    let options = RunOptions { virtual_time: false, ..RunOptions::default() };
    let link = Arc::new(EngineLink::open("slow", board, options, None).expect("opens"));
    (Client::on(Arc::clone(&link) as Arc<dyn Link>), link)
}

/// SK-9.8 A host that was suspended, or stopped in a debugger, for longer than its board catches up goes on afterwards:
/// reports come, and frames are executed. The gap is left out and counted.
#[test]
fn a_host_that_was_away_goes_on() {
    let (mut client, link) = open(|cycle| {
        if matches!(cycle, 20 | 3000) {
            sleep(Duration::from_millis(1500));
        }
    });
    let mut last = None;
    while link.lateness().expect("on the real clock").skipped_ns < 1_000_000_000 {
        last = Some(client.try_read(PATIENCE).expect("a report after the gap"));
    }
    for _ in 0..100 {
        let report = client.try_read(PATIENCE).expect("reports go on");
        let before = last.replace(report).expect("there was one before");
        let reports = report.sequence - before.sequence;
        assert_eq!(report.at.0 - before.at.0, reports * MS, "the board's time has no gap");
    }
    client.op();
    let at = client.link.write(&target(1, 1), Wait::Forever).expect("is taken");
    let executed = loop {
        let report = client.try_read(PATIENCE).expect("reports go on");
        if client.slot(1).index == 1 {
            break report;
        }
    };
    assert!(executed.at >= at, "nothing is executed before it arrives: {executed:?}, {at:?}");
    client.until("an empty FIFO", |client| client.answer().fifo_free == FIFO_ENTRIES);
    client.link.close();
    assert_eq!(client.link.stats().board.expect("a simulated board").executed, 1);
}

/// Writes during a stall of the board's thread get time stamps within the gap that the board then leaves out. Later
/// writes get the board's own time again, and not that of the gap.
#[test]
fn a_write_in_a_gap_does_not_move_the_times_of_later_ones() {
    const GAP: Duration = Duration::from_millis(1500);
    let away = Arc::new(AtomicBool::new(false));
    let (gone, is_gone) = std::sync::mpsc::channel();
    let (mut client, link) = open({
        let away = Arc::clone(&away);
        move |_| {
            if away.swap(false, Ordering::AcqRel) {
                gone.send(()).expect("the host waits for it");
                sleep(GAP);
            }
        }
    });
    client.op();
    away.store(true, Ordering::Release);
    is_gone.recv().expect("the next cycle");
    sleep(GAP / 2);
    client.write(&target(1, 1));
    while link.lateness().expect("on the real clock").skipped_ns < 1_000_000_000 {
        client.try_read(PATIENCE).expect("a report after the gap");
    }
    let told = client.link.write(&target(2, 2), Wait::Forever).expect("is taken");
    let executed = loop {
        let report = client.try_read(PATIENCE).expect("reports go on");
        if client.slot(1).index == 2 {
            break report;
        }
    };
    assert!(executed.at >= told, "told {told:?}, executed {:?}", executed.at);
}

/// The future gaps.
type Gaps = Arc<Mutex<VecDeque<Duration>>>;

/// The machine stalls for as long as the test requires.
#[derive(Default)]
struct Hold {
    wanted: AtomicBool,
    is_away: AtomicBool,
}

/// A bus whose cycles are not caught up, on a machine that stalls for a while before some of them.
struct Away {
    bus: SimBus,
    /// The stalls of the machine before the next cycles, in order.
    gaps: Gaps,
    hold: Arc<Hold>,
    /// The number of cycles since the runner last read the clock, and its maximum.
    in_a_row: u32,
    most_in_a_row: Arc<AtomicU32>,
}

impl Fieldbus for Away {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.in_a_row += 1;
        self.most_in_a_row.fetch_max(self.in_a_row, Ordering::Relaxed);
        self.bus.poll(now, inputs)
    }

    fn work_until(&mut self, _now: Ns, _until: Ns) {
        self.in_a_row = 0;
        let gap = self.gaps.lock().expect("no panic").pop_front();
        gap.into_iter().for_each(sleep);
        while self.hold.wanted.load(Ordering::Acquire) {
            self.hold.is_away.store(true, Ordering::Release);
            sleep(Duration::from_millis(1));
        }
    }

    fn catches_up(&self) -> bool {
        false
    }
}

/// A link to a board with one drive whose cycles are not caught up, and the future gaps.
fn open_away(hold: &Arc<Hold>) -> (Client, Arc<EngineLink>, Gaps, Arc<AtomicU32>) {
    let gaps = Gaps::default();
    let most_in_a_row = Arc::new(AtomicU32::new(0));
    let bus = SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]);
    let (hold, most) = (Arc::clone(hold), Arc::clone(&most_in_a_row));
    let away = Away { bus, gaps: Arc::clone(&gaps), hold, in_a_row: 0, most_in_a_row: most };
    let mut board = Board::new(EngineConfig::default(), Box::new(away));
    assert!(board.boot(60_000 * MS));
    most_in_a_row.store(0, Ordering::Relaxed);
    let options = RunOptions { virtual_time: false, ..RunOptions::default() };
    let link = Arc::new(EngineLink::open("away", board, options, None).expect("opens"));
    (Client::on(Arc::clone(&link) as Arc<dyn Link>), link, gaps, most_in_a_row)
}

/// NIC-2.4 Frames written during a stall of the machine are executed right after it, and not delayed by the length of
/// the stall, in which axes would stop and then move on.
#[test]
fn what_is_written_in_a_gap_is_executed_at_its_end() {
    let hold = Arc::new(Hold::default());
    let (mut client, link, ..) = open_away(&hold);
    client.op();
    let mut before = client.try_read(PATIENCE).expect("a report");
    hold.wanted.store(true, Ordering::Release);
    while !hold.is_away.load(Ordering::Acquire) {
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(300));
    while let Ok(report) = client.try_read(Wait::Now) {
        before = report;
    }
    let told = [1, 2].map(|n| client.link.write(&target(n, n as u8), Wait::Forever).expect("is taken"));
    sleep(Duration::from_millis(300));
    hold.wanted.store(false, Ordering::Release);
    let executed = loop {
        let report = client.try_read(PATIENCE).expect("reports go on");
        if client.slot(1).index == 2 {
            break report;
        }
    };
    let cycles = executed.sequence - before.sequence;
    assert!(cycles <= 4, "it was executed {cycles} cycles later");
    assert!(told[0] <= told[1] && told[1] <= executed.at, "told {told:?}, executed {:?}", executed.at);
    link.close();
}

/// NIC-2.4 After a stall the machine leaves out exactly the missed cycles, however many, and then goes on. It never
/// sends the outputs of several cycles at once, even if it is late repeatedly.
#[test]
fn what_is_not_caught_up_on_is_left_out_once() {
    let start = Instant::now();
    let (mut client, link, gaps, most_in_a_row) = open_away(&Arc::default());
    client.try_read(PATIENCE).expect("a report");
    gaps.lock().expect("no panic").extend([7; 20].map(Duration::from_millis));
    gaps.lock().expect("no panic").push_back(Duration::from_millis(1500));
    let skipped = || Duration::from_nanos(link.lateness().expect("on the real clock").skipped_ns);
    while skipped() < Duration::from_secs(1) {
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(20));
    let (skipped, passed) = (skipped(), start.elapsed());
    assert!(skipped <= passed, "{skipped:?} were left out of {passed:?}");
    for _ in 0..100 {
        client.try_read(PATIENCE).expect("reports go on");
    }
    assert_eq!(most_in_a_row.load(Ordering::Relaxed), 1);
    link.close();
}

/// A board whose thread has ended by a defect is given up: its name is free.
#[test]
fn a_board_that_broke_is_given_up() {
    let bus = SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]);
    let mut board = Board::new(
        EngineConfig::default(),
        Box::new(Hooked(bus, {
            let host = std::thread::current().id();
            move || assert_eq!(std::thread::current().id(), host, "a defect, on purpose")
        })),
    );
    assert!(board.boot(60_000 * MS));
    let (told, tells) = std::sync::mpsc::channel();
    let keeper = Box::new(move |board: Option<Board>| told.send(board.is_some()).expect("the test waits"));
    let options = RunOptions { virtual_time: false, ..RunOptions::default() };
    let link = EngineLink::open("broken", board, options, Some(keeper)).expect("opens");
    let mut report = Frame::new();
    while link.read(&mut report, Wait::Forever).is_ok() {}
    link.close();
    assert_eq!(tells.try_recv(), Ok(false));
}

/// SK-4.44 A board whose cycles take longer than the cycle time gets later and later, and leaves out gaps repeatedly.
/// It goes on, loses no frame, and can be closed.
#[test]
fn a_machine_that_is_too_slow_goes_on() {
    let (mut client, link) = open(|_| sleep(Duration::from_millis(4)));
    client.op();
    let mut frames = 0;
    while frames < 20 || link.lateness().expect("on the real clock").skipped_ns < 2_000_000_000 {
        client.write(&target(frames, frames as u8));
        frames += 1;
        client.try_read(PATIENCE).expect("a report");
        client.try_read(PATIENCE).expect("a report");
    }
    // A late board may not have taken its last frames yet when its FIFO is empty.
    let last = (frames - 1) as u8;
    client.until("the last target", |client| client.slot(1).index == last && client.answer().fifo_free == FIFO_ENTRIES);
    client.link.close();
    let counters = client.link.stats().board.expect("a simulated board");
    assert_eq!((counters.executed, counters.full), (frames as u64, 0), "{counters:?}");
    assert_eq!(client.try_read(Wait::Now), Err(LinkError::Closed));
}
