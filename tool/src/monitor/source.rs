//! The source of the frames that the monitor shows: a board or a recording. A separate thread reads it, so that no
//! report of a board is missed.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecmsk::ecm::{Close, Ecm, EcmError, Options};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Dir, KnownNetwork, Link, LinkError, Share};
use ecmsk::sk::{Frame, SlotSize};

use super::watched::{View, Watched};
use super::{CliError, MonitorError};
use crate::lock::lock;
use crate::recording::{self, Framed, Frames};

/// The longest wait for one report. After it the thread checks whether the monitor has ended. \[OURS]
const READ_WAIT_MAX: Duration = Duration::from_millis(200);

/// A callback for each report. Its arguments are the time in nanoseconds on the board's clock, the frame, and the slot
/// size. It must not block, since this would delay the reading of reports.
pub type Each = Box<dyn FnMut(i64, &Frame, SlotSize) + Send>;

/// A function that may wrap the link of the board before it is used.
pub type Around = Box<dyn FnOnce(Arc<dyn Link>) -> Arc<dyn Link>>;

/// A board or a recording that a thread reads, and the state that the thread collects.
pub struct Feed {
    watched: Arc<Mutex<Watched>>,
    stop: Arc<AtomicBool>,
    link: Option<Arc<dyn Link>>,
    /// The error that has ended the thread, until [`Self::view`] returns it.
    failed: Arc<Mutex<Option<EcmError>>>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Opens a board, and sends nothing to it. `each` is called with each report.
    pub fn board(
        uri: &LinkUri,
        slot: Option<SlotSize>,
        around: Around,
        mut each: Each,
        watched: impl FnOnce(Option<KnownNetwork>) -> Watched,
    ) -> Result<Self, MonitorError> {
        let link = around(link::open(&uri.to_string(), Share::ByName)?);
        let mut watched = watched(link.network());
        let options = Options { slot, close: Close::Leave, ..Options::default() };
        let ecm = Ecm::over(Arc::clone(&link), options)?;
        let size = ecm.slot_size()?;
        watched.live = true;
        let first = ecm.snapshot()?;
        watched.report(first.meta.at.nanoseconds(), first.frame(), size);
        each(first.meta.at.nanoseconds(), first.frame(), size);
        let failed = Arc::new(Mutex::new(None));
        let problem = Arc::clone(&failed);
        Self::start(watched, Some(link), failed, move |watched, stop| {
            let end = read(&ecm, size, &mut each, watched, stop);
            if let Err(error) = end {
                lock(watched).end = Some(error.to_string());
                *lock(&problem) = Some(error);
            }
        })
    }

    /// Opens a recording and plays it at its recorded speed.
    pub fn recording(file: PathBuf, slot: Option<SlotSize>, watched: Watched) -> Result<Self, MonitorError> {
        Self::start(watched, None, Arc::default(), move |watched, stop| {
            let (began, mut first_ns) = (Instant::now(), None);
            let played = walk(&file, slot, |framed| {
                // Playing begins with the first frame. Otherwise a section of a long recording would begin hours later.
                let since_ns = framed.time_ns.saturating_sub(*first_ns.get_or_insert(framed.time_ns));
                let due = began + Duration::from_nanos(since_ns.max(0).unsigned_abs());
                while Instant::now() < due && !stop.load(Ordering::Relaxed) {
                    thread::sleep(due.saturating_duration_since(Instant::now()).min(READ_WAIT_MAX));
                }
                take(&mut lock(watched), framed);
                Ok(!stop.load(Ordering::Relaxed))
            });
            lock(watched).end = Some(match played {
                Ok(None) => "the recording ends here".to_owned(),
                Ok(Some(damage)) => damage,
                Err(error) => error.to_string(),
            });
        })
    }

