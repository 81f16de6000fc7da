//! A network behind an ECM-XF: the board's jobs as commands of the chip, and its process data through the chip's FIFOs.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `mod.rs` | [`XfBus`], the bus as the engine sees it |
//! | `chip_bus.rs` | all of it but the sequence of its job |
//! | `options.rs` | how it uses its chip: [`XfBusOptions`] |
//! | `jobs.rs`, `jobs/` | scan, configuration and changes of state as async functions, and in `run.rs` how their commands are asked; `ask.rs`: one command and its answer |
//! | `ahead.rs` | what of a configuration is done before it is asked for |
//! | `flow.rs` | process data: what is written and read in which exchange |
//! | `plan.rs` | how a cycle is held: the packets' size, sets in an exchange, exchanges under way |
//! | `level.rs` | how many sets of outputs lie in the chip, by estimate |
//! | `ledger.rs` | which outputs each cycle carried |
//! | `answers.rs` | what the cycles have sent back, until it is polled |
//! | `clear.rs` | the chip's FIFO is emptied, and what it had sent by then |
//! | `watch.rs` | which slaves are lost, and what a reset of the chip means |
//! | `local_io.rs` | local inputs and outputs at pins of the chip |
//! | `network.rs` | what is known of the network |
//!
//! The bus uses the driver ([`Host`]) over its wires in steps, until the wires' clock has reached the time for which the
//! engine polls. It starts no thread.

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

/// The most cycles by which an answer is polled late: so many TxPDOs the chip keeps (XF EN 1236). \[OURS]
const ANSWER_DELAY: u16 = 64;
/// The most entries of each FIFO that are asked for; fewer if the chip's memory does not hold them. \[OURS]
const ENTRIES: usize = 64;
/// So many sets are on their way where one follows another: one waits for its exchange, one is under way in it, and one
/// lies in the chip until its next cycle. \[OURS]
const ON_THE_WAY: u64 = 3;
/// The longest packet with its idle time takes less at 24 MHz, and two of them hardly more. \[OURS]
const CATCH_UP_NS: Ns = 1_000_000;
/// The memory of both FIFOs, bytes (XF EN 1236).
const FIFO_MEMORY: usize = 0x4000;

/// What a bus has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct XfBusCounters {
    /// Sets of outputs that the chip has not taken, or of which nobody knows.
    pub sets_lost: u64,
    /// Cycles whose inputs were lost.
    pub cycles_lost: u64,
    /// How often the chip was reset.
    pub chip_resets: u64,
}

/// The entries of each of the chip's FIFOs, 1..=64, with so many bytes of process data in both directions together.
pub fn fifo_entries(process_bytes: usize) -> u8 {
    (FIFO_MEMORY / process_bytes.max(1)).clamp(1, ENTRIES) as u8
}

/// A network behind an ECM-XF.
pub struct XfBus<W> {
    bus: Arc<Mutex<ChipBus<W>>>,
    /// The sequence of the job under way.
    sequence: Sequence,
}

impl<W: fmt::Debug> fmt::Debug for XfBus<W> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.bus.lock().fmt(formatter)
    }
}

impl<W: Wires + Send + 'static> XfBus<W> {
    /// The network behind the chip at the end of these wires, which is started.
    pub fn new(wires: W, config: HostConfig, options: XfBusOptions) -> Self {
        let bus = Arc::new(Mutex::new(ChipBus::new(wires, config, options)));
        let sequence = jobs::place_of(&bus);
        Self { bus, sequence }
    }
}

impl<W: Wires> XfBus<W> {
    /// The wires, to look at.
    pub fn wires(&self) -> impl Deref<Target = W> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.wires)
    }

    /// The wires, to cause trouble.
    pub fn wires_mut(&mut self) -> impl DerefMut<Target = W> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.wires)
    }

    /// The driver, to look at.
    pub fn host(&self) -> impl Deref<Target = Host> {
        MutexGuard::map(self.bus.lock(), |bus| &mut bus.host)
    }

    /// What was counted.
    pub fn counters(&self) -> XfBusCounters {
        self.bus.lock().counters
    }

    /// Starts the driver, and waits until the chip has answered.
    ///
    /// # Errors
    /// It does not answer, or the wires cannot be used.
    pub fn start_up(&mut self) -> Result<(), StepError<W::Error>> {
        let ChipBus { host, wires, .. } = &mut *self.bus.lock();
        while host.state() != HostState::Running {
            host.step(wires, Ns::MAX)?;
        }
        Ok(())
    }

    /// Exchanges and waits until that time of the engine. The bus then.
    fn advance(&mut self, now: Ns) -> MutexGuard<'_, ChipBus<W>> {
        let until = self.bus.lock().wires_time(now);
        self.work(until)
    }

    /// Exchanges and waits until that time of the wires. The bus then.
    fn work(&mut self, until: Ns) -> MutexGuard<'_, ChipBus<W>> {
        let Self { bus, sequence } = self;
        let mut bus = bus.lock();
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

/// Takes what has ended, and hands the driver what is next.
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
                    // [OURS] Each way up to SafeOP has a layout of its own, as makers' drivers have it.
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
        let mut bus = self.bus.lock();
        let wires = bus.wires.now();
        if bus.options.real_time {
            (bus.skew, bus.has_runner) = (Some(now.wrapping_sub(wires)), true);
        }
        // [OURS] A late runner gives the wires the time of a cycle with each part that it catches up on, or that of two
        // exchanges: after a stall what lies in the chip is topped up at once, and a machine that is too slow for its cycles
        // has exchanges all the same.
        let behind_ns = bus.network.cycle.ns().min(CATCH_UP_NS);
        let until = if now < until { bus.wires_time(until) } else { wires.saturating_add(behind_ns) };
        drop(bus);
        drop(self.work(until));
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

    fn reference_clock(&self) -> Option<u8> {
        self.bus.lock().network.with_dc.iter().next()
    }
}

/// The cycle that is told while the chip has none, as the board's before OP.
const fn tick_ns() -> Ns {
    CycleTime::DEFAULT.ns()
}
