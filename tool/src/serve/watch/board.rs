//! Monitors a board that a server serves. A wrapper around the link of the board examines each frame, for the metrics
//! and the watchdog.
//!
//! The threads that exchange frames with the board never wait for a reader of the metrics. They store their results in
//! a copy. If a reader has locked the copy at that moment, this update is skipped and the next report updates it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, CarriedFile, Layer, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::sk::{Frame, StateByte};

use super::frames::{Frames, Shown};
use super::trouble;
use crate::lock::lock;

/// A board on the real clock counts as silent if it runs no cycle, or sends no report, for longer than this. \[OURS]
pub const SILENT: Duration = Duration::from_secs(1);
/// If opening a board takes longer than this, it hangs. Scanning a long network and its EEPROMs takes several seconds.
/// \[OURS]
const OPENING_MAX: Duration = Duration::from_secs(60);

/// The monitoring of a board that a server serves.
pub struct BoardWatch {
    /// The scheme of the link, such as `sim`. The rest of the link is not shown, because it may contain names of files
    /// and machines.
    pub scheme: &'static str,
    /// The paths of the recordings of the link, each with its kind: `record` or `flight`.
    pub recordings: Vec<(&'static str, PathBuf)>,
    uri: LinkUri,
    /// The machine file that is stored in recordings of the link.
    machine: Option<Arc<CarriedFile>>,
    wanted: Wanted,
    calls: Calls,
    open: Mutex<Open>,
    frames: Mutex<Frames>,
    shown: Mutex<Shown>,
    progress: Mutex<Progress>,
    looked: Mutex<Look>,
}

/// Which data about a board are needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// None: the link is used without a wrapper.
    Nothing,
    /// Whether the board is alive, for the watchdog.
    Life,
    /// Whether the board is alive, and the values in its frames, for the metrics.
    Metrics,
}

/// Counts the server's calls of the link since the server was started. The counts continue when the board is opened
/// again.
#[derive(Default)]
struct Calls {
    written: AtomicU64,
    read: AtomicU64,
    write_errors: AtomicU64,
    read_errors: AtomicU64,
    opened: AtomicU64,
    /// The number of reads that are waiting at the moment.
    reading: AtomicU64,
}

/// The counts of the server's calls of a board's link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CallCounts {
    /// The command frames that the board has taken.
    pub written: u64,
    /// The reports that the server has read.
    pub read: u64,
    /// The writes that failed, except by a timeout.
    pub write_errors: u64,
    /// The reads that failed, except by a timeout.
    pub read_errors: u64,
    /// How often the board was opened.
    pub opened: u64,
}

/// Whether the board is open.
enum Open {
    /// The board is not open. `since`: when opening it began, while an attempt to open it is in progress; `why`: the
    /// error of the last attempt.
    No {
        since: Option<Instant>,
        why: String,
    },
    Yes(Weak<WatchedLink>),
}

/// The latest sign of life of the board, and when it was seen first.
struct Progress {
    sign: Option<Sign>,
    since: Instant,
}

/// A value that changes as long as the board is alive.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sign {
    /// The number of cycles that a board in this process has run.
    Cycles(u64),
    /// The number of reports of another board; used only while the server waits for one.
    Reports(u64),
}

/// The result of a check of the board.
#[derive(Clone, Debug, Default)]
pub struct Look {
    /// The counters of the board's link; `None` if the link is not open.
    pub stats: Option<LinkStats>,
    /// How long the board has shown no sign of life, as seen by the checks; 0 if it is alive.
    pub stands: Duration,
    /// What is wrong with the board, in words; `None` if it answers and has lost no slave.
    pub trouble: Option<String>,
}

/// The wrapper around the link of the board.
struct WatchedLink {
    inner: Arc<dyn Link>,
    info: LinkInfo,
    board: Arc<BoardWatch>,
}

