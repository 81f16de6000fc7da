//! The runner of virtual time: it passes by the host's calls alone, so hours pass in seconds and one calling thread
//! sees the same bytes every time.

use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};

use super::Board;
use super::reports::{Report, ReportQueue};
use crate::fieldbus::Ns;
use crate::sk::Frame;

/// A read on a virtual clock that looks without waiting costs this much of the board's time \[OURS]: one USB
/// microframe. Else a program that polls would stop the clock.
const POLL_READ_NS: Ns = 125_000;

/// Time that passes until other threads' calls come in between \[OURS]: some hundred cycles, which take less than a
/// millisecond.
const PASS_STEP_NS: Ns = 100_000_000;

/// What a call on a stepped or threaded board can end with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The limit has passed.
    Timeout,
    /// No cycle passes: silent since, for that many cycles.
    Silent {
        /// Board time of the last report.
        since: Ns,
        /// Cycles without one.
        cycles: u64,
    },
    /// The board has booted since the interface was opened.
    Rebooted,
    /// The interface was closed.
    Closed,
    /// The wait was cancelled.
    Cancelled,
}

struct State {
    /// `None` once closed.
    board: Option<Board>,
    reports: ReportQueue,
    boots: u64,
}

/// A board on virtual time.
///
/// Its lock is one that is handed on in turn when threads wait for it: no call here waits for anything else, so a thread
/// that only reads could keep a writer out for ever.
pub struct Stepped {
    state: Mutex<State>,
    host_ns: Ns,
}

impl Stepped {
    /// Opens the board's host interface; a write takes `host_ns` of its time, and the newest `queue` reports are kept.
    pub fn new(board: Board, host_ns: Ns, queue: usize) -> Self {
        let boots = board.engine().boots();
        Self { state: Mutex::new(State { board: Some(board), reports: ReportQueue::new(queue), boots }), host_ns }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Hands a frame over; says when it arrived.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`]; the frame was not taken.
    pub fn write(&self, frame: &Frame) -> Result<Ns, Stop> {
        let State { board, reports, boots } = &mut *self.lock();
        let board = alive(board, *boots)?;
        let at = board.now() + self.host_ns;
        let mut keep = |frame: &Frame, at| reports.push(frame, at);
        board.advance(at, &mut keep);
        if board.engine().boots() != *boots {
            return Err(Stop::Rebooted);
        }
        board.host(frame, at, &mut keep);
        Ok(at)
    }

    /// The oldest report not read yet. Time passes until there is one, at most `limit`; `None`: no limit.
    ///
    /// # Errors
    /// [`Stop::Timeout`]; [`Stop::Silent`] as soon as a cycle passes without a report, since nothing else can happen
    /// while one waits; [`Stop::Rebooted`]; [`Stop::Closed`].
    pub fn read(&self, out: &mut Frame, limit: Option<Duration>) -> Result<Report, Stop> {
        let State { board, reports, boots } = &mut *self.lock();
        let board = alive(board, *boots)?;
        if let Some(report) = reports.pop(out) {
            return Ok(report);
        }
        let limit = limit.map(|limit| Ns::try_from(limit.as_nanos()).unwrap_or(Ns::MAX).max(POLL_READ_NS));
        let end = limit.map(|limit| board.now().saturating_add(limit));
        loop {
            if let Some(end) = end
                && board.next_cycle() > end
            {
                board.advance(end, &mut |_, _| {});
                return Err(Stop::Timeout);
            }
            board.cycle(&mut |frame, at| reports.push(frame, at));
            if let Some(report) = reports.pop(out) {
                return Ok(report);
            }
            if let Some((since, cycles)) = board.silence() {
                return Err(Stop::Silent { since, cycles });
            }
        }
    }

    /// Lets that much time pass and says what time it is then; reports made meanwhile are kept as if nobody had read. Other
    /// threads' calls come in between.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`].
    pub fn pass(&self, time: Ns) -> Result<Ns, Stop> {
        let mut left = time;
        loop {
            let step = left.min(PASS_STEP_NS);
            let now = self.pass_step(step)?;
            left -= step;
            if left == 0 {
                return Ok(now);
            }
        }
    }

    fn pass_step(&self, time: Ns) -> Result<Ns, Stop> {
        let mut state = self.lock();
        let State { board, reports, boots } = &mut *state;
        let board = alive(board, *boots)?;
        let to = board.now().saturating_add(time);
        board.advance(to, &mut |frame, at| reports.push(frame, at));
        let (now, is_same_boot) = (board.now(), board.engine().boots() == *boots);
        // Whoever waits for the board has it next.
        MutexGuard::unlock_fair(state);
        if is_same_boot { Ok(now) } else { Err(Stop::Rebooted) }
    }

    /// Whether the interface is still there; no time passes.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`].
    pub fn check(&self) -> Result<(), Stop> {
        let State { board, boots, .. } = &mut *self.lock();
        alive(board, *boots).map(|_| ())
    }

    /// Looks at the board and at the reports dropped so far; `None` once closed.
    pub fn look<T>(&self, look: impl FnOnce(&Board, u64) -> T) -> Option<T> {
        let state = self.lock();
        state.board.as_ref().map(|board| look(board, state.reports.dropped()))
    }

    /// Closes the interface and gives the board back, once.
    pub fn close(&self) -> Option<Board> {
        self.lock().board.take()
    }
}

fn alive(board: &mut Option<Board>, boots: u64) -> Result<&mut Board, Stop> {
    let board = board.as_mut().ok_or(Stop::Closed)?;
    if board.engine().boots() == boots { Ok(board) } else { Err(Stop::Rebooted) }
}
