//! The link to a board in this process: the engine with its network, on the real clock or on a virtual one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use super::rejections::RejectionLog;
use crate::engine::{Board, Counters, Rate, RealTime, Stepped, Stop, Threaded};
use crate::fieldbus::{CardsGone, Ns};
use crate::link::call_counts::CallCounts;
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;

/// Callback that gets the board when its link is closed, so that a later link can use the same board: a real board
/// does not end with the program either. It gets `None` if the board no longer exists because its thread panicked.
pub type Keeper = Box<dyn Fn(Option<Board>) + Send + Sync>;

/// Options of a board's host interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunOptions {
    /// Whether time is virtual: it then advances only inside calls.
    pub virtual_time: bool,
    /// The duration of a write in the board's time, in nanoseconds; by default one USB microframe.
    pub host_ns: Ns,
    /// The most unread reports that are kept, 1 or more. When the queue is full the oldest report is dropped.
    pub queue: usize,
    /// The timeout of a read for callers that do not choose one.
    pub read_wait: Wait,
    /// The timeout of a write for callers that do not choose one.
    pub write_wait: Wait,
    /// The real-time priority, the processor and the memory locking of the cyclic thread (real clock only).
    pub real_time: RealTime,
    /// How fast the board's time passes, compared with real time (real clock only).
    pub rate: Rate,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self {
            virtual_time: true,
            host_ns: 125_000,
            queue: 32,
            read_wait: Wait::Forever,
            write_wait: Wait::For(Duration::from_secs(5)),
            real_time: RealTime::default(),
            rate: Rate::default(),
        }
    }
}

/// The reason for the loss of a board whose bus gives no reason.
const BUS_GONE: &str = "the hardware that runs its network is gone";

enum Runner {
    Stepped(Box<Stepped>),
    Threaded(Threaded),
}

/// A link to a board in this process.
pub struct EngineLink {
    info: LinkInfo,
    runner: Runner,
    keeper: Option<Keeper>,
    closed: AtomicBool,
    /// The board's counters and the number of dropped reports, as they were when the link was closed.
    last: OnceLock<(Counters, u64)>,
    counts: CallCounts,
    logged: Mutex<Logged>,
}

/// Which events of the board have been logged already.
struct Logged {
    /// The number of events logged so far. Used only in virtual time, where the engine returns all events again; the
    /// cyclic thread passes on each event once.
    events: u64,
    rejections: RejectionLog,
    /// Whether the loss of a network card was logged.
    is_card_told: bool,
}

impl EngineLink {
    /// Opens the host interface of a board that has started up. `name` is the name of the link in messages. `keeper`
    /// gets the board when the link is closed.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`] if the board has not started up; `keeper` then gets it at once. [`LinkError::Io`] if the
    /// system provides no thread.
    pub fn open(name: &str, board: Board, options: RunOptions, keeper: Option<Keeper>) -> Result<Self, LinkError> {
        if !board.engine().talks() {
            let reason = if board.engine().state().is_failed() {
                "it finds no slave; give it some with `slaves=`"
            } else {
                "it is booting; open it again in a moment"
            };
            if let Some(keep) = keeper {
                keep(Some(board));
            }
            return Err(LinkError::NoBoard { name: name.into(), reason: reason.into() });
        }
        let info = LinkInfo {
            name: name.into(),
            slot: Some(board.engine().config().slot),
            virtual_time: options.virtual_time,
            opened_at: Stamp(board.now()),
            read_wait: options.read_wait,
            write_wait: options.write_wait,
        };
        let logged = Logged {
            events: board.engine().events_total(),
            rejections: RejectionLog::new(board.engine().counters()),
            is_card_told: false,
        };
        let runner = if options.virtual_time {
            Runner::Stepped(Box::new(Stepped::new(board, options.host_ns, options.queue)))
        } else {
            let threaded = Threaded::start(board, options.host_ns, options.queue, options.real_time, options.rate);
            Runner::Threaded(threaded.map_err(|error| LinkError::no_thread(name, &error))?)
        };
        Ok(Self {
            info,
            runner,
            keeper,
            closed: AtomicBool::new(false),
            last: OnceLock::new(),
            counts: CallCounts::default(),
            logged: Mutex::new(logged),
        })
    }

