//! Runs a board in real time: the runner is a thread that runs the board's cycles at absolute deadlines.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::arrivals::{Arrival, Arrivals};
use super::handover::Handover;
use super::lateness::{LateCounts, Lateness};
use super::realtime::{Clock, Rate, RealTime};
use super::reports::Report;
use super::stepped::Stop;
use super::{Board, Counters, Event, Snapshot};
use crate::fieldbus::{CardsGone, Ns};
use crate::sk::Frame;

/// The runner takes command frames out of its inbox at least this often, even if its cycles are longer.
/// [`Threaded::close`] waits at most this long for the thread, too.
const VISIT_INTERVAL: Duration = Duration::from_millis(5);
/// The number of command frames that the inbox can hold: more than can arrive in a [`VISIT_INTERVAL`], so that writers
/// do not wait for the runner.
const INBOX_FRAMES: usize = 256;
/// The longest delay after which cycles are caught up on. After a longer one (a machine that was suspended, a process
/// stopped in a debugger) board time skips the whole gap, and [`Lateness::skipped_ns`] counts it \[OURS]. If a machine
/// is too slow for its cycles, this happens again and again, and the board runs more slowly than the clock.
const CATCH_UP_MAX: Duration = Duration::from_secs(1);
/// A write waits at least this long until the simulated wire is free, even if its timeout is shorter: one USB
/// microframe of board time \[OURS]. With a shorter wait, a second write right after the first would fail, since a
/// frame occupies the wire for some time.
const TURN_WAIT_MAX: Duration = Duration::from_micros(125);
/// The interval at which a waiting [`Threaded::read_and`] calls `meanwhile`. While the network does not answer, there
/// are no reports, so the caller has to check for other reasons to stop. \[OURS]
pub const LOOK_INTERVAL: Duration = Duration::from_millis(20);
/// How many events are kept for the host's log until it fetches them by [`Threaded::take_events`].
const EVENTS_KEPT: usize = 32;

/// A copy of the board's state, updated after each cycle, for other threads.
struct BoardView {
    counters: Counters,
    snapshot: Snapshot,
    events: Vec<Event>,
    events_total: u64,
    now: Ns,
}

struct Shared {
    handover: Handover,
    stop: AtomicBool,
    shown: Mutex<BoardView>,
    late: LateCounts,
    skipped_ns: AtomicU64,
    /// When the next cycle of the board is due, board time.
    due: AtomicU64,
    /// Delay of a cycle above which the runner skips the delay in board time instead of catching up, nanoseconds of
    /// board time: the result of [`late_max`].
    late_max_ns: AtomicU64,
    /// `card_gone`: the first loss of a network card while another card still works. `all_gone`: no card is left.
    card_gone: OnceLock<CardsGone>,
    all_gone: OnceLock<CardsGone>,
}

impl Shared {
    fn new(board: &Board, queue: usize) -> Self {
        Self {
            handover: Handover::new(INBOX_FRAMES, queue),
            stop: AtomicBool::new(false),
            shown: Mutex::new(BoardView {
                counters: *board.engine().counters(),
                snapshot: board.snapshot(),
                events: Vec::with_capacity(EVENTS_KEPT),
                events_total: board.engine().events_total(),
                now: board.now(),
            }),
            late: LateCounts::default(),
            skipped_ns: AtomicU64::new(0),
            due: AtomicU64::new(board.next_cycle()),
            late_max_ns: AtomicU64::new(late_max(board)),
            card_gone: OnceLock::new(),
            all_gone: OnceLock::new(),
        }
    }

    /// Records the loss of a network card. When no card is left, this ends the host interface.
    fn note_cards(&self, gone: CardsGone) {
        // Only the first loss of each kind is recorded: `set` does nothing if there is one.
        if gone.is_all {
            let _ = self.all_gone.set(gone);
            self.handover.end(Stop::BusGone);
        } else {
            let _ = self.card_gone.set(gone);
        }
    }
}

/// A board in real time: a thread runs its cycles.
pub struct Threaded {
    shared: Arc<Shared>,
    clock: Arc<Clock>,
    /// The board time at which the runner's clock started.
    zero: Ns,
    host: Duration,
    arrivals: Mutex<Arrivals>,
    thread: Mutex<Option<JoinHandle<Board>>>,
}

