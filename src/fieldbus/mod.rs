//! How the EC01M model reaches its slaves: the trait [`Fieldbus`], implemented for simulated slaves, for a network card and
//! for an ECM-XF.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | the trait, and the types of its process data |
//! | `job.rs` | jobs: operations that take longer than one cycle, and their results |
//! | `pdo.rs` | the objects that the board maps for each kind of slave, and their layout in the process image |
//! | `pdo/downloads.rs` | the SDO downloads for that mapping, in their order |
//! | `sim.rs` | the network of simulated slaves: cycles, working counter, lost slaves |
//! | `sim/jobs.rs`, `sim/timing.rs` | the jobs and SDOs of the simulated network, and their durations |
//! | `stale_inputs.rs` | after which time without new inputs a slave is lost |
//! | `nic/` | the network behind a network card, over the EtherCAT master of this project |
//! | `xf/` | the network behind an ECM-XF, over the driver of that chip |
//!
//! The engine passes its time to the bus as `now`. Long operations are started and then polled, so that no call waits
//! for their end: a scan, a configuration or a change of state as a [`Job`], an SDO as an [`SdoRequest`]. One operation
//! runs at a time, but an SDO may run beside a change of state. Process data are pushed and polled once a cycle. A set
//! of outputs, one [`Outputs`], is the outputs of one cycle to all slaves. [`Fieldbus::pacing`] returns who decides
//! when a cycle runs:
//!
//! - [`Pacing::Runner`]: the runner of the engine decides. Each cycle takes one [`Outputs`] and returns one [`CycleDone`].
//! - [`Pacing::Bus`]: the bus runs its own cycle and queues outputs, up to a depth. Any number of cycles may have passed
//!   between two polls, and the inputs of a cycle belong to outputs that were pushed some cycles before. Only the ids in
//!   [`CycleDone::outputs`] show which outputs were sent, because such a bus knows the fill level of its queue only as of
//!   some exchanges ago. Discarding queued outputs takes several calls: [`Fieldbus::clear_ahead`].

mod job;
pub mod nic;
pub mod pdo;
#[cfg(feature = "sim")]
pub mod sim;
mod stale_inputs;
pub mod xf;

use std::sync::Arc;

use crate::ethercat::cia402::{Controlword, Mode, Statusword};
use crate::sk::{CycleTime, DriveSync, SlaveKind};

pub use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
pub use crate::master::ScanError;
pub use job::{Busy, Configured, HardwareLimit, Job, JobDone, Refusal, SdoDone, SdoRequest};
pub(crate) use stale_inputs::is_stale;
pub use stale_inputs::{STALE_AFTER, STALE_AT_LAST_NS};

/// The maximum number of axes of a slave: a two-channel HSP has two.
pub const MAX_AXES: usize = 2;

/// The fixed part of the time from SET_STATE until the slaves of a network leave OP, ns. Each slave adds
/// [`CHANGE_SLAVE_NS`] to this time.
///
/// \[OURS] A change "takes several cycles" (SK-3.1), during which the FIFO continues: commands that are in the FIFO
/// when SET_STATE comes, such as SV_OFF after the end of a motion, are still executed in this time, on every bus.
pub const LEAVING_OP_NS: Ns = 20_000_000;
/// The time that each slave adds to the duration of a change of state, ns: the more slaves, the longer a change takes.
/// \[OURS]
pub const CHANGE_SLAVE_NS: Ns = 2_000_000;

/// The time from SET_STATE until `slaves` slaves leave OP, ns. The commands in the FIFO are still executed in this
/// time.
pub(crate) const fn leaving_op_ns(slaves: u8) -> Ns {
    LEAVING_OP_NS + CHANGE_SLAVE_NS * slaves as Ns
}

/// Who decides when a cycle runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// The runner of the engine: it calls push and poll once a cycle.
    Runner,
    /// The hardware of the bus, such as an ECM-XF, runs cycles by its own clock, and takes the outputs of each cycle
    /// from a queue.
    Bus {
        /// The maximum number of sets of outputs that the queue holds, however long the process data are; a set is the
        /// outputs of one cycle. [`Fieldbus::room`] returns how many sets the bus accepts now.
        depth: u16,
        /// The maximum delay, in cycles, from a cycle until its answer can be polled, and from the loss of a slave
        /// until the slave is in [`Inputs::lost`].
        answer_delay: u16,
    },
}