impl BoardWatch {
    /// Creates the monitoring of the board of this link; the board is not open yet.
    pub fn new(uri: &LinkUri, machine: Option<Arc<CarriedFile>>, wanted: Wanted) -> Arc<Self> {
        let recordings = [("record", "record"), ("flight", "flight")];
        let recordings = recordings.into_iter().filter_map(|(key, word)| Some((word, PathBuf::from(uri.value(key)?))));
        Arc::new(Self {
            scheme: uri.scheme().name(),
            recordings: recordings.collect(),
            uri: uri.clone(),
            machine,
            wanted,
            calls: Calls::default(),
            open: Mutex::new(Open::No { since: None, why: "it was not opened yet".to_owned() }),
            frames: Mutex::default(),
            shown: Mutex::default(),
            progress: Mutex::new(Progress { sign: None, since: Instant::now() }),
            looked: Mutex::default(),
        })
    }

    /// Opens the board and returns the wrapped link. A simulated board stays in this process, so opening it again finds
    /// the same board.
    ///
    /// # Errors
    /// Those of [`link::open`].
    pub fn open(self: &Arc<Self>) -> Result<Arc<dyn Link>, LinkError> {
        *lock(&self.open) = Open::No { since: Some(Instant::now()), why: String::new() };
        let uri = self.uri.to_string();
        let opened = match &self.machine {
            Some(machine) => link::open_carrying(&uri, Share::ByUri, Arc::clone(machine)),
            None => link::open(&uri, Share::ByUri),
        };
        match opened {
            Ok(link) => Ok(self.around(link)),
            Err(error) => {
                *lock(&self.open) = Open::No { since: None, why: error.to_string() };
                Err(error)
            }
        }
    }

    /// Wraps the link to a board that was opened.
    pub fn around(self: &Arc<Self>, inner: Arc<dyn Link>) -> Arc<dyn Link> {
        if self.wanted == Wanted::Nothing {
            return inner;
        }
        let info = inner.info();
        lock(&self.frames).begin(info.slot, &self.uri, inner.network());
        {
            // Values from before the board was lost are cleared. The counts are kept, because a counter that falls
            // looks like a restart.
            let mut shown = lock(&self.shown);
            shown.board = None;
            shown.slaves.clear();
        }
        let watched = Arc::new(WatchedLink { inner, info, board: Arc::clone(self) });
        self.calls.opened.fetch_add(1, Ordering::Relaxed);
        *lock(&self.open) = Open::Yes(Arc::downgrade(&watched));
        watched
    }

    /// Checks the board and stores the result. Only the monitoring thread may call this, because on a network it may
    /// block.
    pub fn look(&self) -> Look {
        let look = match self.opened() {
            Ok(link) => self.look_at(&link),
            Err((stands, why)) => {
                let why = if why.is_empty() { "it is being opened" } else { &*why };
                Look { stats: None, stands, trouble: Some(format!("the board is not open: {why}")) }
            }
        };
        *lock(&self.looked) = look.clone();
        look
    }

    /// The link if the board is open. Otherwise how long opening it hangs (0 if it does not), and why it is not open.
    fn opened(&self) -> Result<Arc<WatchedLink>, (Duration, String)> {
        match &*lock(&self.open) {
            Open::No { since, why } => {
                let hangs = since.map(|since| since.elapsed()).filter(|elapsed| *elapsed > OPENING_MAX);
                Err((hangs.unwrap_or_default(), why.clone()))
            }
            Open::Yes(link) => link.upgrade().ok_or_else(|| (Duration::ZERO, "it was closed".to_owned())),
        }
    }

    fn look_at(&self, link: &WatchedLink) -> Look {
        let checked = link.inner.check();
        let stats = link.inner.stats();
        let sign = if link.info.virtual_time {
            None
        } else if let Some(lateness) = stats.lateness {
            Some(Sign::Cycles(lateness.cycles))
        } else if self.calls.reading.load(Ordering::Relaxed) > 0 {
            Some(Sign::Reports(self.calls.read.load(Ordering::Relaxed)))
        } else {
            // Nobody reads reports of this board at present, so missing reports mean nothing.
            None
        };
        let stands = lock(&self.progress).stands(sign, Instant::now());
        let state = lock(&self.shown).board.map_or(StateByte::NETWORK_INIT, |board| board.state);
        let trouble = match (&checked, sign) {
            (Err(error), _) => Some(format!("the board is gone: {error}")),
            (Ok(()), Some(sign)) if stands > SILENT => Some(trouble::silence(matches!(sign, Sign::Cycles(_)), stands)),
            (Ok(()), _) => trouble::of_network(&stats, state),
        };
        Look { stats: Some(stats), stands, trouble }
    }

