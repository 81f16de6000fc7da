//! A network behind a network card: the board's jobs and process data over the EtherCAT master of this project.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`NicBus`], the implementation of [`Fieldbus`] |
//! | `wires.rs` | the traits for one network card and for two: [`NicWires`], [`CardPair`] |
//! | `ring.rs` | two cards that make a ring: [`Ring`] |
//! | `jobs.rs` | scan, changes of state and SDOs |
//! | `configure.rs` | the process data and the mode of each slave, in PreOP, as an async function |
//! | `cycle.rs` | the frames of a cycle: outputs, inputs |
//! | `unreached_outputs.rs` | the outputs that may not have reached slaves, before it is known which slaves |
//! | `ages.rs` | the age of each slave's inputs |
//! | `chain.rs` | a wire to simulated slave controllers, in virtual time: [`ChainWires`] |
//!
//! **A cycle** is one [`Fieldbus::poll`], as in a simulated network: the poll sends the frames and waits until they are
//! back, at most for the part [`ANSWER_WAIT`] of a cycle. So an answer belongs to the outputs of the same cycle.
//!
//! **A cycle without an answer** \[OURS]: it is not known how far its frames came. The next cycle sends the same
//! outputs again, and newer outputs wait. So a target may be late or sent twice, but none is skipped. The poll then
//! returns no cycle, as with a cable that is cut before the first slave.
//!
//! A clear ([`Fieldbus::clear_ahead`]) does not take back outputs that a frame has carried.
//!
//! **A cycle that a slave has missed** \[OURS]: the working counter is too low, or a slave is below its commanded AL
//! state, but the other slaves have used the outputs. The outputs from this cycle on count as missed by the slave that
//! the AL states later show as lost. If all slaves answer again before a slave is found lost, these outputs count as
//! lost sets of outputs ([`CycleDone::outputs_lost`]).
//!
//! It is not known how much lost slaves still add to the working counter. So while slaves are lost, a working counter
//! below that of the previous cycle counts as too low, until the AL states of all slaves have been read.
//!
//! **Lost slaves** \[OURS]. A working counter that is too low does not show which slave is missing. The master reads
//! the AL state of each slave, which takes some cycles (`master/acyclic.rs` decides how many). Slaves that do not
//! answer or have left their state are lost. They stay lost until a [`Job::State`] brings them back.
//!
//! **A working counter that is wrong** \[OURS], too low or too high: the inputs of that datagram are not used, and all
//! slaves in the datagram keep their previous inputs. If no AL state explains the working counter, the master reads the
//! inputs of each of these slaves with a separate datagram. Inputs that are older than
//! [`STALE_AFTER`](super::STALE_AFTER) are stale, and their slave is lost: its axes are sent a quick stop.

mod ages;
#[cfg(feature = "sim")]
mod chain;
mod configure;
mod cycle;
mod jobs;
mod ring;
mod unreached_outputs;
mod wires;

use std::ops::Deref;
use std::sync::Arc;

use parking_lot::Mutex;

use super::pdo::ProcessData;
use super::{
    AlState, BusError, Busy, CardsGone, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns, Outputs,
    Pacing, RingState, SdoDone, SdoRequest, SlaveSet, Strangers,
};
use crate::master::{Master, Settings};
use crate::sk::CycleTime;
use ages::Ages;
#[cfg(feature = "sim")]
pub use chain::ChainWires;
use configure::Configuring;
use jobs::{Running, Transfer};
pub use ring::{GRACE_NS, Ring};
use unreached_outputs::UnreachedOutputs;
pub use wires::{CardPair, NicWires};

/// The fraction of a cycle (numerator, denominator) for which a poll waits for its frames to come back, counted from
/// the time at which the cycle is due. SYNC0 comes at the end of the wait, so an answer in time shows that the outputs
/// arrived before SYNC0. \[OURS]
pub const ANSWER_WAIT: (Ns, Ns) = (3, 4);

/// The time that [`ANSWER_WAIT`] gives for this cycle time, ns.
const fn answer_wait_ns(cycle: CycleTime) -> Ns {
    let (share, of) = ANSWER_WAIT;
    cycle.ns() / of * share
}