impl Threaded {
    /// Opens the host interface of the board and starts its thread. A write takes `host_ns` of board time, and the
    /// newest `queue` reports are kept. `real_time`: priority, processor and memory locking of the thread. `rate` is
    /// the speed of board time relative to machine time; timeouts of calls are machine time.
    ///
    /// # Errors
    /// The error of the system if it starts no thread; the board is dropped then.
    pub fn start(board: Board, host_ns: Ns, queue: usize, real_time: RealTime, rate: Rate) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::new(&board, queue));
        let clock = Arc::new(Clock::start(rate));
        let zero = board.now();
        let thread = crate::threads::spawn("ecmsk-board", {
            let (shared, clock) = (Arc::clone(&shared), Arc::clone(&clock));
            move || {
                for warning in real_time.apply() {
                    log::warn!("{warning}");
                }
                let _end = EndOnExit(&shared.handover);
                run(board, &shared, &clock)
            }
        })?;
        Ok(Self {
            shared,
            clock,
            zero,
            host: Duration::from_nanos(host_ns),
            arrivals: Mutex::default(),
            thread: Mutex::new(Some(thread)),
        })
    }

    /// Sends a frame to the board. The call waits until earlier frames have passed the simulated wire, and for room in
    /// the inbox, for at most `limit`. A `limit` below 125 us of board time counts as 125 us, so that a second write
    /// right after the first does not fail. `None`: no limit.
    ///
    /// Returns the board time at which the frame arrives. If that is up to 50 ms before the time returned for the
    /// previous frame, the call returns the later time. So the times keep the order of the frames.
    ///
    /// # Errors
    /// [`Stop::Timeout`]; [`Stop::Cancelled`] by [`Self::cancel_writes`]; [`Stop::Rebooted`], [`Stop::Closed`] and
    /// [`Stop::BusGone`] if the interface is not open any more. The board does not get the frame then.
    pub fn write(&self, frame: &Frame, limit: Option<Duration>) -> Result<Ns, Stop> {
        let now = self.clock.now();
        let rate = self.clock.rate();
        let limit = limit.map(|limit| limit.max(rate.real(TURN_WAIT_MAX)));
        let waits = |wait| limit.is_none_or(|limit| rate.real(wait) <= limit);
        let Arrival { turn, at, shown } = {
            let mut arrivals = self.arrivals.lock().unwrap_or_else(PoisonError::into_inner);
            arrivals.next(now, self.board_time(now), self.host, waits)
        };
        self.shared.handover.send(frame, at, self.clock.instant(turn), limit.and_then(end_after))?;
        Ok(shown)
    }

    /// Converts a time of the runner's clock to board time, and returns how much board time was skipped so far. If the
    /// next cycle is so late that the runner will skip its delay, the result is the time at which this cycle was due: a
    /// frame written now counts as arrived at that time.
    fn board_time(&self, now: Duration) -> (Ns, Ns) {
        let due = self.shared.due.load(Ordering::Acquire);
        let skipped = self.shared.skipped_ns.load(Ordering::Relaxed);
        let at = self.zero + (now.as_nanos() as Ns).saturating_sub(skipped);
        let is_gap = at.saturating_sub(due) > self.shared.late_max_ns.load(Ordering::Relaxed);
        (if is_gap { due } else { at }, skipped)
    }

    /// Takes the oldest unread report. If there is none, waits for one at most `limit`; `None`: no limit.
    ///
    /// # Errors
    /// [`Stop::Timeout`]; [`Stop::Cancelled`] by [`Self::cancel_reads`]; [`Stop::Rebooted`], [`Stop::Closed`] and
    /// [`Stop::BusGone`] if the interface is not open any more.
    pub fn read(&self, out: &mut Frame, limit: Option<Duration>) -> Result<Report, Stop> {
        self.shared.handover.receive(out, limit.and_then(end_after))
    }

    /// Like [`Self::read`], but calls `meanwhile` every 20 ms during the wait, without holding a lock, so that the
    /// caller can look for other reasons to stop.
    ///
    /// # Errors
    /// As of [`Self::read`].
    pub fn read_and(
        &self,
        out: &mut Frame,
        limit: Option<Duration>,
        mut meanwhile: impl FnMut(),
    ) -> Result<Report, Stop> {
        let end = limit.and_then(end_after);
        let cancelled = self.shared.handover.reads_cancelled();
        loop {
            let look = end_after(LOOK_INTERVAL);
            let part = [look, end].into_iter().flatten().min();
            match self.shared.handover.receive_in_parts(out, part, Some(cancelled)) {
                Err(Stop::Timeout) if part != end => meanwhile(),
                done => return done,
            }
        }
    }

    /// Succeeds if the interface is open. Does not wait.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`] or [`Stop::BusGone`]: the interface is not open any more.
    pub fn check(&self) -> Result<(), Stop> {
        self.shared.handover.check()
    }

    /// Cancels all writes that are waiting.
    pub fn cancel_writes(&self) {
        self.shared.handover.cancel_writes();
    }

    /// Cancels all reads that are waiting.
    pub fn cancel_reads(&self) {
        self.shared.handover.cancel_reads();
    }

    /// The counters of the board after its last cycle, and the number of reports dropped so far.
    pub fn counters(&self) -> (Counters, u64) {
        let shown = self.shared.shown.lock().unwrap_or_else(PoisonError::into_inner);
        (shown.counters, self.shared.handover.dropped())
    }

    /// The snapshot of the board after its last cycle.
    pub fn snapshot(&self) -> Snapshot {
        self.shared.shown.lock().unwrap_or_else(PoisonError::into_inner).snapshot
    }

    /// The loss of all network cards if none is left, else the first loss of one of two cards. `None`: no card is gone.
    pub fn cards_gone(&self) -> Option<&CardsGone> {
        self.shared.all_gone.get().or_else(|| self.shared.card_gone.get())
    }

    /// Takes the events of the board's log since the last call, with the counters and the board time after the newest
    /// cycle.
    pub fn take_events(&self) -> (Vec<Event>, Counters, Ns) {
        let mut shown = self.shared.shown.lock().unwrap_or_else(PoisonError::into_inner);
        (shown.events.drain(..).collect(), shown.counters, shown.now)
    }

    /// How late the runner's cycles have begun so far.
    pub fn lateness(&self) -> Lateness {
        self.shared.late.read(self.shared.skipped_ns.load(Ordering::Relaxed))
    }

    /// Ends all waiting reads and writes, stops the thread and returns the board. `None`: the interface was closed
    /// before, or the thread has panicked.
    pub fn close(&self) -> Option<Board> {
        self.shared.handover.end(Stop::Closed);
        self.shared.stop.store(true, Ordering::Release);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        thread.join().ok()
    }
}

