//! The link `spi:`: a real ECM-SK on spidev, with BUSY and RESETN on lines of a GPIO chip.
//!
//! On SPI every exchange is a command frame: a report costs one, and in OP an entry of the board's FIFO. So that a program
//! sees what it sees on USB, one report a cycle whether it writes or not, the link has a thread with a [`Pacer`]. Each
//! cycle it exchanges the oldest frame that the program has written, or else GET_STATUS. What that costs: a program that
//! has no frame ready for a cycle (it *starves*) puts an entry without targets between two with them, one cycle in which
//! the axes stand still. A program that writes ahead never does; against one that is late at times there is the key
//! `prefill=`: so many entries wait in the board's FIFO, and while they last, no GET_STATUS goes between.
//!
//! The free count in a report is what the program may still write: 160 less its own entries in the board's FIFO and less
//! its frames that the link holds. Entries that the link has put in itself are none that a program knows of.

mod begin;
mod desk;
mod judge;
mod options;
mod pacer;
mod runner;
mod sent;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

pub use self::judge::Lie;
#[doc(hidden)]
pub use self::judge::{Judge, NoAnswer};
pub use self::options::SpiOptions;
pub use self::pacer::{Carry, Held, Pacer, PacerCounts, PacerOptions, Plan};

use self::begin::{begin, refused};
use self::desk::{Desk, Refused};
use self::options::PERIOD_WITHOUT_BUSY;
use self::runner::{Runner, Shared};
use super::options::CommonOptions;
use super::uri::LinkUri;
use super::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::io::spi::{Device, Wires};
use crate::sk::{CycleTime, Frame, MasterCommand, MasterState};
use crate::threads;

/// How long closing lets frames go out that were written before. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// A board on SPI.
pub struct SpiLink {
    info: LinkInfo,
    options: SpiOptions,
    busy: bool,
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
    written: AtomicU64,
    read: AtomicU64,
    write_errors: AtomicU64,
    read_errors: AtomicU64,
}

/// What a link on SPI has done, besides what every link counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpiStats {
    /// Of its exchanges.
    pub pacer: PacerCounts,
    /// Answers that were none and were not handed on.
    pub garbled: u64,
    /// Frames of the host that were taken back by a later one: SET_FIFO clear, leaving OP, SW_RESET.
    pub cleared: u64,
    /// Frames of the host that did not go out because the board was lost or the link was closed.
    pub unsent: u64,
    /// Frames of the host that wait now.
    pub held: usize,
}

/// Opens the board that the URI names.
pub(super) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<Arc<dyn Link>, LinkError> {
    let (options, places) = SpiOptions::from_uri(uri)?;
    let name = uri.to_string();
    let wires = Device::open(&places).map_err(|error| refused(&name, error))?;
    Ok(Arc::new(SpiLink::over(&name, Box::new(wires), options, common)?))
}

impl SpiLink {
    /// A link over these wires; `name` is what messages call it. Resets the board if there is a wire for that, and waits
    /// until it answers.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`], which says which wire lies and what to do; [`LinkError::Io`].
    pub fn over(
        name: &str,
        mut wires: Box<dyn Wires>,
        options: SpiOptions,
        common: &CommonOptions,
    ) -> Result<Self, LinkError> {
        let mut judge = Judge::new(options.slot);
        let first = begin(name, &mut *wires, &options, &mut judge)?;
        let busy = wires.has_busy();
        let mut pacer = Pacer::new(PacerOptions {
            slot: options.slot,
            cycle: options.cycle,
            prefill: options.prefill,
            period_ns: if busy { 0 } else { PERIOD_WITHOUT_BUSY.as_nanos() as u64 },
            wires_ns: options.on_the_wires().as_nanos() as u64,
        });
        pacer.answered(&first, false, 0);
        let shared = Arc::new(Shared {
            name: name.to_owned(),
            desk: Desk::new(common.queue),
            opened: Instant::now(),
            counts: Mutex::default(),
            cycle_us: AtomicU64::new(options.cycle.us().into()),
            garbled: AtomicU64::new(0),
        });
        // The last of the first exchanges was a moment ago.
        pacer.ended(shared.now());
        let runner = Runner { shared: shared.clone(), wires, options: options.clone(), pacer, judge, doubt: 0 };
        let thread = threads::spawn("ecmsk-spi", move || runner.run()).map_err(|error| LinkError::Io {
            what: format!("start the thread of `{name}`"),
            message: format!("{error}; free some threads (`ulimit -u`) and open it again"),
        })?;
        let info = LinkInfo {
            name: name.to_owned(),
            slot: Some(options.slot),
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: common.read_wait(),
            write_wait: common.write_wait(),
        };
        Ok(Self {
            info,
            options,
            busy,
            shared,
            thread: Mutex::new(Some(thread)),
            written: AtomicU64::new(0),
            read: AtomicU64::new(0),
            write_errors: AtomicU64::new(0),
            read_errors: AtomicU64::new(0),
        })
    }