/// The bus is down after this number of cycles without an answer, if they also last at least this time, ns: by then the
/// watchdogs of the slave controllers have ended OP. Shorter interruptions come from a busy machine or a bad cable.
/// \[OURS]
const DOWN_AFTER: (u32, Ns) = (3, 100_000_000);
/// While a job or an SDO transfer is running, the bus waits at most this long for a frame, ns. Then it lets the job
/// continue, which may have to act without a frame: at a retry or a timeout. \[OURS]
const TURN_NS: Ns = 200_000;

/// The minimum length of a gap without frames, caused by a delay of this machine, that is reported, ns. The slaves'
/// watchdogs expire after 100 ms without outputs. \[OURS]
const STOOD_STILL_NS: Ns = 50_000_000;
/// For how long after its end such a gap is reported with each slave that leaves OP, ns. The master reads only some
/// cycles later that a slave has left OP.
const STOOD_STILL_TOLD_NS: Ns = 1_000_000_000;

/// The longest gap between the frames of two consecutive cycles in the last [`STOOD_STILL_TOLD_NS`], if it is at least
/// [`STOOD_STILL_NS`] long. The cause of such a gap is a delay of this machine.
#[derive(Clone, Copy, Debug, Default)]
struct Standstill {
    /// When the frames of the newest cycle were sent; `None`: the newest cycle exchanged no process data.
    sent_at: Option<Ns>,
    /// `ns`: the length of the gap. `ended`: the time at which it ended, on the network card's clock.
    ns: Ns,
    ended: Ns,
}

impl Standstill {
    /// Called when the frames of a cycle are sent. Records the gap since the frames of the previous cycle if it is at
    /// least [`STOOD_STILL_NS`] long and at least as long as the recorded gap.
    fn note(&mut self, now: Ns) {
        let gap = self.sent_at.map_or(0, |before| now.saturating_sub(before));
        self.sent_at = Some(now);
        if gap >= STOOD_STILL_NS && gap >= self.recent_ns(now) {
            (self.ns, self.ended) = (gap, now);
        }
    }

    /// The length of the gap if it ended less than [`STOOD_STILL_TOLD_NS`] ago, otherwise 0, ns.
    const fn recent_ns(&self, now: Ns) -> Ns {
        if now.saturating_sub(self.ended) < STOOD_STILL_TOLD_NS { self.ns } else { 0 }
    }
}

/// What the bus knows of one slave.
#[derive(Clone, Copy, Debug)]
struct Station {
    /// The AL state that the newest job brought the slave to. The slave may have left it by itself.
    commanded: AlState,
    /// The process data that are mapped in the slave; `None`: none are mapped.
    process_data: Option<ProcessData>,
}

/// A running SDO transfer.
#[derive(Clone, Copy, Debug)]
struct RunningSdo {
    request: SdoRequest,
    transfer: Transfer,
    /// When the SDO times out, on the network card's clock.
    until: Ns,
}

/// A network behind one network card, or behind two cards that make a ring.
pub struct NicBus<W> {
    wires: W,
    /// The master, shared with the futures of a configuration.
    master: Arc<Mutex<Master>>,
    /// Offset of the engine's clock to the network card's clock (engine minus card), ns; `None`: it was not measured
    /// yet.
    skew: Option<Ns>,
    /// Whether a runner of the engine waits for the time of each cycle. Without a runner the bus itself waits until
    /// that time.
    has_runner: bool,
    stations: [Station; MAX_SLAVES],
    found: u8,
    cycle: CycleTime,
    /// Whether the master has a cycle time. At first it has none, although `cycle` has a default value.
    is_paced: bool,
    lost: SlaveSet,
    lost_from: [Option<u64>; MAX_SLAVES],
    ages: Ages,
    standstill: Standstill,
    /// The outputs that the engine has pushed last.
    outputs: Outputs,
    /// Whether `outputs` are new: no frame that carried them has been answered yet.
    has_new_outputs: bool,
    /// Whether a frame that carried `outputs` was sent. They may have reached slaves then, so [`Fieldbus::clear_ahead`]
    /// does not discard them.
    may_have_come: bool,
    /// Slaves that have entered OP since the newest push. They do not get `outputs`, which are older, but outputs that
    /// keep their axes at a standstill, until the next push.
    holding: SlaveSet,
    /// The id of the newest outputs whose frames were all answered.
    sent: Option<u64>,
    missed: UnreachedOutputs,
    /// The newest inputs received from all slaves.
    inputs: Box<[super::SlaveIn; MAX_SLAVES]>,
    /// The number of cycles in a row without an answer.
    unanswered: u32,
    job: Option<Running>,
    /// The slots for a configuration, kept for the next one; `None`: a configuration uses them, or there was none yet.
    spare: Option<Box<Configuring>>,
    sdo: Option<RunningSdo>,
    job_done: Option<JobDone>,
    sdo_done: Option<SdoDone>,
}

