//! A reader that connects again when its connection is lost (`reconnect_ms=`). A writer never does this: its program
//! first has to find out whether the last frame was executed and what the axes have done meanwhile.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::{TcpLink, TcpOptions};
use crate::address::uri::LinkUri;
use crate::link::common_options::CommonOptions;
use crate::link::{Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;
use crate::span::Span;

/// The pause between two attempts to connect again. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(200);
/// How often a read that waits for the thread that reconnects checks whether it was cancelled. \[OURS]
const CANCEL_CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// A reader's link that replaces its connection by a new one when it is lost.
pub(super) struct Reconnecting {
    uri: LinkUri,
    options: TcpOptions,
    common: CommonOptions,
    info: LinkInfo,
    current: Mutex<Arc<TcpLink>>,
    /// Locked by the thread that is reconnecting, so that only one thread does so at a time.
    connecting: Mutex<()>,
    /// The number of times that reads were cancelled. A thread that is reconnecting stops when it changes.
    cancels: Mutex<u64>,
    cancelled: Condvar,
    closed: AtomicBool,
    /// Each connection numbers its reports from 0, but the numbers that the program gets must not repeat. So `first` is
    /// added to the numbers of the current connection. `next` is the number after the last report that was read, and
    /// becomes `first` of the next connection.
    first: AtomicU64,
    next: AtomicU64,
}

impl Reconnecting {
    pub(super) fn new(link: TcpLink, uri: LinkUri, options: TcpOptions, common: CommonOptions) -> Self {
        Self {
            uri,
            options,
            common,
            info: link.info(),
            current: Mutex::new(Arc::new(link)),
            connecting: Mutex::default(),
            cancels: Mutex::default(),
            cancelled: Condvar::new(),
            closed: AtomicBool::new(false),
            first: AtomicU64::new(0),
            next: AtomicU64::new(0),
        }
    }

    fn current(&self) -> Arc<TcpLink> {
        Arc::clone(&self.current.lock())
    }

    /// Waits until no other thread reconnects. Fails with a timeout if `until` comes first. Also fails if the link was
    /// closed or the read was cancelled.
    fn turn(&self, cancels_before: u64, until: Option<Instant>) -> Result<MutexGuard<'_, ()>, LinkError> {
        loop {
            let now = Instant::now();
            let slice = now + CANCEL_CHECK_INTERVAL;
            if let Some(turn) = self.connecting.try_lock_until(until.map_or(slice, |until| until.min(slice))) {
                return Ok(turn);
            }
            if self.closed.load(Ordering::Acquire) {
                return Err(LinkError::Closed);
            }
            if *self.cancels.lock() != cancels_before {
                return Err(LinkError::Cancelled { dir: Dir::Read });
            }
            if until.is_some_and(|until| now >= until) {
                return Err(LinkError::Timeout { dir: Dir::Read, waited: Duration::ZERO, what: "connecting again" });
            }
        }
    }

    /// Replaces the connection `gone`, which has failed with `error`, by a new one, unless another thread has replaced
    /// it already. Fails with `error` after `reconnect_ms=` without a connection, or if the server now has another slot
    /// size. Fails with a timeout if `until` comes first. Also fails if the link was closed or the read was cancelled.
    fn reconnect(&self, gone: &Arc<TcpLink>, error: LinkError, until: Option<Instant>) -> Result<(), LinkError> {
        let cancels_before = *self.cancels.lock();
        let _connecting = self.turn(cancels_before, until)?;
        if !Arc::ptr_eq(gone, &self.current()) {
            return Ok(());
        }
        log::warn!("{error}; connecting again for {}", Span(self.options.reconnect));
        let give_up = Instant::now() + self.options.reconnect;
        loop {
            if self.closed.load(Ordering::Acquire) {
                return Err(LinkError::Closed);
            }
            match TcpLink::connect(&self.uri, &self.options, &self.common) {
                Ok(link) if self.info.slot.is_none_or(|slot| link.info().slot.is_none_or(|now| now == slot)) => {
                    self.first.store(self.next.load(Ordering::Relaxed), Ordering::Relaxed);
                    let mut current = self.current.lock();
                    *current = Arc::new(link);
                    // If the program has closed this link meanwhile, it has closed only the old connection: the new one
                    // is closed here.
                    if self.closed.load(Ordering::Acquire) {
                        current.close();
                        return Err(LinkError::Closed);
                    }
                    return Ok(());
                }
                Ok(_) => return Err(error),
                Err(why) => log::info!("{why}"),
            }
            let now = Instant::now();
            if now >= give_up {
                return Err(error);
            }
            if until.is_some_and(|until| now >= until) {
                return Err(LinkError::Timeout { dir: Dir::Read, waited: Duration::ZERO, what: "connecting again" });
            }
            let mut cancels = self.cancels.lock();
            if *cancels == cancels_before {
                self.cancelled.wait_for(&mut cancels, RETRY_PAUSE);
            }
            if *cancels != cancels_before && !self.closed.load(Ordering::Acquire) {
                return Err(LinkError::Cancelled { dir: Dir::Read });
            }
        }
    }
}

impl Link for Reconnecting {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn network(&self) -> Option<KnownNetwork> {
        self.current().network()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.current().write(frame, wait)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let until = wait.deadline();
        let mut wait = wait;
        loop {
            let link = self.current();
            match link.read(out, wait) {
                Ok(meta) => {
                    let sequence = meta.sequence.saturating_add(self.first.load(Ordering::Relaxed));
                    self.next.store(sequence.saturating_add(1), Ordering::Relaxed);
                    return Ok(ReadMeta { sequence, ..meta });
                }
                Err(error @ LinkError::Lost { .. }) => self.reconnect(&link, error, until)?,
                Err(error) => return Err(error),
            }
            wait = until.map_or(wait, |until| Wait::at_most(until.saturating_duration_since(Instant::now())));
        }
    }

    fn cancel(&self, dir: Dir) {
        self.current().cancel(dir);
        if dir == Dir::Read {
            *self.cancels.lock() += 1;
            self.cancelled.notify_all();
        }
    }

    fn close(&self) {
        self.closed.store(true, Ordering::Release);
        *self.cancels.lock() += 1;
        self.cancelled.notify_all();
        self.current().close();
    }

    /// Returns an error only if the program has closed the link. A lost connection is no error, because the next read
    /// makes a new one.
    fn check(&self) -> Result<(), LinkError> {
        if self.closed.load(Ordering::Acquire) { Err(LinkError::Closed) } else { Ok(()) }
    }

    fn stats(&self) -> LinkStats {
        self.current().stats()
    }
}
