//! A network at the end of a network card: the board's jobs and process data over our own EtherCAT master.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `mod.rs` | [`NicBus`], the bus as the engine sees it |
//! | `wires.rs` | what it needs of the card, or of two: [`NicWires`], [`CardPair`] |
//! | `ring.rs` | two cards that make a ring: [`Ring`] |
//! | `jobs.rs` | scan, changes of state and SDOs |
//! | `configure.rs` | the process data and the mode of each slave, in PreOP, as an async function |
//! | `cycle.rs` | the frames of a cycle: outputs, inputs |
//! | `lost.rs` | which slaves are lost |
//! | `unreached_outputs.rs` | the outputs that may not have reached slaves, before it is known which slaves |
//! | `ages.rs` | how old the inputs of each slave are |
//! | `chain.rs` | simulated slave controllers as wires, in virtual time: [`ChainWires`] |
//!
//! **A cycle** is one [`Fieldbus::poll`], as in a simulated network: the frames go out, and the poll waits until they are
//! back, at most for [`ANSWER_WAIT`] of a cycle. So an answer belongs to the outputs of the same cycle.
//!
//! **A cycle without its answer** \[OURS]: nobody knows how far the frame came. The same outputs go out again in the next cycle,
//! and what the program sends waits for so long. A target is then late, or it is sent twice; none is left out. A poll
//! gives no cycle then, as with a cable that is cut before the first slave.
//!
//! A clear does not take back outputs that a frame has carried.
//!
//! **A cycle that some slave has missed** \[OURS]: the working counter is too low, or not all are in their states, and other
//! slaves have moved on. What was sent since then counts for the slave that is named for it; if all are there again before,
//! as sets of outputs that were lost.
//!
//! What slaves add that are lost already is not known, so that less than the cycle before had is too low while some are, until the
//! states of all have been read.
//!
//! **Lost slaves** \[OURS]. A working counter that is too low does not say whose part is missing: the master reads the state of
//! each slave, which takes some cycles, and names those that do not answer or have left their state. They stay lost until a
//! [`Job::State`] brings them back.
//!
//! **A working counter that is wrong** \[OURS], too low or too high: the inputs beside it are not believed, and those of all slaves in
//! the datagram stay as they were. If no state tells why, the master asks each of them for its inputs alone. Inputs that are older than
//! [`STALE_AFTER`](super::STALE_AFTER) are stale, and their slave is lost: its axes are sent a quick stop.

mod ages;
#[cfg(feature = "sim")]
mod chain;
mod configure;
mod cycle;
mod jobs;
mod lost;
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

/// For which part of a cycle a poll waits for the frames of a cycle to come back, from when the cycle was due. SYNC0 comes
/// then: an answer in time shows that the outputs were there before it. \[OURS]
pub const ANSWER_WAIT: (Ns, Ns) = (3, 4);

/// How long that is, ns.
const fn answer_wait_ns(cycle: CycleTime) -> Ns {
    let (share, of) = ANSWER_WAIT;
    cycle.ns() / of * share
}

/// After so many cycles without an answer, and so long, the bus is down, ns: the watchdogs of the slaves' controllers have ended OP
/// then. Less is a machine that was busy, or a bad cable. \[OURS]
const DOWN_AFTER: (u32, Ns) = (3, 100_000_000);
/// How long a wait for frames lasts at most while sequences of the master wait for a time, ns. \[OURS]
const TURN_NS: Ns = 200_000;

/// A time without a frame is told with a slave that has left OP since if it was that long, and for so long afterwards, ns: slaves wait
/// for outputs for 100 ms, and are asked for their states some cycles later. \[OURS]
const STOOD_STILL_NS: Ns = 50_000_000;
const STOOD_STILL_TOLD_NS: Ns = 1_000_000_000;

/// The longest time without a frame of a cycle, as this machine was late.
#[derive(Clone, Copy, Debug, Default)]
struct Standstill {
    /// When the frames of the newest cycle were sent; `None`: the one before them was none with process data.
    sent_at: Option<Ns>,
    /// How long it was, and when it had ended.
    ns: Ns,
    ended: Ns,
}

impl Standstill {
    /// The frames of a cycle are sent.
    fn note(&mut self, now: Ns) {
        let gap = self.sent_at.map_or(0, |before| now.saturating_sub(before));
        self.sent_at = Some(now);
        if gap >= STOOD_STILL_NS && gap >= self.recent_ns(now) {
            (self.ns, self.ended) = (gap, now);
        }
    }

    /// How long it was, if that was a short time ago; else 0.
    const fn recent_ns(&self, now: Ns) -> Ns {
        if now.saturating_sub(self.ended) < STOOD_STILL_TOLD_NS { self.ns } else { 0 }
    }
}

