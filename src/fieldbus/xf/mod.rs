//! A network behind an ECM-XF: the board's jobs as commands of the chip, and its process data through the chip's FIFOs.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`XfBus`], the implementation of [`Fieldbus`] |
//! | `chip_bus.rs` | the state of the bus, without the async function of its running job |
//! | `options.rs` | [`XfBusOptions`] |
//! | `jobs.rs`, `jobs/` | scan, configuration and changes of state as async functions, and in `run.rs` the polling of these |
//! | `ask.rs` | one command of the chip and its answer |
//! | `ahead.rs` | the preparation of a configuration that was not requested yet |
//! | `flow.rs` | process data: the sets and cycles that each exchange writes and reads |
//! | `plan.rs` | the packet size, sets per exchange and exchanges in flight that a cycle needs |
//! | `level.rs` | an estimate of the number of sets of outputs in the chip |
//! | `ledger.rs` | which outputs each cycle carried |
//! | `answers.rs` | the inputs of the chip's cycles, until they are polled |
//! | `clear.rs` | emptying the chip's FIFO, and which sets were sent by then |
//! | `watch.rs` | lost slaves, and resets of the chip |
//! | `local_io.rs` | local inputs and outputs at pins of the chip |
//! | `network.rs` | the chip's network as the bus knows it |
//!
//! The bus steps the driver ([`Host`]) over its wires until the wires' clock has reached the time of the engine's poll. It
//! starts no thread.

mod ahead;
mod answers;
mod ask;
mod chip_bus;
mod clear;
mod flow;
mod jobs;
mod ledger;
mod level;
mod local_io;
mod network;
mod options;
pub mod plan;
mod watch;

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};

use super::{
    AlState, BusConfig, BusError, Busy, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing,
    SdoDone, SdoRequest,
};
use crate::sk::CycleTime;
use crate::xf::host::{Host, HostConfig, HostState, StepError, Wires};
use ask::Ask;
use chip_bus::ChipBus;
use jobs::{Running, Sequence, run_job};
pub use local_io::LocalPins;
pub use options::XfBusOptions;

/// The maximum number of cycles by which the engine polls the answer to a cycle late: the chip keeps this many TxPDOs
/// until they are read (XF EN 1236). \[OURS]
const ANSWER_DELAY: u16 = 64;
/// The number of entries that are requested for each of the chip's FIFOs. Fewer are requested if the chip's memory does not
/// hold them. \[OURS]
const ENTRIES: usize = 64;
/// The number of sets of outputs that are always on their way in a steady stream: one waits for its exchange, one is in
/// the running exchange, and one is in the chip until its next cycle. \[OURS]
const ON_THE_WAY: u64 = 3;
/// The maximum time that the bus gets for exchanges in each step in which a late runner catches up, ns. It is enough
/// for about two exchanges with the longest packets at 24 MHz. \[OURS]
const CATCH_UP_NS: Ns = 1_000_000;
/// The size of the chip's memory for both FIFOs together, bytes (XF EN 1236).
const FIFO_MEMORY: usize = 0x4000;

/// The counters of a bus over an ECM-XF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct XfBusCounters {
    /// How many sets of outputs were given up, because the chip has not accepted them or it is unknown whether it has.
    pub sets_lost: u64,
    /// How many cycles of the chip were not reported because their inputs were lost.
    pub cycles_lost: u64,
    /// How many resets of the chip were noticed.
    pub chip_resets: u64,
}

/// The number of entries of each of the chip's FIFOs with `process_bytes` bytes of process data in both directions
/// together. At most 64, fewer if the chip's memory does not hold them, and at least 1.
pub fn fifo_entries(process_bytes: usize) -> u8 {
    (FIFO_MEMORY / process_bytes.max(1)).clamp(1, ENTRIES) as u8
}

/// A network behind an ECM-XF.
pub struct XfBus<W> {
    bus: Arc<Mutex<ChipBus<W>>>,
    /// The slot for the future of the running job.
    sequence: Sequence,
}

impl<W: fmt::Debug> fmt::Debug for XfBus<W> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.bus.lock().fmt(formatter)
    }
}

impl<W: Wires + Send + 'static> XfBus<W> {
    /// Creates a bus for the network of the chip behind these wires, and starts the chip.
    pub fn new(wires: W, config: HostConfig, options: XfBusOptions) -> Self {
        let bus = Arc::new(Mutex::new(ChipBus::new(wires, config, options)));
        let sequence = jobs::place_of(&bus);
        Self { bus, sequence }
    }
}

impl<W: Wires> XfBus<W> {
    /// The wires to the chip, for reading their state.
    pub fn wires(&self) -> impl Deref<Target = W> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.wires)
    }

    /// The wires to the chip, for causing faults in tests.
    pub fn wires_mut(&mut self) -> impl DerefMut<Target = W> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.wires)
    }

    /// The driver of the chip, for reading its state.
    pub fn host(&self) -> impl Deref<Target = Host> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.host)
    }

    /// The counters of the bus.
    pub fn counters(&self) -> XfBusCounters {
        self.bus.lock().counters
    }

    /// Starts the driver, and waits until the chip has answered.
    ///
    /// # Errors
    /// The chip does not answer, or the wires cannot be used.
    pub fn start_up(&mut self) -> Result<(), StepError<W::Error>> {
        let ChipBus { host, wires, .. } = &mut *self.bus.lock();
        while host.state() != HostState::Running {
            host.step(wires, Ns::MAX)?;
        }
        Ok(())
    }

    /// Lets the bus work until the engine's time is `now`, and returns the bus with its lock.
    fn advance(&mut self, now: Ns) -> MutexGuard<'_, ChipBus<W>> {
        self.work(|bus| bus.wires_time(now))
    }

    /// Makes exchanges and waits until the time `until` on the clock of the wires to the chip, and returns the bus with
    /// its lock.
    fn work(&mut self, until: impl FnOnce(&mut ChipBus<W>) -> Ns) -> MutexGuard<'_, ChipBus<W>> {
        let Self { bus, sequence } = self;
        let mut bus = bus.lock();
        let until = until(&mut bus);
        while bus.wires.now() < until {
            turn(&mut bus, sequence);
            let ChipBus { host, wires, .. } = &mut *bus;
            match host.step(wires, until) {
                Ok(()) => bus.stopped_at = None,
                Err(error) => {
                    bus.stopped(&error, until);
                    if bus.wires.now() < until {
                        break;
                    }
                }
            }
        }
        turn(&mut bus, sequence);
        bus
    }
}

