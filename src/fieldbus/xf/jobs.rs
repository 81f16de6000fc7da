//! The jobs of the bus as async functions that submit commands to the chip.
//!
//! `run.rs` polls the future of a job when its command is answered and when its wait is over. `network.rs` has the scan, the
//! start of the network and the reading of the slaves' states, `configure.rs` the configuration, and `state.rs` the change of
//! state.

mod configure;
mod network;
mod run;
mod state;

use std::future::poll_fn;
use std::sync::Arc;
use std::task::Poll;

use parking_lot::Mutex;

use super::ask::{Ask, Reply};
use super::chip_bus::ChipBus;
use crate::ethercat::coe::AbortCode;
use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::{BusConfig, HardwareLimit, Job, JobDone, Refusal, SdoDone, SdoRequest};
use crate::master::place::{Place, place};
use crate::xf::host::{HostError, Wires};
pub(super) use network::state_of;
pub(super) use run::run_job;

/// The number of cycles after which the engine has certainly polled the report that a set of outputs was sent: the fill
/// levels lag three exchanges of two packets each. In this time after the last cycle in OP, the engine has also polled
/// all cycles in OP. \[OURS]
const TOLD_LATE: Ns = 6;

/// A preallocated, reusable slot for the future of a job, so that a job does not allocate. The arguments of the future
/// are the job and [`Running::is_ahead`].
pub(super) type Sequence = Place<(Job, bool), JobDone>;

/// Allocates the slot for the futures of a bus.
pub(super) fn place_of<W: Wires + Send + 'static>(bus: &Arc<Mutex<ChipBus<W>>>) -> Sequence {
    let bus = Arc::clone(bus);
    place(move |(job, is_ahead)| Steps { bus: Arc::clone(&bus), tells_until: None }.run(job, is_ahead))
}

/// A job of the bus that is running.
#[derive(Clone, Debug)]
pub(super) struct Running {
    job: Job,
    /// The job is a configuration that was not requested yet: it writes no object of a slave, and its result is not
    /// returned.
    pub(super) is_ahead: bool,
    deadline: Ns,
    has_begun: bool,
}

/// Which part of a job is running, if another request has to treat that part in a special way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Any,
    /// The network is being initialised. If the job were dropped now, the next job would find the network half initialised.
    StartsNetwork,
    /// Process data are being laid out, after the objects of all slaves were read.
    LaysOut,
}

impl Running {
    pub(super) fn new(job: Job, now: Ns) -> Self {
        let timeout_ns = if let Job::State { timeout_ns, .. } = job { timeout_ns } else { Ns::MAX };
        Self { job, is_ahead: false, deadline: now.saturating_add(timeout_ns), has_begun: false }
    }

    /// A configuration that is prepared before it is requested.
    pub(super) const fn ahead(config: BusConfig) -> Self {
        Self { job: Job::Configure(config), is_ahead: true, deadline: Ns::MAX, has_begun: false }
    }

    /// The result of a running job that cannot be completed, for example after a reset of the chip: no slave found, or
    /// a refusal by the first slave, which has not answered.
    pub(super) fn cut_off(&self) -> JobDone {
        let first = |slaves: SlaveSet| slaves.iter().next().unwrap_or(1);
        match self.job {
            Job::Scan => JobDone::Scan { found: 0 },
            Job::Configure(config) => JobDone::Configure(Err(Refusal::no_answer(first(config.selected)))),
            Job::State { slaves, .. } => JobDone::State(Err(Refusal::no_answer(first(slaves)))),
        }
    }
}

