//! Where reports come from: a board, read by a thread of its own so that none is missed, or a recording.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecmsk::ecm::{Close, Ecm, EcmError, Options};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Dir, KnownNetwork, Link, LinkError, ReadMeta, Share};
use ecmsk::recording::RecordError;
use ecmsk::sk::SlotSize;

use super::watched::{View, Watched};
use super::{CliError, MonitorError};
use crate::recording::{self, Framed, Frames, InTime};

/// A wait for a report ends after that long, to look whether the monitor has ended. \[OURS]
const PATIENCE: Duration = Duration::from_millis(200);

/// What is seen, while a thread goes on looking.
pub struct Feed {
    watched: Arc<Mutex<Watched>>,
    stop: Arc<AtomicBool>,
    link: Option<Arc<dyn Link>>,
    /// Why the thread has ended.
    failed: Arc<Mutex<Option<EcmError>>>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// A board: it is opened as it is, and left as it is.
    pub fn board(
        uri: &LinkUri,
        slot: Option<SlotSize>,
        watched: impl FnOnce(Option<KnownNetwork>) -> Watched,
    ) -> Result<Self, MonitorError> {
        let link = link::open(&uri.to_string(), Share::ByName)?;
        let mut watched = watched(link.network());
        let options = Options { slot, close: Close::Leave, ..Options::default() };
        let ecm = Ecm::over(Arc::clone(&link), options)?;
        let size = ecm.slot_size()?;
        watched.live = true;
        let first = ecm.snapshot()?;
        watched.report(nanoseconds(first.meta), first.frame(), size);
        let failed = Arc::new(Mutex::new(None));
        let problem = Arc::clone(&failed);
        Ok(Self::start(watched, Some(link), failed, move |watched, stop| {
            let end = read(&ecm, size, watched, stop);
            if let Err(error) = end {
                lock(watched).end = Some(error.to_string());
                *problem.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
        }))
    }

    /// A recording, as fast as it was.
    pub fn recording(file: PathBuf, slot: Option<SlotSize>, watched: Watched) -> Result<Self, RecordError> {
        // What is no recording is told before the screen is taken.
        drop(Frames::open(&file, slot, None)?);
        Ok(Self::start(watched, None, Arc::default(), move |watched, stop| {
            let began = Instant::now();
            let played = walk(&file, slot, |framed| {
                let due = began + Duration::from_nanos(framed.time_ns.max(0).unsigned_abs());
                while Instant::now() < due && !stop.load(Ordering::Relaxed) {
                    thread::sleep(due.saturating_duration_since(Instant::now()).min(PATIENCE));
                }
                take(&mut lock(watched), &framed);
                Ok(!stop.load(Ordering::Relaxed))
            });
            lock(watched).end = Some(match played {
                Ok(None) => "the recording ends here".to_owned(),
                Ok(Some(damage)) => damage,
                Err(error) => error.to_string(),
            });
        }))
    }

    fn start(
        watched: Watched,
        link: Option<Arc<dyn Link>>,
        failed: Arc<Mutex<Option<EcmError>>>,
        work: impl FnOnce(&Mutex<Watched>, &AtomicBool) + Send + 'static,
    ) -> Self {
        let watched = Arc::new(Mutex::new(watched));
        let stop = Arc::new(AtomicBool::new(false));
        let (seen, end) = (Arc::clone(&watched), Arc::clone(&stop));
        let thread = thread::spawn(move || work(&seen, &end));
        Self { watched, stop, link, failed, thread: Some(thread) }
    }

    /// What there is to show now, and why there will be no more.
    pub fn view(&self) -> (View, Option<MonitorError>) {
        let counters = self.link.as_ref().and_then(|link| link.stats().board);
        let mut watched = lock(&self.watched);
        watched.counters = counters;
        let failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner).take();
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
            // A panic there was told already.
            let _ = thread.join();
        }
    }
}

/// Reads until it is told to stop, or the board is gone.
fn read(ecm: &Ecm, size: SlotSize, watched: &Mutex<Watched>, stop: &AtomicBool) -> Result<(), EcmError> {
    let virtual_time = ecm.link_info().virtual_time;
    let mut began = None;
    while !stop.load(Ordering::Relaxed) {
        let snapshot = match ecm.next_cycle(PATIENCE) {
            Ok(snapshot) => snapshot,
            Err(EcmError::NoReport { .. } | EcmError::Link(LinkError::Cancelled { .. })) => continue,
            Err(error) => return Err(error),
        };
        let stats = ecm.stats()?;
        {
            let mut watched = lock(watched);
            watched.report(nanoseconds(snapshot.meta), snapshot.frame(), size);
            watched.counts.lost = stats.reports_lost;
            watched.counts.bad_crc = stats.bad_crc;
        }
        if virtual_time {
            // Time that passes by calls alone is let pass as fast as on a clock.
            let at = Duration::from_nanos(snapshot.meta.at.0);
            let (since, first) = *began.get_or_insert((Instant::now(), at));
            thread::sleep(at.saturating_sub(first).saturating_sub(since.elapsed()).min(PATIENCE));
        }
    }
    Ok(())
}

/// A frame of a recording goes by.
pub fn take(watched: &mut Watched, framed: &Framed) {
    if let Some(firmware) = recording::firmware(framed.meta.as_deref()) {
        watched.firmware = firmware;
    }
    match framed.recorded.dir {
        Dir::Write => watched.command(&framed.recorded.frame, framed.size),
        Dir::Read => watched.report(framed.time_ns, &framed.recorded.frame, framed.size),
    }
}

/// Shows the frames of a recording in the order of time until one says no; gives what is wrong with its end, or what it
/// lacks.
pub fn walk(
    file: &Path,
    slot: Option<SlotSize>,
    mut show: impl FnMut(Framed) -> Result<bool, CliError>,
) -> Result<Option<String>, CliError> {
    let mut order = InTime::default();
    let mut damage = None;
    let mut frames = Frames::open(file, slot, None)?;
    for framed in &mut frames {
        match framed {
            Ok(framed) => {
                if let Some(framed) = order.push(framed)
                    && !show(framed)?
                {
                    return Ok(None);
                }
            }
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => {
                damage = Some(error.to_string())
            }
            Err(error) => return Err(error.into()),
        }
    }
    while let Some(framed) = order.pop() {
        if !show(framed)? {
            return Ok(None);
        }
    }
    Ok(damage.or_else(|| frames.lacks().map(|lacks| format!("{}: {lacks}", file.display()))))
}

/// When a report was made.
fn nanoseconds(meta: ReadMeta) -> i64 {
    i64::try_from(meta.at.0).unwrap_or(i64::MAX)
}

fn lock(watched: &Mutex<Watched>) -> MutexGuard<'_, Watched> {
    watched.lock().unwrap_or_else(PoisonError::into_inner)
}