/// The role of a slave, set by SET_AXIS and DRIVE_MODE. It decides which process data are mapped (SK-7, table).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// The slave is not used and stays in PreOP.
    Unused,
    /// A servo drive in CSP, CSV or CST.
    Drive(Mode),
    /// A stepper in CSP.
    Step(Mode),
    /// A pulse module in CSP or CSV.
    Hsp(Mode),
    /// A module of 16 digital inputs and 16 digital outputs.
    Io,
}

impl Role {
    /// The role of a slave that SET_AXIS declares as `kind`, and for which DRIVE_MODE sets `mode`.
    pub const fn of(kind: SlaveKind, mode: Mode) -> Self {
        match kind {
            SlaveKind::Drive => Self::Drive(mode),
            SlaveKind::Step => Self::Step(mode),
            SlaveKind::Hsp => Self::Hsp(mode),
            SlaveKind::Io => Self::Io,
            SlaveKind::None => Self::Unused,
        }
    }

    /// The mode of operation of the slave's axes; `None`: the slave has no axes.
    pub const fn mode(self) -> Option<Mode> {
        match self {
            Self::Drive(mode) | Self::Step(mode) | Self::Hsp(mode) => Some(mode),
            Self::Io | Self::Unused => None,
        }
    }

    /// Whether the board has process data for this role (SK-7, table). It has none for a pulse module in CST, nor for a
    /// stepper outside CSP \[OURS]. True also for an unused slave, which needs no process data.
    pub fn has_process_data(self) -> bool {
        self == Self::Unused || pdo::ProcessData::of(self, false).is_some()
    }
}

/// The requested configuration of one slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveConfig {
    /// The role of the slave, which decides its process data.
    pub role: Role,
    /// Synchronization type of the slave, written to 0x1C32:1 and 0x1C33:1.
    pub sync: DriveSync,
}

/// The configuration that slaves need before they can go to SafeOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// The EtherCAT cycle time in OP.
    pub cycle: CycleTime,
    /// The slaves to be configured. All other slaves keep their configuration and their state. So lost slaves can be
    /// configured again while the others stay in OP.
    pub selected: SlaveSet,
    /// The configuration of slave n is `slaves[n - 1]`; entries beyond the slaves found have no effect.
    pub slaves: [SlaveConfig; MAX_SLAVES],
}

/// What the master sends to one axis in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisOut {
    /// Controlword, 0x6040.
    pub controlword: Controlword,
    /// Digital outputs: 0x60FE:1 of a channel of an HSP, the 16 outputs of an IO slave.
    pub outputs: u16,
    /// The target that is mapped for the role: 0x607A in CSP (counts), 0x60FF in CSV (counts/s), 0x6071 in CST (0.1 % of
    /// rated torque).
    pub target: i32,
}

/// What one axis returns in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisIn {
    /// Statusword, 0x6041.
    pub statusword: Statusword,
    /// Torque actual value, 0x6077, 0.1 % of rated torque.
    pub torque: i16,
    /// Position actual value, 0x6064, counts.
    pub position: i32,
    /// Error code, 0x603F.
    pub error_code: u16,
    /// Digital inputs: 0x60FD of a channel of an HSP, the 16 inputs of an IO slave.
    pub inputs: u16,
}

/// The process data that the master sends to one slave, with one entry for each axis. Only a two-channel HSP uses the
/// second one.
pub type SlaveOut = [AxisOut; MAX_AXES];
/// The process data that one slave returns, with one entry for each axis. Only a two-channel HSP uses the second one.
pub type SlaveIn = [AxisIn; MAX_AXES];

