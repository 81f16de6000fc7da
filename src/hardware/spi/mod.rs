//! The link `spi:`: a real ECM-SK on a spidev device, with BUSY and RESETN on lines of a GPIO chip.
//!
//! On SPI every exchange carries a command frame: the board sends a report only while it receives a frame, and in OP
//! that frame takes an entry of the board's FIFO. A program nevertheless gets the same reports as on USB, one per cycle
//! whether it writes or not. For this the link has a thread that makes one exchange per cycle, timed by a [`Pacer`]. An
//! exchange carries the oldest frame that the program has written, or else a frame of GET_STATUS commands.
//!
//! The drawback: if the program has no frame ready for a cycle, the link sends a frame of GET_STATUS commands. In the
//! board's FIFO this frame is an entry without targets, so the axes stand still for one cycle. A program that writes
//! ahead avoids this. For a program that is occasionally late there is the key `prefill=`: the link first fills the
//! board's FIFO with that many entries, and sends no GET_STATUS frame while they last.
//!
//! The number of free FIFO entries in a report is the number of frames that the program may still write: 160 less the
//! program's entries in the board's FIFO and less the program's frames that the link has not sent yet. Entries that the
//! link has added itself are not counted.
//!
//! Files, in the order in which to read them:
//!
//! - `options.rs`: the keys of `spi:` as Rust types, and which combinations are refused
//! - `queues.rs`: the frames and reports that the program's threads and the link's thread pass to each other
//! - `runner.rs`: the link's thread
//! - `pacer.rs`: the time of the next exchange and its content
//! - `sent_frames.rs`: the frames sent so far, to show the program the answers to its own commands
//! - `answer_check.rs`: whether an answer is valid, and if not, which wire is faulty
//! - `begin.rs`: the first exchanges, which test the wires

mod answer_check;
mod begin;

mod options;
mod pacer;
mod queues;
mod runner;
mod sent_frames;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

pub use self::answer_check::WiringFault;
#[doc(hidden)]
pub use self::answer_check::{AnswerCheck, InvalidAnswer};
pub use self::options::SpiOptions;
pub use self::pacer::{ExchangeContent, Pacer, PacerCounts, PacerOptions, PacerPlan, WaitingFrames};

pub(crate) use self::begin::next_step;
use self::begin::{begin, link_error};
use self::options::PERIOD_WITHOUT_BUSY;
pub(crate) use self::options::device;
use self::queues::FrameQueues;
use self::runner::{Runner, Shared};
use crate::address::uri::LinkUri;
use crate::io::spi::{BusyDevice, BusyWires};
use crate::link::call_counts::CallCounts;
use crate::link::common_options::CommonOptions;
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::{CycleTime, Frame, MasterCommand, MasterState};
use crate::threads;

/// How long closing the link waits for the frames written before to be sent. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// A link to a board on SPI.
pub struct SpiLink {
    info: LinkInfo,
    options: SpiOptions,
    busy: bool,
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
    counts: CallCounts,
}

/// Counters of the exchanges, frames and invalid answers of a link on SPI, in addition to the counters that every link
/// has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpiStats {
    /// Counters of the exchanges with the board.
    pub pacer: PacerCounts,
    /// Number of invalid answers, which were not passed on as reports.
    pub invalid_answers: u64,
    /// Number of the program's frames that were discarded before they were sent, because of a later SET_FIFO clear, a
    /// change of state out of OP, or SW_RESET.
    pub cleared: u64,
    /// Number of the program's frames that were not sent because the board was lost or the link was closed.
    pub unsent: u64,
    /// Number of the program's frames that are waiting to be sent.
    pub held: usize,
}

/// Opens the board that the URI names.
pub(crate) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<Arc<dyn Link>, LinkError> {
    let (options, places) = SpiOptions::from_uri(uri)?;
    let name = uri.to_string();
    let wires = BusyDevice::open(&places).map_err(|error| link_error(&name, error))?;
    Ok(Arc::new(SpiLink::over(&name, Box::new(wires), options, common)?))
}

impl SpiLink {
    /// A link over these wires; `name` is the name of the link in messages. Resets the board if RESETN is connected,
    /// and waits until the board answers.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`], which says which wire is faulty and what to do. [`LinkError::Io`] or
    /// [`LinkError::InUse`]: the SPI device or a GPIO line cannot be used.
    pub fn over(
        name: &str,
        mut wires: Box<dyn BusyWires>,
        options: SpiOptions,
        common: &CommonOptions,
    ) -> Result<Self, LinkError> {
        let mut answer_check = AnswerCheck::new(options.slot);
        let first = begin(name, &mut *wires, &options, &mut answer_check)?;
        let busy = wires.has_busy_line();
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
            queues: FrameQueues::new(common.queue),
            opened: Instant::now(),
            counts: Mutex::default(),
            cycle_us: AtomicU64::new(options.cycle.us().into()),
            invalid_answers: AtomicU64::new(0),
        });
        // The last exchange of `begin` ends here. The minimum time between two exchanges applies to the next exchange,
        // too.
        pacer.ended(shared.now());
        let runner =
            Runner { shared: shared.clone(), wires, options: options.clone(), pacer, answer_check, reset_doubt: 0 };
        let thread = threads::spawn("ecmsk-spi", move || runner.run());
        let thread = thread.map_err(|error| LinkError::no_thread(name, &error))?;
        let info = common.info(name.to_owned(), Some(options.slot));
        Ok(Self { info, options, busy, shared, thread: Mutex::new(Some(thread)), counts: CallCounts::default() })
    }

    /// The counters of this link.
    pub fn spi_stats(&self) -> SpiStats {
        let queues = self.shared.queues.counts();
        SpiStats {
            pacer: *self.shared.counts.lock(),
            invalid_answers: self.shared.invalid_answers.load(Ordering::Relaxed),
            cleared: queues.cleared,
            unsent: queues.unsent,
            held: queues.held,
        }
    }

    /// Refuses a frame that selects a cycle time (SET_DC) or requests OP, if the wires are too slow for the cycle time.
    /// All other frames are allowed.
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
}

impl Link for SpiLink {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let taken = self.refuse(frame).and_then(|()| self.shared.queues.write(frame, self.options.slot, wait.limit()));
        self.counts.write(taken).map(|()| Stamp(self.shared.now()))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.counts.read(self.shared.queues.read(out, wait.limit()))
    }

    fn cancel(&self, dir: Dir) {
        self.shared.queues.cancel(dir);
    }

    fn close(&self) {
        self.shared.queues.close(Instant::now() + CLOSE_LIMIT);
        if let Some(thread) = self.thread.lock().take() {
            // If the link's thread has panicked, the panic message has already been printed, and the result is not
            // needed.
            let _ = thread.join();
            let unsent = self.shared.queues.counts().unsent;
            if unsent > 0 {
                log::warn!(
                    "{}: {unsent} frames that were written did not go out before the link ended",
                    self.info.name
                );
            }
        }
    }

    fn check(&self) -> Result<(), LinkError> {
        self.shared.queues.check()
    }

    fn stats(&self) -> LinkStats {
        LinkStats { reports_dropped: self.shared.queues.counts().dropped, ..self.counts.stats() }
    }
}

impl Drop for SpiLink {
    fn drop(&mut self) {
        self.close();
    }
}