    /// Statistics on how late cycles began so far; `None` in virtual time, where no cycle is late.
    pub fn lateness(&self) -> Option<crate::engine::Lateness> {
        match &self.runner {
            Runner::Threaded(threaded) => Some(threaded.lateness()),
            Runner::Stepped(_) => None,
        }
    }

    /// The state of the board after its last cycle: LEDs, link state, lost slaves. `None` in virtual time once the link
    /// is closed.
    pub fn snapshot(&self) -> Option<crate::engine::Snapshot> {
        match &self.runner {
            Runner::Threaded(threaded) => Some(threaded.snapshot()),
            Runner::Stepped(stepped) => stepped.look(|board, _| board.snapshot()),
        }
    }

    fn error(&self, stop: Stop, dir: Dir, wait: Wait) -> LinkError {
        match stop {
            Stop::Timeout => LinkError::timed_out(dir, wait),
            Stop::Silent { since, cycles } => LinkError::Silent { since_ns: since, cycles },
            Stop::Rebooted => {
                LinkError::Lost { name: self.info.name.clone(), reason: "it was reset (SW_RESET)".into() }
            }
            Stop::BusGone => {
                let reason = self.cards_gone().map_or(BUS_GONE.into(), |gone| gone.text.to_string().into());
                LinkError::Lost { name: self.info.name.clone(), reason }
            }
            Stop::Closed => LinkError::Closed,
            Stop::Cancelled => LinkError::Cancelled { dir },
        }
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        match &self.runner {
            Runner::Threaded(threaded) => threaded.cards_gone().cloned(),
            Runner::Stepped(stepped) => stepped.look(|board, _| board.cards_gone()).flatten(),
        }
    }

    /// Logs the events of the board, such as commands that it did not execute, and the loss of a network card. The
    /// thread that calls the link does this, because the cyclic thread must not wait for the log.
    fn log_events(&self) {
        if !log::log_enabled!(log::Level::Warn) {
            return;
        }
        // The lines are collected first and logged after the locks are released, so that no thread waits for the log.
        let mut lines = Vec::new();
        let zero = self.info.opened_at.0;
        let mut log = |level, line| lines.push((level, line));
        let mut logged = self.logged();
        let Logged { events: seen, rejections, .. } = &mut *logged;
        match &self.runner {
            Runner::Threaded(threaded) => {
                let (events, counters, now) = threaded.take_events();
                let events = events.into_iter().map(|event| event.since(zero));
                rejections.log(events, &counters, now.saturating_sub(zero), &mut log);
            }
            Runner::Stepped(stepped) => {
                stepped.look(|board, _| {
                    let engine = board.engine();
                    let from = std::mem::replace(seen, engine.events_total());
                    let events = engine.events_since(from).map(|event| event.since(zero));
                    rejections.log(events, engine.counters(), board.now().saturating_sub(zero), &mut log);
                });
            }
        }
        // The loss of the last card is not logged here, because each call returns it as an error.
        if !logged.is_card_told
            && let Some(gone) = self.cards_gone().filter(|gone| !gone.is_all)
        {
            logged.is_card_told = true;
            lines.push((log::Level::Warn, gone.text.to_string()));
        }
        drop(logged);
        write_log(lines);
    }

    fn logged(&self) -> MutexGuard<'_, Logged> {
        self.logged.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn board_counters(&self) -> Option<(Counters, u64)> {
        if let Some(last) = self.last.get() {
            return Some(*last);
        }
        match &self.runner {
            Runner::Threaded(threaded) => Some(threaded.counters()),
            Runner::Stepped(stepped) => stepped.look(|board, dropped| (*board.engine().counters(), dropped)),
        }
    }
}

fn write_log(lines: Vec<(log::Level, String)>) {
    for (level, line) in lines {
        log::log!(level, "{line}");
    }
}