/// Process data of one cycle to all slaves.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// The id that the engine gives this set of outputs; it comes back in [`CycleDone::outputs`].
    pub id: u64,
    /// The outputs of slave n are `slaves[n - 1]`.
    pub slaves: [SlaveOut; MAX_SLAVES],
}

impl Default for Outputs {
    fn default() -> Self {
        Self { id: 0, slaves: [[AxisOut::default(); MAX_AXES]; MAX_SLAVES] }
    }
}

/// Process data of one cycle from all slaves.
#[derive(Clone, Debug)]
pub struct Inputs {
    /// The inputs of slave n are `slaves[n - 1]`. If a slave did not answer, its entry stays as it was.
    pub slaves: [SlaveIn; MAX_SLAVES],
    /// Slaves that the scan has found and that did not answer in this cycle: their cable is cut, they have no power, or
    /// they have left the state that they were brought to. The engine counts a slave as lost after one such cycle. So a
    /// bus on which single frames may get lost adds a slave here only when it is sure of the loss.
    pub lost: SlaveSet,
    /// For each slave in `lost` (slave n is `lost_from[n - 1]`), the id of the first outputs that may not have reached
    /// the slave. Set if the bus notices the loss only some cycles after these outputs, or has lost the answers of
    /// those cycles. `None`: the first missed outputs are those of the cycle in which the slave first appears in
    /// `lost`.
    pub lost_from: [Option<u64>; MAX_SLAVES],
    /// Slaves that are not in OP, as far as the bus knows, and so used no outputs in this cycle: when a network leaves
    /// OP, some slaves leave it before others.
    pub without_outputs: SlaveSet,
    /// The slaves in `without_outputs` that are also below SafeOP, as far as the bus knows: they sent no inputs,
    /// either.
    pub without_inputs: SlaveSet,
    /// Slaves that are not lost, but whose inputs are from an earlier cycle: in this cycle the working counter of the
    /// datagram with their inputs was wrong, or the bus cannot tell whether it was right.
    pub held: SlaveSet,
    /// The slaves in `lost` that answer, but whose inputs were not renewed for too long ([`STALE_AFTER`]).
    pub stale: SlaveSet,
    /// For each slave in `lost` that answers, the AL status code with which it left its state; slave n is at index n - 1.
    /// 0: the slave has not left its state, or the code is unknown; for the engine both are a loss without a reason.
    pub left_with: [u16; MAX_SLAVES],
    /// The length of a recent gap without frames, ns: this machine was late and sent none. 0: there was no such gap, or
    /// the bus does not know.
    pub stood_still_ns: Ns,
}

impl Default for Inputs {
    fn default() -> Self {
        let slaves = [[AxisIn::default(); MAX_AXES]; MAX_SLAVES];
        Self {
            slaves,
            lost: SlaveSet::EMPTY,
            lost_from: [None; MAX_SLAVES],
            without_outputs: SlaveSet::EMPTY,
            without_inputs: SlaveSet::EMPTY,
            held: SlaveSet::EMPTY,
            stale: SlaveSet::EMPTY,
            left_with: [0; MAX_SLAVES],
            stood_still_ns: 0,
        }
    }
}

/// The result of a cycle: when it ran, which outputs it carried, and its working counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleDone {
    /// When the cycle ran, in board time. Its answer may have come later.
    pub at: Ns,
    /// The id of the newest outputs that were sent up to this cycle: this cycle carried them, for the first time or
    /// again. Outputs with lower ids were sent before. `None`: no outputs were sent yet, or this cycle repeated outputs
    /// on a bus that loses no answers, so that an earlier result has named them already.
    pub outputs: Option<u64>,
    /// The number of sets of outputs that the bus has accepted and then dropped since the previous result of
    /// [`Fieldbus::poll`]: as far as the bus knows, they reach no slave. Later outputs have higher ids nevertheless, so
    /// a higher id in `outputs` does not mean that the dropped sets were sent.
    pub outputs_lost: u32,
    /// The number of cycles directly before this one whose answers were lost because they were not polled in time.
    pub answers_lost: u32,
    /// The working counter of the process data.
    pub working_counter: u16,
    /// The working counter if every slave answers. 0 on a bus that does not know it: no working counter is below 0, so
    /// none counts as too low.
    pub expected_working_counter: u16,
    /// When the next cycle should run to stay in step with the distributed clocks, in board time; `None`: one period
    /// after this cycle.
    pub next_deadline: Option<Ns>,
}