impl Drop for Threaded {
    fn drop(&mut self) {
        self.close();
    }
}

/// Converts the time limit of a wait that begins now to its end; `None`: an `Instant` cannot represent it.
fn end_after(limit: Duration) -> Option<Instant> {
    Instant::now().checked_add(limit)
}

/// Ends all waits when the thread ends, even by a panic, so that no call waits for ever.
struct EndOnExit<'a>(&'a Handover);

impl Drop for EndOnExit<'_> {
    fn drop(&mut self) {
        self.0.end(Stop::Closed);
    }
}

/// The loop of the thread: takes frames from the inbox, runs the cycles that are due, sleeps until the next one.
fn run(mut board: Board, shared: &Shared, clock: &Clock) -> Board {
    let boots = board.engine().boots();
    let zero = board.now();
    let cycles = board.cycles();
    let mut frame = Frame::new();
    // The sum of the gaps that board time has skipped. Board time is behind the runner's clock by this sum.
    let mut skipped = Duration::ZERO;
    let mut now = Duration::ZERO;
    let mut has_left_out = false;
    let rate = clock.rate();
    let (between_visits, catch_up_max) = (rate.slowed(VISIT_INTERVAL), rate.slowed(CATCH_UP_MAX));
    let catches_up = board.catches_up();
    // Late cycles are caught up on in batches of [`VISIT_INTERVAL`], and frames are taken from the inbox before each
    // batch. If the board does not catch up, a batch is one cycle.
    let longest_part = if catches_up { between_visits.as_nanos() as Ns } else { 0 };
    while !shared.stop.load(Ordering::Acquire) {
        let mut due = skipped + Duration::from_nanos(board.next_cycle() - zero);
        shared.late_max_ns.store(late_max(&board), Ordering::Relaxed);
        // Release: a thread that sees this value also sees the skipped time stored before it.
        shared.due.store(board.next_cycle(), Ordering::Release);
        let wake = due.min(now + between_visits);
        let board_time = |time: Duration| zero + time.saturating_sub(skipped).as_nanos() as Ns;
        board.work_until(board_time(clock.now()), board_time(wake));
        clock.sleep_until(wake);
        now = clock.now();
        let late = now.saturating_sub(due);
        if catches_up && late > catch_up_max {
            // Board time skips the whole delay, so that the next cycle is due now. If it skipped only a part, the rest
            // would again be above `catch_up_max` in the next iteration.
            due = now;
            skipped += late;
            shared.skipped_ns.fetch_add(late.as_nanos() as u64, Ordering::Relaxed);
        }
        if !catches_up {
            let period = board.period_ns();
            let cycles = cycles_to_leave_out(late.as_nanos() as Ns, period);
            // After cycles were left out one cycle always runs, however late. Otherwise a machine that is always late
            // would never run one.
            if cycles > 0 && !std::mem::replace(&mut has_left_out, true) {
                board.leave_out(cycles);
                skipped += Duration::from_nanos(cycles * period);
                shared.skipped_ns.fetch_add(cycles * period, Ordering::Relaxed);
                continue;
            }
            has_left_out = false;
        }
        let board_now = zero + now.saturating_sub(skipped).as_nanos() as Ns;
        let part = board_now.min(board.next_cycle() + longest_part);
        take_frames(&mut board, part, board_now, shared, &mut frame);
        if now >= due {
            shared.late.note(rate.real(now - due).as_nanos() as u64);
            board.advance(part, &mut |frame, at| shared.handover.publish(frame, at));
            shared.late.set_cycles(board.cycles() - cycles);
            publish_view(&board, shared);
        }
        if let Some(gone) = board.cards_gone() {
            shared.note_cards(gone);
        }
        if board.engine().boots() != boots {
            shared.handover.end(Stop::Rebooted);
        }
    }
    // Frames that writers have handed over before the end still reach the board.
    let now = board.now();
    take_frames(&mut board, now, now, shared, &mut frame);
    board
}