    /// The result of the latest check.
    pub fn looked(&self) -> Look {
        lock(&self.looked).clone()
    }

    /// The values of the latest report.
    pub fn shown(&self) -> Shown {
        lock(&self.shown).clone()
    }

    /// The counts of the server's calls.
    pub fn counts(&self) -> CallCounts {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        CallCounts {
            written: read(&self.calls.written),
            read: read(&self.calls.read),
            write_errors: read(&self.calls.write_errors),
            read_errors: read(&self.calls.read_errors),
            opened: read(&self.calls.opened),
        }
    }
}

impl Progress {
    /// How long the sign of life has not changed. Without a sign the board counts as alive.
    fn stands(&mut self, sign: Option<Sign>, now: Instant) -> Duration {
        if sign.is_none() || self.sign != sign {
            (self.sign, self.since) = (sign, now);
        }
        now.saturating_duration_since(self.since)
    }
}

impl Layer for WatchedLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let (calls, done) = (&self.board.calls, self.inner.write(frame, wait));
        count(&done, &calls.written, &calls.write_errors);
        if let Ok(at) = done
            && self.board.wanted == Wanted::Metrics
        {
            lock(&self.board.frames).command(at.nanoseconds(), frame);
        }
        done
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let calls = &self.board.calls;
        calls.reading.fetch_add(1, Ordering::Relaxed);
        let done = self.inner.read(out, wait);
        calls.reading.fetch_sub(1, Ordering::Relaxed);
        count(&done, &calls.read, &calls.read_errors);
        if let Ok(meta) = done
            && self.board.wanted == Wanted::Metrics
        {
            let mut frames = lock(&self.board.frames);
            frames.report(meta.at.nanoseconds(), out);
            if let Ok(mut shown) = self.board.shown.try_lock() {
                frames.show(out, &mut shown);
            }
        }
        done
    }
}

/// Counts a call as successful or failed. A call that timed out, found the board silent or was cancelled is not
/// counted.
fn count<T>(done: &Result<T, LinkError>, good: &AtomicU64, bad: &AtomicU64) {
    let counted = match done {
        Ok(_) => good,
        Err(LinkError::Timeout { .. } | LinkError::Cancelled { .. } | LinkError::Silent { .. }) => return,
        Err(_) => bad,
    };
    counted.fetch_add(1, Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader of the values of a board does not block an exchange with the board. The values of the next report are
    /// stored again.
    #[test]
    fn a_reader_holds_up_no_exchange() {
        let uri = LinkUri::parse("sim:?slaves=drive&clock=virtual").expect("a link");
        let board = BoardWatch::new(&uri, None, Wanted::Metrics);
        assert!(board.look().trouble.is_some_and(|why| why.contains("not open")));
        let link = board.open().expect("a board");
        let read = || link.read(&mut Frame::new(), Wait::For(SILENT)).expect("a report");
        let reading = lock(&board.shown);
        read();
        assert!(reading.board.is_none() && board.counts().read == 1);
        drop(reading);
        read();
        assert!(board.shown().board.is_some() && board.counts().read == 2);
        let look = board.look();
        assert!(look.trouble.is_none() && look.stands.is_zero(), "virtual time stands between two calls: {look:?}");
        link.close();
        assert!(board.look().trouble.is_some_and(|why| why.starts_with("the board is gone: ")));
    }

    /// A board is alive as long as its sign of life changes. It also counts as alive if there is no sign to check.
    #[test]
    fn a_sign_that_stays_is_no_life() {
        let began = Instant::now();
        let at = |seconds| began + Duration::from_secs(seconds);
        let mut progress = Progress { sign: None, since: began };
        for (second, sign, stands) in [
            (1, Some(Sign::Cycles(7)), 0),
            (2, Some(Sign::Cycles(8)), 0),
            (5, Some(Sign::Cycles(8)), 3),
            (6, None, 0),
            (9, None, 0),
            (10, Some(Sign::Reports(8)), 0),
            (14, Some(Sign::Reports(8)), 4),
        ] {
            assert_eq!(progress.stands(sign, at(second)), Duration::from_secs(stands), "{second}");
        }
    }
}