/// The result of discarding queued outputs by [`Fieldbus::clear_ahead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cleared {
    /// The id of the newest outputs that were sent. Newer outputs were discarded and will never be sent. `None`: no
    /// outputs were sent.
    pub newest_sent: Option<u64>,
}

/// Why a bus does not accept a set of outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// The bus has no room for a set of outputs: [`Fieldbus::room`] was 0.
    #[error("the bus takes no more outputs now; push again when a cycle has passed")]
    Full,
    /// Frames reach no slave: the cable before the first one is cut, or the interface is down.
    #[error("the bus is down; check the cable to the first slave")]
    Down,
}

/// The state of a cable ring: a line of slaves with a network card at each end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RingState {
    /// No frame has come back yet.
    #[default]
    Unknown,
    /// No cable is cut: frames pass all slaves from one card to the other.
    Whole,
    /// A cable between two slaves is cut, but each slave can be reached from one of the cards.
    Open,
    /// Frames from the first card reach no slave, so only the second card is used.
    FirstDead,
    /// Frames from the second card reach no slave, so only the first card is used.
    SecondDead,
}

impl RingState {
    /// Whether the ring is not whole, so that the next cut would disconnect slaves.
    pub const fn is_broken(self) -> bool {
        matches!(self, Self::Open | Self::FirstDead | Self::SecondDead)
    }
}

/// Frames that the bus has received although they are not answers of slaves to this master.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Strangers {
    /// The source MAC address in the newest frame of another master, as received: bit 1 of its first byte is set if the
    /// frame has passed a slave. `None`: no such frame was received.
    pub other_master: Option<[u8; 6]>,
    /// The number of frames of this master that came back unchanged. A slave changes the source address of a frame, so
    /// these frames have passed no slave.
    pub unpassed: u64,
}

impl Strangers {
    /// The error text if a scan finds no slave and `unpassed` frames came back unchanged: something other than a slave
    /// has sent them back.
    pub fn echo(unpassed: u64) -> String {
        format!(
            "{unpassed} frames came back as they were sent, with the source address of this card, which each slave changes: the cable \
             ends in something that sends them back (a loop, a switch, another card of this machine); look where it goes"
        )
    }
}

/// Network cards that are gone for good: the adapter was pulled, or the interface was deleted. A card that comes back has
/// to be opened again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CardsGone {
    /// The names of the cards, and what the user can do, as text.
    pub text: Arc<str>,
    /// Whether no card is left, so that no frame reaches a slave any more.
    pub is_all: bool,
}

/// An EtherCAT network as the engine uses it. The module documentation describes the calls.
pub trait Fieldbus: Send {
    /// Returns who decides when a cycle runs. The result never changes.
    fn pacing(&self) -> Pacing;

    /// Starts a job.
    ///
    /// # Errors
    /// [`Busy`] while another job is running, or an SDO that cannot run beside the new job.
    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy>;

    /// Starts an SDO transfer.
    ///
    /// # Errors
    /// [`Busy`] while another SDO or a job is running. Whether an SDO may run beside a change of state depends on the bus.
    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy>;

    /// Announces the configuration that the next [`Job::Configure`] will probably have, judged by the settings that
    /// programs have made so far. Called while all slaves are in PreOP and no job or SDO is running. A bus on which a
    /// configuration takes long may begin it early. Programs must not notice the early start: their SDO transfers read
    /// the same values as without it, and no job waits longer than the configuration itself would have taken.
    fn prepare(&mut self, _config: &BusConfig, _now: Ns) {}

    /// Returns the result of the job once it has ended. Each result is returned once.
    fn poll_job(&mut self, now: Ns) -> Option<JobDone>;

    /// Returns the result of the SDO once it has ended. Each result is returned once.
    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone>;