impl Link for EngineLink {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let done = match &self.runner {
            Runner::Stepped(stepped) => stepped.write(frame),
            Runner::Threaded(threaded) => threaded.write(frame, wait.limit()),
        };
        self.log_events();
        self.counts.write(done.map(Stamp).map_err(|stop| self.error(stop, Dir::Write, wait)))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let done = match &self.runner {
            Runner::Stepped(stepped) => stepped.read(out, wait.limit()),
            Runner::Threaded(threaded) => threaded.read_and(out, wait.limit(), || self.log_events()),
        };
        self.log_events();
        let report = self.counts.read(done.map_err(|stop| self.error(stop, Dir::Read, wait)))?;
        Ok(ReadMeta { at: Stamp(report.at), sequence: report.sequence, dropped: report.dropped })
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        let Runner::Stepped(stepped) = &self.runner else { return self.check().map(|()| None) };
        crate::link::check_pass(time)?;
        let time = Ns::try_from(time.as_nanos()).unwrap_or(Ns::MAX);
        let done = stepped.pass(time).map_err(|stop| self.error(stop, Dir::Read, Wait::Now));
        self.log_events();
        done.map(|at| Some(Stamp(at)))
    }

    fn cancel(&self, dir: Dir) {
        // In virtual time calls do not wait, so there is nothing to cancel.
        if let Runner::Threaded(threaded) = &self.runner {
            match dir {
                Dir::Write => threaded.cancel_writes(),
                Dir::Read => threaded.cancel_reads(),
            }
        }
    }

    fn close(&self) {
        if self.closed.swap(true, Ordering::AcqRel) {
            return;
        }
        self.log_events();
        let (board, dropped) = match &self.runner {
            Runner::Stepped(stepped) => {
                let dropped = stepped.look(|_, dropped| dropped).unwrap_or_default();
                (stepped.close(), dropped)
            }
            // The cyclic thread makes reports until it has ended, so the dropped reports are counted after that.
            Runner::Threaded(threaded) => (threaded.close(), threaded.counters().1),
        };
        if let Some(board) = &board {
            if log::log_enabled!(log::Level::Warn) {
                let mut lines = Vec::new();
                let (counters, now) = (board.engine().counters(), board.now());
                let since_opened = now.saturating_sub(self.info.opened_at.0);
                self.logged().rejections.end(counters, since_opened, &mut |level, line| lines.push((level, line)));
                if let Some((target, since_ns)) = board.engine().going_up(now) {
                    let since_ms = since_ns / 1_000_000;
                    let line = format!(
                        "SET_STATE {target} was still under way when the program closed the board ({since_ms} ms): wait for the \
                         state in byte 2 of slot 0"
                    );
                    lines.push((log::Level::Warn, line));
                }
                write_log(lines);
            }
            // A link is closed only once, so the cell is empty and `set` succeeds.
            let _ = self.last.set((*board.engine().counters(), dropped));
        }
        if let Some(keep) = &self.keeper {
            keep(board);
        }
    }

    fn check(&self) -> Result<(), LinkError> {
        match &self.runner {
            Runner::Stepped(stepped) => stepped.check(),
            Runner::Threaded(threaded) => threaded.check(),
        }
        .map_err(|stop| self.error(stop, Dir::Read, Wait::Now))
    }

    fn stats(&self) -> LinkStats {
        let board = self.board_counters();
        let snapshot = self.snapshot();
        LinkStats {
            network_down: snapshot.is_some_and(|snapshot| !snapshot.link),
            reports_dropped: board.as_ref().map_or(0, |(_, dropped)| *dropped),
            board: board.map(|(counters, _)| counters),
            state_failure: snapshot.and_then(|snapshot| snapshot.failure),
            lost: snapshot.map(|snapshot| snapshot.lost).unwrap_or_default(),
            lateness: self.lateness(),
            ..self.counts.stats()
        }
    }
}

impl Drop for EngineLink {
    fn drop(&mut self) {
        self.close();
    }
}