/// How late a cycle may be without being skipped, board time.
fn late_max(board: &Board) -> Ns {
    if board.catches_up() { CATCH_UP_MAX.as_nanos() as Ns } else { board.period_ns() / 2 }
}

/// How many cycles a runner that does not catch up leaves out: as many as it takes for the next one to be due in time.
/// 0 if this cycle is at most half a cycle late \[OURS].
const fn cycles_to_leave_out(late_ns: Ns, period_ns: Ns) -> u64 {
    if late_ns <= period_ns / 2 { 0 } else { late_ns.div_ceil(period_ns) }
}

/// Passes the frames in the inbox that arrive by `until` to the board. A frame with an arrival time after `board_now`
/// was written before board time skipped a gap: the machine's clock has passed its arrival, so the board gets it now.
fn take_frames(board: &mut Board, until: Ns, board_now: Ns, shared: &Shared, frame: &mut Frame) {
    while let Some(at) = shared.handover.next_frame(frame, |at| at <= until || at >= board_now) {
        let at = at.clamp(board.now(), until.max(board.now()));
        board.host(frame, at, &mut |frame, at| shared.handover.publish(frame, at));
    }
}

/// Copies counters, snapshot and new events to the view for other threads. If another thread has locked the view,
/// nothing is copied before the next cycle, so that the runner does not wait.
fn publish_view(board: &Board, shared: &Shared) {
    let Ok(mut shown) = shared.shown.try_lock() else { return };
    let engine = board.engine();
    shown.counters = *engine.counters();
    shown.snapshot = board.snapshot();
    shown.now = board.now();
    let seen = std::mem::replace(&mut shown.events_total, engine.events_total());
    if engine.events_total() > seen {
        let room = EVENTS_KEPT - shown.events.len();
        shown.events.extend(engine.events_since(seen).take(room));
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;
    use crate::engine::EngineConfig;
    use crate::fieldbus::sim::SimBus;
    use crate::sk::{MasterCommand, MasterResponse, MasterState, RawSlot, SlaveKind, SlotSize};
    use crate::slave::{Drive, DriveConfig};

    const SIZE: SlotSize = SlotSize::Bytes12;

    /// NIC-2.4 A cycle that is at most half a cycle late runs. For a later one, whole cycles are left out until the
    /// next one is in time.
    #[test]
    fn late_cycles_are_left_out_whole() {
        const MS: Ns = 1_000_000;
        for (late, cycles) in [(0, 0), (MS / 2, 0), (MS / 2 + 1, 1), (MS, 1), (MS + 1, 2), (17 * MS + 1, 18)] {
            assert_eq!(cycles_to_leave_out(late, MS), cycles, "{late}");
        }
    }

    /// NIC-2.8 A waiting read calls `meanwhile` again and again, ends with its timeout, and can be cancelled at any
    /// moment.
    #[test]
    fn a_read_that_waits_looks_around() {
        // A board without slaves makes no reports, so the read waits.
        let board = Board::new(EngineConfig::default(), Box::new(SimBus::new(Vec::new())));
        let threaded = Threaded::start(board, 0, 4, RealTime::default(), Rate::default()).expect("a thread");
        let (mut frame, mut looks) = (Frame::new(), 0);
        let ended = threaded.read_and(&mut frame, Some(5 * LOOK_INTERVAL), || looks += 1);
        assert!(matches!(ended, Err(Stop::Timeout)) && looks >= 1, "{looks}");
        assert!(matches!(threaded.read_and(&mut frame, Some(Duration::ZERO), || ()), Err(Stop::Timeout)));
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                // A cancellation works at any moment, also between two calls of `meanwhile`. Before the read has begun
                // it has no effect.
                while !over.load(Ordering::Relaxed) {
                    threaded.cancel_reads();
                    std::thread::sleep(Duration::from_micros(700));
                }
            });
            for _ in 0..20 {
                let ended = threaded.read_and(&mut Frame::new(), None, || ());
                assert!(matches!(ended, Err(Stop::Cancelled)));
            }
            over.store(true, Ordering::Relaxed);
        });
    }

    /// SK-9.8 The runner's thread allocates nothing from its first cycle to its last: on the way to OP, with entries,
    /// with invalid commands, with reports that are read and reports that are not.
    #[test]
    fn the_runners_thread_allocates_nothing() {
        let mut board = Board::new(
            EngineConfig::default(),
            Box::new(SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))])),
        );
        assert!(board.boot(60_000_000_000));
        let (shared, clock) = (Arc::new(Shared::new(&board, 4)), Clock::start(Rate::default()));
        let host = std::thread::spawn({
            let shared = Arc::clone(&shared);
            move || {
                let (mut frame, mut report) = (Frame::new(), Frame::new());
                let send = |frame: &Frame| shared.handover.send(frame, 0, Instant::now(), None).unwrap();
                let kinds = [SlaveKind::Drive; 8];
                for command in [MasterCommand::SetAxis { group: 0, kinds }, MasterCommand::SetState(MasterState::Op)] {
                    frame.put_master(SIZE, &command);
                    send(&frame);
                }
                while MasterResponse::decode(&report.slot(SIZE, 0)).state.state() != Some(MasterState::Op) {
                    shared.handover.receive(&mut report, None).unwrap();
                }
                frame.put(SIZE, 1, &RawSlot { id: 0x99, ..RawSlot::ZERO });
                for _ in 0..300 {
                    send(&frame);
                    shared.handover.receive(&mut report, None).unwrap();
                }
                while shared.handover.dropped() == 0 {
                    std::thread::yield_now();
                }
                shared.stop.store(true, Ordering::Release);
            }
        });
        let mut ended = None;
        let counted = allocation_counter::measure(|| ended = Some(run(board, &shared, &clock)));
        host.join().unwrap();
        assert_eq!((counted.count_total, counted.count_current), (0, 0), "{counted:?}");
        let counters = *ended.expect("the board comes back").engine().counters();
        assert!(counters.executed > 200 && counters.rejected_total() > 200, "{counters:?}");
    }
}