/// Why the async function of a job has failed.
enum Failure {
    Refused(Refusal),
    Beyond(HardwareLimit),
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<HardwareLimit> for Failure {
    fn from(limit: HardwareLimit) -> Self {
        Self::Beyond(limit)
    }
}

/// Converts the answer to the chip's SDO command to the result of an SDO.
pub(super) fn sdo_done(request: &SdoRequest, reply: Reply) -> SdoDone {
    let value = reply.map_err(|error| abort_code(&error))?;
    Ok(request.write.map_or(value, |(_, written)| written))
}

/// The abort code of an SDO that has failed: the slave's own code if there is one, otherwise the code of a timeout.
fn abort_code(error: &HostError) -> AbortCode {
    match error {
        HostError::Failed { abort: Some(abort), .. } if abort.0 != 0 => *abort,
        _ => AbortCode::TIMEOUT,
    }
}

/// The state of a job's async functions: the bus that they use. The methods submit commands and wait for answers and
/// times.
struct Steps<W> {
    bus: Arc<Mutex<ChipBus<W>>>,
    /// If the job has found lost slaves, it waits until the engine has polled the loss, at most until this time on the
    /// clock of the wires to the chip. `None`: the job has not had to wait for this yet.
    tells_until: Option<Ns>,
}

impl<W: Wires> Steps<W> {
    async fn run(mut self, job: Job, is_ahead: bool) -> JobDone {
        match job {
            Job::Scan => JobDone::Scan { found: self.scan().await.unwrap_or(0) },
            Job::State { target, slaves, .. } => JobDone::State(self.change(target, slaves).await),
            Job::Configure(config) => match self.configure(&config, is_ahead).await {
                Ok(configured) => JobDone::Configure(Ok(configured)),
                Err(Failure::Refused(refusal)) => JobDone::Configure(Err(refusal)),
                Err(Failure::Beyond(limit)) => JobDone::Beyond(limit),
            },
        }
    }

    fn with<R>(&self, action: impl FnOnce(&mut ChipBus<W>) -> R) -> R {
        action(&mut self.bus.lock())
    }

    /// Submits a command to the chip as soon as the driver accepts it, and waits for the answer.
    async fn ask(&self, ask: Ask) -> Reply {
        let answer = |bus: &mut ChipBus<W>| {
            let Some(asked) = bus.asked else {
                bus.asked = ask.submit(&mut bus.host, bus.wires.now()).ok();
                return None;
            };
            let reply = asked.reply(&mut bus.host)?;
            (bus.asked, bus.has_gone_on) = (None, true);
            Some(reply)
        };
        poll_fn(|_| self.with(answer).map_or(Poll::Pending, Poll::Ready)).await
    }

    /// Waits until the time `until` on the clock of the wires to the chip, and until the driver accepts commands.
    async fn wait_until(&self, until: Ns) {
        let mut is_first = true;
        let mut is_over = |bus: &mut ChipBus<W>| {
            let waits = std::mem::take(&mut is_first) || bus.wires.now() < until || !bus.is_free();
            bus.has_gone_on |= !waits;
            !waits
        };
        poll_fn(|_| if self.with(&mut is_over) { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    async fn wait(&self, ns: Ns) {
        self.wait_until(self.with(|bus| bus.wires.now()).saturating_add(ns)).await;
    }

    async fn wait_cycles(&self, cycles: Ns) {
        self.wait(cycles * self.with(|bus| bus.network.cycle.ns())).await;
    }
}

impl<W: Wires> ChipBus<W> {
    /// Makes `job` the running job; `None`: no job runs any more.
    pub(super) fn begin_job(&mut self, job: Option<Running>) {
        (self.job, self.states, self.part) = (job, [None; MAX_SLAVES], Part::Any);
    }

    /// Whether the running preparation is already laying out the process data for exactly this configuration.
    pub(super) fn lays_out_ahead(&self, wanted: &BusConfig) -> bool {
        let is_for_it = |running: &Running| running.is_ahead && running.job == Job::Configure(*wanted);
        self.part == Part::LaysOut && self.job.as_ref().is_some_and(is_for_it)
    }

    /// The state of a slave when the job last read it; `None`: no answer, or not read yet.
    const fn state(&self, slave: u8) -> Option<AlState> {
        self.states[slave as usize - 1]
    }
}