/// What is known of a slave.
#[derive(Clone, Copy, Debug)]
struct Station {
    /// The AL state that the newest job brought it to. It may have left it by itself.
    commanded: AlState,
    /// The process data that are mapped; `None`: nothing is.
    process_data: Option<ProcessData>,
}

/// An SDO under way.
#[derive(Clone, Copy, Debug)]
struct RunningSdo {
    request: SdoRequest,
    transfer: Transfer,
    /// When the slave has not answered, on the wires' clock.
    until: Ns,
}

/// A network at the end of a network card.
pub struct NicBus<W> {
    wires: W,
    /// The sequences of a configuration reach it too, beside which nobody holds it.
    master: Arc<Mutex<Master>>,
    /// The engine's time less that of the wires; `None`: nobody has called yet.
    skew: Option<Ns>,
    /// A runner waits for the time of each cycle. Without one the bus does.
    has_runner: bool,
    stations: [Station; MAX_SLAVES],
    found: u8,
    cycle: CycleTime,
    /// The master was told how long a cycle is.
    is_paced: bool,
    lost: SlaveSet,
    lost_from: [Option<u64>; MAX_SLAVES],
    ages: Ages,
    standstill: Standstill,
    /// The outputs that were pushed last.
    outputs: Outputs,
    /// No answer has come to a frame with them.
    has_new_outputs: bool,
    /// Such a frame has gone out: they may have come.
    may_have_come: bool,
    /// Slaves that get outputs with which nothing moves until others are pushed: they have entered OP since.
    holding: SlaveSet,
    /// The id of the newest outputs that a frame has carried whose answer came.
    sent: Option<u64>,
    missed: UnreachedOutputs,
    /// The newest inputs of all slaves.
    inputs: Box<[super::SlaveIn; MAX_SLAVES]>,
    /// Cycles in a row without an answer.
    unanswered: u32,
    job: Option<Running>,
    /// A place for a configuration, while there is none.
    spare: Option<Box<Configuring>>,
    sdo: Option<RunningSdo>,
    job_done: Option<JobDone>,
    sdo_done: Option<SdoDone>,
}

impl<W: NicWires> NicBus<W> {
    /// The network at the end of these wires.
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

    /// The wires, to look at.
    pub const fn wires(&self) -> &W {
        &self.wires
    }

    /// The master, to look at.
    pub fn master(&self) -> impl Deref<Target = Master> {
        self.master.lock()
    }

    fn station(&self, slave: u8) -> &Station {
        &self.stations[usize::from(slave) - 1]
    }

    fn station_mut(&mut self, slave: u8) -> &mut Station {
        &mut self.stations[usize::from(slave) - 1]
    }

    /// The slaves that were found.
    const fn all(&self) -> SlaveSet {
        SlaveSet::first(self.found)
    }

    /// The AL state of a slave as the master knows it; `None`: it does not answer.
    fn state(&self, slave: u8) -> Option<AlState> {
        let status = self.master.lock().status(slave).filter(|status| status.is_present)?;
        status.state()
    }

    /// Whether a slave exchanges process data, or waits for outputs on its way to OP.
    fn has_cycles(&self) -> bool {
        let is_up = |slave| self.state(slave).unwrap_or_default().max(self.station(slave).commanded) >= AlState::SafeOp;
        self.all().iter().any(is_up)
    }

    /// Goes on with what is under way, without a wait.
    fn turn(&mut self) {
        self.master.lock().poll(self.wires.now(), &mut self.wires);
        self.take_ends();
        self.run_job();
    }

    /// What is under way goes on, and without a runner, or where the wires' clock is virtual, time passes until that time of the
    /// engine.
    fn advance(&mut self, now: Ns) {
        let until = now.wrapping_sub(self.skew_at(now));
        // With nothing under way the cycle itself takes what has come: each look at a card is a call of the system.
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

    /// Waits until a frame comes, or it is time to go on with what is under way, at most until that time of the wires.
    fn wait_a_turn(&mut self, until: Ns) {
        let turn = if self.is_working() { self.wires.now().saturating_add(TURN_NS) } else { until };
        self.wires.wait(turn.min(until));
        self.turn();
    }

    /// The engine's time less that of the wires, seen when it is `now` for the engine. A runner is late by some time that
    /// changes, so that the greatest difference is the true one since it has left out cycles, which it tells. One that is late by more
    /// than half a cycle has left out time without a word.
    fn skew_at(&mut self, now: Ns) -> Ns {
        let seen = now.wrapping_sub(self.wires.now());
        let skew = self.skew.get_or_insert(seen);
        let is_more = seen.wrapping_sub(*skew).cast_signed() > 0;
        if self.has_runner && (is_more || skew.wrapping_sub(seen) > self.cycle.ns() / 2) {
            *skew = seen;
        }
        *skew
    }

    /// Whether something is under way that goes on between cycles.
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
