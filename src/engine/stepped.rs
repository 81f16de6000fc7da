//! Runs a board in virtual time. Board time passes only in calls of the host, so that a test of hours takes seconds of
//! real time, and a program with one thread gets the same bytes in every run.

use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};

use super::Board;
use super::reports::{Report, ReportQueue};
use crate::fieldbus::Ns;
use crate::sk::Frame;

/// How much board time a read without waiting takes \[OURS]: one USB microframe. If it took none, board time would
/// stand still for a program that polls in a loop, and no report would ever come.
const POLL_READ_NS: Ns = 125_000;

/// How much board time [`Stepped::pass`] lets pass before it releases its lock, so that calls of other threads wait
/// only shortly \[OURS]: some hundred cycles, which take less than a millisecond of machine time.
const PASS_STEP_NS: Ns = 100_000_000;

/// Why a call on a stepped or threaded board has ended without result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The time limit of the call has passed.
    Timeout,
    /// The board makes no reports, and will not make any while the call waits: the first cable is cut or reports are
    /// suppressed, and no fault script is left that could change this.
    Silent {
        /// When the last report was made, board time.
        since: Ns,
        /// How many cycles have passed without a report since.
        cycles: u64,
    },
    /// The board has rebooted since the interface was opened, as after SW_RESET: open it again, as with a USB device
    /// that was plugged in anew.
    Rebooted,
    /// The interface was closed.
    Closed,
    /// The wait was cancelled.
    Cancelled,
    /// The hardware that runs the bus is gone for good ([`Fieldbus::cards_gone`](crate::fieldbus::Fieldbus::cards_gone)).
    BusGone,
}

struct State {
    /// The board; `None`: the interface was closed, and [`Stepped::close`] has given the board to its caller.
    board: Option<Board>,
    reports: ReportQueue,
    boots: u64,
}

/// A board on virtual time.
///
/// Its lock is fair: waiting threads get it in turn. Calls here wait for nothing but the lock, so with an unfair lock a
/// thread that only reads could block a writer for ever.
pub struct Stepped {
    state: Mutex<State>,
    host_ns: Ns,
}

impl Stepped {
    /// Opens the board's host interface. A write takes `host_ns` of board time, as the transfer of a frame does on USB.
    /// The newest `queue` reports are kept.
    pub fn new(board: Board, host_ns: Ns, queue: usize) -> Self {
        let boots = board.engine().boots();
        Self { state: Mutex::new(State { board: Some(board), reports: ReportQueue::new(queue), boots }), host_ns }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Sends a frame to the board. Returns the board time at which it has arrived, after the time that a write takes.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`] or [`Stop::BusGone`]; the board has not received the frame.
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

    /// Takes the oldest unread report. If there is none, time passes until there is one, at most `limit`; `None`: no
    /// limit.
    ///
    /// # Errors
    /// [`Stop::Timeout`] after `limit`. [`Stop::Silent`] as soon as the board has stopped making reports
    /// ([`Board::silence`]), since nothing can change that while this call waits. [`Stop::Rebooted`], [`Stop::Closed`]
    /// or [`Stop::BusGone`] if the interface is not open.
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
            if board.cards_gone().is_some_and(|gone| gone.is_all) {
                return Err(Stop::BusGone);
            }
            if let Some((since, cycles)) = board.silence() {
                return Err(Stop::Silent { since, cycles });
            }
        }
    }

    /// Lets `time` nanoseconds of board time pass and returns the new board time. Reports made meanwhile are queued
    /// like any others. Calls of other threads may run in between.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`] or [`Stop::BusGone`]: time that passed before the error stays passed.
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
        let is_gone = board.cards_gone().is_some_and(|gone| gone.is_all);
        // A fair unlock gives the lock to a waiting thread. With an ordinary one, the loop in `pass` would lock again
        // first and keep the other threads out.
        MutexGuard::unlock_fair(state);
        match (is_gone, is_same_boot) {
            (true, _) => Err(Stop::BusGone),
            (false, true) => Ok(now),
            (false, false) => Err(Stop::Rebooted),
        }
    }

    /// Checks that the host interface is open. No time passes.
    ///
    /// # Errors
    /// [`Stop::Rebooted`], [`Stop::Closed`] or [`Stop::BusGone`]: the interface is not open.
    pub fn check(&self) -> Result<(), Stop> {
        let State { board, boots, .. } = &mut *self.lock();
        alive(board, *boots).map(|_| ())
    }

    /// Calls `look` with the board and the number of reports dropped so far, and returns its result. `None`: the
    /// interface was closed.
    pub fn look<T>(&self, look: impl FnOnce(&Board, u64) -> T) -> Option<T> {
        let state = self.lock();
        state.board.as_ref().map(|board| look(board, state.reports.dropped()))
    }

    /// Closes the interface and returns the board; `None`: it was closed before.
    pub fn close(&self) -> Option<Board> {
        self.lock().board.take()
    }
}

fn alive(board: &mut Option<Board>, boots: u64) -> Result<&mut Board, Stop> {
    let board = board.as_mut().ok_or(Stop::Closed)?;
    if board.cards_gone().is_some_and(|gone| gone.is_all) {
        return Err(Stop::BusGone);
    }
    if board.engine().boots() == boots { Ok(board) } else { Err(Stop::Rebooted) }
}