/// Evaluates the driver's results, polls the running job, and gives the driver its next work.
fn turn<W: Wires>(bus: &mut MutexGuard<'_, ChipBus<W>>, sequence: &mut Sequence) {
    let now = bus.wires.now();
    if bus.begin_turn(now) {
        run_job(bus, sequence, now);
        bus.end_turn(now);
    }
}

impl<W: Wires + Send> Fieldbus for XfBus<W> {
    fn pacing(&self) -> Pacing {
        Pacing::Bus { depth: ENTRIES as u16, answer_delay: ANSWER_DELAY }
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        let bus = &mut *self.bus.lock();
        let at = bus.wires_time(now);
        match job {
            Job::Configure(config) if bus.lays_out_ahead(&config) => bus.next_job = Some(Running::new(job, at)),
            _ if bus.sdo.is_some() || !bus.make_way() => return Err(Busy),
            job => {
                bus.end_ahead();
                if matches!(job, Job::State { target, .. } if target <= AlState::PreOp) {
                    // [OURS] After a change to PreOP or below, the next change to SafeOP gets a new layout of the
                    // process data, as with the manufacturers' drivers.
                    bus.network.laid_out = false;
                }
                bus.begin_job(Some(Running::new(job, at)));
            }
        }
        Ok(())
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        let bus = &mut *self.bus.lock();
        let at = bus.wires_time(now);
        if bus.sdo.is_some() || !bus.make_way() {
            return Err(Busy);
        }
        bus.note_sdo(&request);
        let SdoRequest { slave, object, write, timeout_ns } = request;
        let ask = match write {
            None => Ask::Upload { slave, object, timeout_ns },
            Some((size, value)) => Ask::Download { slave, object, size, value, timeout_ns },
        };
        match ask.submit(&mut bus.host, at) {
            Ok(asked) => bus.sdo = Some((request, asked)),
            Err(error) => bus.sdo_done = Some(jobs::sdo_done(&request, Err(error))),
        }
        Ok(())
    }

    fn prepare(&mut self, config: &BusConfig, _now: Ns) {
        self.bus.lock().declare(config);
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.advance(now).job_done.take()
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        let is_under_way = self.bus.lock().sdo.is_some();
        let mut bus = if is_under_way { self.advance(now) } else { self.bus.lock() };
        bus.sdo_done.take()
    }

    fn cancel_job(&mut self) {
        let bus = &mut *self.bus.lock();
        (bus.job, bus.next_job) = (None, None);
        bus.abandon_job();
        bus.job_done = None;
    }

    fn cancel_sdo(&mut self) {
        let bus = &mut *self.bus.lock();
        if let Some((_, asked)) = bus.sdo.take() {
            asked.abandon(&mut bus.host);
        }
        bus.sdo_done = None;
    }

    fn room(&self) -> u16 {
        self.bus.lock().room()
    }

    fn held_estimate(&self) -> Option<u64> {
        Some(self.bus.lock().held().saturating_sub(ON_THE_WAY))
    }

    fn clear_ahead(&mut self, _now: Ns) {
        self.bus.lock().begin_clear();
    }

    fn poll_clear(&mut self, now: Ns) -> Option<Cleared> {
        self.advance(now).take_cleared()
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        let mut bus = self.bus.lock();
        if bus.has_stopped() {
            return Err(BusError::Down);
        }
        if bus.room() == 0 {
            return Err(BusError::Full);
        }
        let set = bus.set_of(outputs);
        bus.queue.push_back(set);
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let mut bus = self.advance(now);
        if bus.has_stopped() {
            return None;
        }
        let done = if bus.runs { bus.next_answer(now) } else { bus.next_tick(now) }?;
        bus.fill(inputs);
        bus.told_lost = bus.network.lost;
        Some(done)
    }

    fn work_until(&mut self, now: Ns, until: Ns) {
        drop(self.work(|bus| {
            let wires = bus.wires.now();
            if bus.options.real_time {
                (bus.skew, bus.has_runner) = (Some(now.wrapping_sub(wires)), true);
            }
            // \[OURS] A late runner catches up in steps. In each step the bus gets real time for exchanges: a cycle, or
            // [`CATCH_UP_NS`] if that is less. So the chip's FIFO is filled at once after a stall, and a machine that
            // is too slow for its cycles still makes exchanges.
            let behind_ns = bus.network.cycle.ns().min(CATCH_UP_NS);
            if now < until { bus.wires_time(until) } else { wires.saturating_add(behind_ns) }
        }));
    }

    fn is_down(&self) -> bool {
        self.bus.lock().has_stopped()
    }

    fn local_inputs(&self) -> Option<u8> {
        self.bus.lock().take_local_inputs()
    }

    fn set_local_outputs(&mut self, bits: u8) {
        self.bus.lock().put_local_outputs(bits);
    }
}

/// The interval at which the bus returns cycles while no slave is in OP, ns: the cycle time that a board has before OP.
const fn tick_ns() -> Ns {
    CycleTime::DEFAULT.ns()
}
