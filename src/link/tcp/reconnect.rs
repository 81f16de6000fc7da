//! A reader that connects again when its connection ends (`reconnect_ms=`). A writer never does: what became of its last
//! frame, and of the axes meanwhile, its program has to find out first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use super::{TcpLink, TcpOptions};
use crate::link::options::CommonOptions;
use crate::link::uri::LinkUri;
use crate::link::{Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::Frame;
use crate::span::Span;

/// Between two tries. \[OURS]
const PAUSE: Duration = Duration::from_millis(200);

pub(super) struct Reconnecting {
    uri: LinkUri,
    options: TcpOptions,
    common: CommonOptions,
    info: LinkInfo,
    current: Mutex<Arc<TcpLink>>,
    /// One thread connects at a time.
    turn: Mutex<()>,
    /// Ends the pause between two tries.
    rest: Mutex<u64>,
    cancelled: Condvar,
    closed: AtomicBool,
    /// What is added to the numbers of the current connection's reports: no number comes twice.
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
            turn: Mutex::default(),
            rest: Mutex::default(),
            cancelled: Condvar::new(),
            closed: AtomicBool::new(false),
            first: AtomicU64::new(0),
            next: AtomicU64::new(0),
        }
    }

    fn current(&self) -> Arc<TcpLink> {
        Arc::clone(&self.current.lock())
    }

    /// Replaces `gone`, which failed with `error`, by a new connection, before `until`.
    fn again(&self, gone: &Arc<TcpLink>, error: LinkError, until: Option<Instant>) -> Result<(), LinkError> {
        let cancels = *self.rest.lock();
        let _turn = self.turn.lock();
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
                Ok(link) if link.info().slot == self.info.slot => {
                    self.first.store(self.next.load(Ordering::Relaxed), Ordering::Relaxed);
                    let mut current = self.current.lock();
                    *current = Arc::new(link);
                    // A close that came meanwhile has closed the old one.
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
            let mut rest = self.rest.lock();
            if *rest == cancels {
                self.cancelled.wait_for(&mut rest, PAUSE);
            }
            if *rest != cancels && !self.closed.load(Ordering::Acquire) {
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
        let until = match wait {
            Wait::Forever => None,
            Wait::Now => Some(Instant::now()),
            Wait::For(limit) => Instant::now().checked_add(limit),
        };
        let mut wait = wait;
        loop {
            let link = self.current();
            match link.read(out, wait) {
                Ok(meta) => {
                    let sequence = meta.sequence.saturating_add(self.first.load(Ordering::Relaxed));
                    self.next.store(sequence.saturating_add(1), Ordering::Relaxed);
                    return Ok(ReadMeta { sequence, ..meta });
                }
                Err(error @ LinkError::Lost { .. }) => self.again(&link, error, until)?,
                Err(error) => return Err(error),
            }
            wait = until.map_or(wait, |until| match until.saturating_duration_since(Instant::now()) {
                Duration::ZERO => Wait::Now,
                left => Wait::For(left),
            });
        }
    }

    fn cancel(&self, dir: Dir) {
        self.current().cancel(dir);
        if dir == Dir::Read {
            *self.rest.lock() += 1;
            self.cancelled.notify_all();
        }
    }

    fn close(&self) {
        self.closed.store(true, Ordering::Release);
        *self.rest.lock() += 1;
        self.cancelled.notify_all();
        self.current().close();
    }

    /// A connection that is away may come again with the next read.
    fn check(&self) -> Result<(), LinkError> {
        if self.closed.load(Ordering::Acquire) { Err(LinkError::Closed) } else { Ok(()) }
    }

    fn stats(&self) -> LinkStats {
        self.current().stats()
    }
}
