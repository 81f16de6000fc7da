//! Monitors an ECM-XF chip that a server serves: a wrapper around the link of the chip counts the exchanges.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use ecmsk::link::chip::{self, ChipError, ChipInfo, ChipLink};
use ecmsk::xf::host::{HostConfig, Wires};

use crate::lock::lock;

/// The monitoring of a chip that a server serves.
#[derive(Default)]
pub struct ChipWatch {
    exchanges: AtomicU64,
    bytes: AtomicU64,
    errors: AtomicU64,
    opened: AtomicU64,
    /// Why the latest exchange, or the latest attempt to open the chip, has failed; `None` if it succeeded.
    failed: Mutex<Option<String>>,
}

/// The counts of a server's exchanges with its chip.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChipCounts {
    /// The exchanges with the chip.
    pub exchanges: u64,
    /// The bytes of all exchanges in one direction; the other direction has as many.
    pub bytes: u64,
    /// The exchanges that failed.
    pub errors: u64,
    /// How often the chip was opened.
    pub opened: u64,
}

/// The wrapper around the link of the chip.
struct WatchedChip {
    inner: Box<dyn ChipLink>,
    watch: Arc<ChipWatch>,
}

impl ChipWatch {
    /// Opens the chip of a link and returns the wrapped link.
    ///
    /// # Errors
    /// Those of [`chip::open`].
    pub fn open(self: &Arc<Self>, uri: &str) -> Result<(Box<dyn ChipLink>, HostConfig), ChipError> {
        let opened = chip::open(uri);
        self.note(opened.as_ref().err());
        let (inner, config) = opened?;
        self.opened.fetch_add(1, Ordering::Relaxed);
        Ok((Box::new(WatchedChip { inner, watch: Arc::clone(self) }), config))
    }

    fn note(&self, error: Option<&ChipError>) {
        // An exchange never waits for a reader of the reason: while the reason is being read, this result is not
        // stored.
        if let Ok(mut failed) = self.failed.try_lock()
            && (error.is_some() || failed.is_some())
        {
            *failed = error.map(ToString::to_string);
        }
    }

    /// The counts so far.
    pub fn counts(&self) -> ChipCounts {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        ChipCounts {
            exchanges: read(&self.exchanges),
            bytes: read(&self.bytes),
            errors: read(&self.errors),
            opened: read(&self.opened),
        }
    }

    /// Why the chip cannot be used, in words; `None` if its latest exchange succeeded or there was none yet.
    pub fn trouble(&self) -> Option<String> {
        let failed = lock(&self.failed);
        failed.as_ref().map(|why| format!("the chip: {why}"))
    }
}

impl Wires for WatchedChip {
    type Error = ChipError;

    fn now(&self) -> u64 {
        self.inner.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let done = self.inner.exchange(to_chip, from_chip);
        let count = if done.is_ok() { &self.watch.exchanges } else { &self.watch.errors };
        count.fetch_add(1, Ordering::Relaxed);
        self.watch.bytes.fetch_add(to_chip.len() as u64, Ordering::Relaxed);
        self.watch.note(done.as_ref().err());
        done
    }

    fn wait_until(&mut self, time: u64) -> Result<(), ChipError> {
        self.inner.wait_until(time)
    }

    fn wait_ready(&mut self, until: u64) -> Result<bool, ChipError> {
        self.inner.wait_ready(until)
    }
}

impl ChipLink for WatchedChip {
    fn info(&self) -> ChipInfo {
        self.inner.info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.inner.int1()
    }

    fn reset(&mut self) -> Result<bool, ChipError> {
        self.inner.reset()
    }
}