    fn start(
        watched: Watched,
        link: Option<Arc<dyn Link>>,
        failed: Arc<Mutex<Option<EcmError>>>,
        work: impl FnOnce(&Mutex<Watched>, &AtomicBool) + Send + 'static,
    ) -> Result<Self, MonitorError> {
        let watched = Arc::new(Mutex::new(watched));
        let stop = Arc::new(AtomicBool::new(false));
        let (seen, end) = (Arc::clone(&watched), Arc::clone(&stop));
        let thread = thread::Builder::new().name("board".into()).spawn(move || work(&seen, &end));
        Ok(Self { watched, stop, link, failed, thread: Some(thread.map_err(MonitorError::Thread)?) })
    }

    /// The slaves and units of the network, as reported by the server of a link; they may change while the link is
    /// open. `None` for a recording, or if the link does not report them.
    #[cfg(feature = "web")]
    pub fn network(&self) -> Option<KnownNetwork> {
        self.link.as_ref()?.network()
    }

    /// The present view, and the error that has ended the source, if there is one. An error is returned only once.
    pub fn view(&self) -> (View, Option<MonitorError>) {
        let counters = self.link.as_ref().and_then(|link| link.stats().board);
        let mut watched = lock(&self.watched);
        watched.counters = counters;
        let failed = lock(&self.failed).take();
        (watched.view(), failed.map(MonitorError::Board))
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(link) = &self.link {
            link.cancel(Dir::Read);
        }
        if let Some(thread) = self.thread.take() {
            // The result is ignored, because a panic of the thread was already printed.
            let _ = thread.join();
        }
    }
}

/// Reads reports until `stop` is set or the board is lost.
fn read(
    ecm: &Ecm,
    size: SlotSize,
    each: &mut Each,
    watched: &Mutex<Watched>,
    stop: &AtomicBool,
) -> Result<(), EcmError> {
    let virtual_time = ecm.link_info().virtual_time;
    let mut began = None;
    while !stop.load(Ordering::Relaxed) {
        let snapshot = match ecm.next_cycle(READ_WAIT_MAX) {
            Ok(snapshot) => snapshot,
            Err(EcmError::NoReport { .. } | EcmError::Link(LinkError::Cancelled { .. })) => continue,
            Err(error) => return Err(error),
        };
        let stats = ecm.stats()?;
        each(snapshot.meta.at.nanoseconds(), snapshot.frame(), size);
        {
            let mut watched = lock(watched);
            watched.report(snapshot.meta.at.nanoseconds(), snapshot.frame(), size);
            watched.counts.lost = stats.reports_lost;
            watched.counts.bad_crc = stats.bad_crc;
        }
        if virtual_time {
            // Virtual time advances only in calls of the link. The thread waits between them, so that virtual time runs
            // no faster than real time.
            let at = Duration::from_nanos(snapshot.meta.at.0);
            let (since, first) = *began.get_or_insert((Instant::now(), at));
            thread::sleep(at.saturating_sub(first).saturating_sub(since.elapsed()).min(READ_WAIT_MAX));
        }
    }
    Ok(())
}

/// Processes a frame of a recording.
pub fn take(watched: &mut Watched, framed: &Framed) {
    if let Some(firmware) = recording::firmware(framed.meta.as_deref()) {
        watched.firmware = firmware;
    }
    match framed.recorded.dir {
        Dir::Write => watched.command(&framed.recorded.frame, framed.size),
        Dir::Read => watched.report(framed.time_ns, &framed.recorded.frame, framed.size),
    }
}

/// Calls `show` with the frames of a recording, sorted by time, until `show` returns false. Returns why the recording
/// ends early or what it lacks; `None` if it is complete, or if `show` has returned false.
pub fn walk(
    file: &Path,
    slot: Option<SlotSize>,
    show: impl FnMut(&Framed) -> Result<bool, CliError>,
) -> Result<Option<String>, CliError> {
    let mut frames = Frames::open(file, slot, None)?;
    let walked = frames.walk_while(i64::MAX, show)?;
    if !walked.is_whole {
        return Ok(None);
    }
    let damage = walked.damage.map(|damage| damage.to_string());
    Ok(damage.or_else(|| frames.lacks().map(|lacks| format!("{}: {lacks}", file.display()))))
}