impl<W: NicWires> NicBus<W> {
    /// Creates a bus for the network behind these wires.
    pub fn new(wires: W, settings: Settings) -> Self {
        let master = Arc::new(Mutex::new(Master::new(settings)));
        let spare = Some(Configuring::place(&master));
        Self {
            wires,
            master,
            skew: None,
            has_runner: false,
            stations: [Station { commanded: AlState::Init, process_data: None }; MAX_SLAVES],
            found: 0,
            cycle: CycleTime::DEFAULT,
            is_paced: false,
            lost: SlaveSet::EMPTY,
            lost_from: [None; MAX_SLAVES],
            ages: Ages::default(),
            standstill: Standstill::default(),
            outputs: Outputs::default(),
            has_new_outputs: false,
            may_have_come: false,
            holding: SlaveSet::EMPTY,
            sent: None,
            missed: UnreachedOutputs::default(),
            inputs: Box::new([Default::default(); MAX_SLAVES]),
            unanswered: 0,
            job: None,
            spare,
            sdo: None,
            job_done: None,
            sdo_done: None,
        }
    }

    /// The network card or cards, for reading their state.
    pub const fn wires(&self) -> &W {
        &self.wires
    }

    /// The master, for reading its state.
    pub fn master(&self) -> impl Deref<Target = Master> {
        self.master.lock()
    }

    fn station(&self, slave: u8) -> &Station {
        &self.stations[usize::from(slave) - 1]
    }

    fn station_mut(&mut self, slave: u8) -> &mut Station {
        &mut self.stations[usize::from(slave) - 1]
    }

    /// All slaves that the last scan has found.
    const fn all(&self) -> SlaveSet {
        SlaveSet::first(self.found)
    }

    /// The AL state of a slave as the master knows it; `None`: it does not answer.
    fn state(&self, slave: u8) -> Option<AlState> {
        let status = self.master.lock().status(slave).filter(|status| status.is_present)?;
        status.state()
    }

    /// Whether process data are exchanged: a slave is in SafeOP or OP, or is commanded to be.
    fn has_cycles(&self) -> bool {
        let is_up = |slave| self.state(slave).unwrap_or_default().max(self.station(slave).commanded) >= AlState::SafeOp;
        self.all().iter().any(is_up)
    }

    /// Handles received frames, and continues the running job and SDO as far as they can go on. Does not wait.
    fn turn(&mut self) {
        self.master.lock().poll(self.wires.now(), &mut self.wires);
        self.take_ends();
        self.run_job();
    }

    /// Continues the running job and SDO as far as they can go on. Without a runner, or if the network card's clock is
    /// virtual, this also waits until the engine's time is `now`.
    fn advance(&mut self, now: Ns) {
        let until = now.wrapping_sub(self.skew_at(now));
        // With a runner, but without a running job or SDO, this call would be wasted: the exchange of the cycle
        // receives the frames, and each attempt to receive from a card is a system call.
        if !self.has_runner || self.is_working() {
            self.turn();
        }
        if self.has_runner {
            return;
        }
        while self.wires.now() < until {
            self.wait_a_turn(until);
        }
    }

    /// Waits until a frame comes, at most until the time `until` on the network card's clock, and at most [`TURN_NS`]
    /// if a job or an SDO transfer is running. Then continues the job and the SDO transfer.
    fn wait_a_turn(&mut self, until: Ns) {
        let turn = if self.is_working() { self.wires.now().saturating_add(TURN_NS) } else { until };
        self.wires.wait(turn.min(until));
        self.turn();
    }