    /// What it has done.
    pub fn spi_stats(&self) -> SpiStats {
        let desk = self.shared.desk.counts();
        SpiStats {
            pacer: *self.shared.counts.lock(),
            garbled: self.shared.garbled.load(Ordering::Relaxed),
            cleared: desk.cleared,
            unsent: desk.unsent,
            held: desk.held,
        }
    }

    /// Whether the wires are too slow for the cycle that a frame sets or begins.
    fn refuse(&self, frame: &Frame) -> Result<(), LinkError> {
        let size = self.options.slot;
        let cycle = match MasterCommand::decode(&frame.slot(size, 0), size) {
            Ok(MasterCommand::SetDc { cycle, .. }) => Some(cycle),
            Ok(MasterCommand::SetState(MasterState::Op)) => {
                CycleTime::from_us(self.shared.cycle_us.load(Ordering::Relaxed) as u32)
            }
            _ => None,
        };
        match cycle.and_then(|cycle| self.options.refuses(cycle, self.busy)) {
            Some(message) => Err(LinkError::Io {
                what: format!("the frame was not sent to the board at `{}`", self.info.name),
                message,
            }),
            None => Ok(()),
        }
    }

    fn error(&self, dir: Dir, refused: Refused) -> LinkError {
        match refused {
            Refused::Timeout(waited) => {
                let what = match dir {
                    Dir::Read => "the board sent no report",
                    Dir::Write => "the board takes no more frames",
                };
                LinkError::Timeout { dir, waited, what }
            }
            Refused::Error(error) => error,
        }
    }
}

const fn limit(wait: Wait) -> Option<Duration> {
    match wait {
        Wait::Forever => None,
        Wait::For(limit) => Some(limit),
        Wait::Now => Some(Duration::ZERO),
    }
}

impl Link for SpiLink {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let taken = self.refuse(frame).and_then(|()| {
            let done = self.shared.desk.write(frame, self.options.slot, limit(wait));
            done.map_err(|refused| self.error(Dir::Write, refused))
        });
        let counter = if taken.is_ok() { &self.written } else { &self.write_errors };
        counter.fetch_add(1, Ordering::Relaxed);
        taken.map(|()| Stamp(self.shared.now()))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let got = self.shared.desk.read(out, limit(wait)).map_err(|refused| self.error(Dir::Read, refused));
        let counter = if got.is_ok() { &self.read } else { &self.read_errors };
        counter.fetch_add(1, Ordering::Relaxed);
        got.map(|(at, sequence, dropped)| ReadMeta { at: Stamp(at), sequence, dropped })
    }

    fn cancel(&self, dir: Dir) {
        self.shared.desk.cancel(dir);
    }

    fn close(&self) {
        self.shared.desk.close(Instant::now() + CLOSE_LIMIT);
        if let Some(thread) = self.thread.lock().take() {
            // A panic in it would have no one to hear of it.
            let _ = thread.join();
            let unsent = self.shared.desk.counts().unsent;
            if unsent > 0 {
                log::warn!(
                    "{}: {unsent} frames that were written did not go out before the link ended",
                    self.info.name
                );
            }
        }
    }

    fn check(&self) -> Result<(), LinkError> {
        self.shared.desk.check()
    }

    fn stats(&self) -> LinkStats {
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LinkStats {
            written: count(&self.written),
            read: count(&self.read),
            reports_dropped: self.shared.desk.counts().dropped,
            write_errors: count(&self.write_errors),
            read_errors: count(&self.read_errors),
            ..LinkStats::default()
        }
    }
}

impl Drop for SpiLink {
    fn drop(&mut self) {
        self.close();
    }
}