    /// Cancels the running job, if there is one. [`Self::poll_job`] never returns its result. Slaves keep what the job
    /// has already changed in them.
    fn cancel_job(&mut self);

    /// Cancels the running SDO, if there is one. [`Self::poll_sdo`] never returns its result.
    fn cancel_sdo(&mut self);

    /// The number of sets of outputs that the bus accepts now, by its newest information. It may accept more, if cycles
    /// have passed since. With [`Pacing::Runner`] this is 1, or 0 while the bus is down.
    fn room(&self) -> u16;

    /// An estimate of how many sets of outputs wait in the queue of the bus, beyond the few that are always in flight.
    /// A waiting set could have been sent in an earlier cycle. `None`: the bus has no estimate, and the engine computes
    /// one from the number of cycles that have passed. The estimate does not show which outputs were sent.
    fn held_estimate(&self) -> Option<u64> {
        None
    }

    /// Starts to discard the outputs that were accepted and not sent. Until [`Self::poll_clear`] returns the result,
    /// cycles may still send such outputs, and the engine pushes nothing: new outputs could be discarded with the old
    /// ones.
    fn clear_ahead(&mut self, now: Ns);

    /// Returns the result of [`Self::clear_ahead`] once all queued outputs are discarded. Each result is returned once.
    /// There is a result even while the bus is down.
    fn poll_clear(&mut self, now: Ns) -> Option<Cleared>;

    /// Gives the bus a set of outputs.
    ///
    /// # Errors
    /// [`BusError`] if the bus has no room or is down; it has not accepted the outputs then.
    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError>;

    /// Returns the next cycle that has passed by `now`, and puts the inputs of that cycle into `inputs`; `None`: no further
    /// cycle has passed.
    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone>;

    /// Lets the bus work from `now` to `until`, both on the runner's clock. A bus whose exchanges take real time makes
    /// them here, on the runner's thread. In [`Self::poll`] it starts no exchange that would end after the `now` of the
    /// poll, so that the poll does not delay the cycle. A runner that is late passes an `until` that is not after
    /// `now`, and catches up on its cycles.
    fn work_until(&mut self, _now: Ns, _until: Ns) {}

    /// Whether a late runner runs its missed cycles one directly after the other. This is useless if the slaves have
    /// real clocks: if two sets of outputs arrive within one cycle of its own clock, a slave uses only the later one.
    /// Such a bus returns false, and the runner skips the missed cycles.
    fn catches_up(&self) -> bool {
        true
    }

    /// Reports that a late runner has skipped cycles. `left_out_ns`: the total duration of the skipped cycles, ns. The
    /// runner's time does not include it, so it falls behind a clock of the bus by another `left_out_ns`.
    fn leave_out(&mut self, _left_out_ns: Ns) {}

    /// Whether the hardware that runs the bus does not answer. Then pushed outputs are not sent.
    fn is_down(&self) -> bool {
        false
    }

    /// The slave with the reference clock: the first slave found that has distributed clocks (SK-11, UG15). `None`: no
    /// slave has distributed clocks, the ECM-XF itself is the reference clock, or the bus cannot find out.
    fn reference_clock(&self) -> Option<u8> {
        None
    }

    /// The state of the cable ring; `None`: the bus has no second card.
    fn ring(&self) -> Option<RingState> {
        None
    }

    /// The network cards that are gone; `None`: none is, or the bus has no cards. Called in each cycle, so it must not
    /// allocate.
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }

    /// Frames that the bus has received although they are not answers of slaves. The default value means that there
    /// were none, or that the bus does not know.
    fn strangers(&self) -> Strangers {
        Strangers::default()
    }

    /// The six local inputs of the chip that runs the bus: bit k is input k (SK-8). `None`: the bus has no local inputs,
    /// and the board shows the values that scripts and tests set.
    fn local_inputs(&self) -> Option<u8> {
        None
    }

    /// Sets the six local outputs of the chip that runs the bus: bit k is output k (SK-8). Called when they change. A
    /// bus without local outputs ignores the call.
    fn set_local_outputs(&mut self, _bits: u8) {}
}