    /// Offset of the engine's clock to the network card's clock (engine minus card), ns, measured when the engine's
    /// time is `now`. Because of the runner's wake-up latency the call comes late, so a single sample is too small, and
    /// the largest sample is kept. The runner reports skipped cycles ([`Fieldbus::leave_out`]). A sample that is
    /// smaller by more than half a cycle means that the runner has skipped time without a report, so it replaces the
    /// kept one.
    fn skew_at(&mut self, now: Ns) -> Ns {
        let seen = now.wrapping_sub(self.wires.now());
        let skew = self.skew.get_or_insert(seen);
        let is_more = seen.wrapping_sub(*skew).cast_signed() > 0;
        if self.has_runner && (is_more || skew.wrapping_sub(seen) > self.cycle.ns() / 2) {
            *skew = seen;
        }
        *skew
    }

    /// Whether a job or an SDO is running, which then continues between cycles.
    const fn is_working(&self) -> bool {
        self.job.is_some() || self.sdo.is_some()
    }
}

impl<W: NicWires + Send> Fieldbus for NicBus<W> {
    fn pacing(&self) -> Pacing {
        Pacing::Runner
    }

    fn start(&mut self, job: Job, _now: Ns) -> Result<(), Busy> {
        if self.job.is_some() || self.sdo.is_some() && !matches!(job, Job::State { .. }) {
            return Err(Busy);
        }
        self.begin(job);
        Ok(())
    }

    fn start_sdo(&mut self, request: SdoRequest, _now: Ns) -> Result<(), Busy> {
        if self.sdo.is_some() || self.job.as_ref().is_some_and(|job| !matches!(job, Running::State(_))) {
            return Err(Busy);
        }
        self.ask_for_sdo(request);
        Ok(())
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.advance(now);
        self.job_done.take()
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        if self.sdo.is_some() {
            self.advance(now);
        }
        self.sdo_done.take()
    }

    fn cancel_job(&mut self) {
        if let Some(job) = self.job.take() {
            self.give_up(job);
        }
        self.job_done = None;
    }

    fn cancel_sdo(&mut self) {
        if let Some(RunningSdo { transfer, .. }) = self.sdo.take() {
            self.master.lock().cancel(transfer.id());
        }
        self.sdo_done = None;
    }

    fn room(&self) -> u16 {
        u16::from(!self.has_new_outputs && !self.leaves_op())
    }

    fn clear_ahead(&mut self, _now: Ns) {
        self.has_new_outputs &= self.may_have_come;
    }

    fn poll_clear(&mut self, _now: Ns) -> Option<Cleared> {
        let newest_sent = if self.has_new_outputs { Some(self.outputs.id) } else { self.sent };
        Some(Cleared { newest_sent })
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        if self.has_new_outputs {
            return Err(BusError::Full);
        }
        self.outputs.clone_from(outputs);
        (self.has_new_outputs, self.may_have_come) = (true, false);
        self.holding = SlaveSet::EMPTY;
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.exchange(now, inputs)
    }

    fn work_until(&mut self, now: Ns, until: Ns) {
        if !self.wires.is_real_time() {
            return;
        }
        self.has_runner = true;
        if !self.is_working() {
            return;
        }
        let end = self.wires.now().saturating_add(until.saturating_sub(now));
        self.turn();
        while self.is_working() && self.wires.now() < end {
            self.wait_a_turn(end);
        }
    }

    fn catches_up(&self) -> bool {
        !self.wires.is_real_time()
    }

    fn leave_out(&mut self, left_out_ns: Ns) {
        self.skew = self.skew.map(|skew| skew.wrapping_sub(left_out_ns));
    }

    fn reference_clock(&self) -> Option<u8> {
        self.master.lock().reference_clock()
    }

    fn ring(&self) -> Option<RingState> {
        self.wires.ring()
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        self.wires.cards_gone()
    }

    fn strangers(&self) -> Strangers {
        let master = self.master.lock();
        Strangers { other_master: master.other_master(), unpassed: master.counters().unpassed }
    }

    fn is_down(&self) -> bool {
        let (cycles, time_ns) = DOWN_AFTER;
        self.unanswered >= cycles && Ns::from(self.unanswered) * self.cycle.ns() >= time_ns
    }
}
