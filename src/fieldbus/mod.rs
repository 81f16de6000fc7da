//! How the EC01M model reaches its slaves: the trait [`Fieldbus`], behind which a simulator, an ECM-XF or a network card
//! stands.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `mod.rs` | the trait, and the process data that go through it |
//! | `job.rs` | what of it takes longer than a cycle, and how that ends |
//! | `pdo.rs` | which objects the board maps for each kind of slave, and how they lie in an image of bytes |
//! | `pdo/downloads.rs` | which SDOs do that mapping, and in which order |
//! | `sim.rs` | the network of simulated slaves: cycles, working counter, lost slaves |
//! | `sim/jobs.rs`, `sim/timing.rs` | how its scan, configuration, changes of state and SDOs run, and how long they take |
//! | `nic/` | the network at the end of a network card, over our own master: the same over frames of EtherCAT |
//! | `xf/` | the network behind an ECM-XF: the same jobs and cycles over the driver of that chip |
//!
//! A bus never blocks and never asks for the time. What takes long is started and polled: a scan, a configuration or a change
//! of state as a [`Job`], an SDO as an [`SdoRequest`]. One of them runs at a time, but an SDO may run beside a change of state.
//! Process data are pushed and polled once a cycle. [`Fieldbus::pacing`] says who owns the cycle:
//!
//! - [`Pacing::Runner`]: our runner decides when a cycle is; one [`Outputs`] goes in, one [`CycleDone`] comes out.
//! - [`Pacing::Bus`]: the bus runs its own cycle and takes outputs ahead, up to a depth. One poll may find that any
//!   number of cycles have passed, and the inputs of a cycle belong to outputs pushed some cycles ago. Which outputs were
//!   sent is known by the ids that come back in [`CycleDone::outputs`] and by nothing else, since such a bus knows its fill
//!   level only as of some exchanges ago. Discarding what it has taken ahead takes a while, too:
//!   [`Fieldbus::clear_ahead`].

mod job;
pub mod nic;
pub mod pdo;
#[cfg(feature = "sim")]
pub mod sim;
pub mod xf;

use std::sync::Arc;

use crate::ethercat::cia402::{Controlword, Mode, Statusword};
use crate::sk::{CycleTime, DriveSync, SlaveKind};

pub use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
pub use job::{Busy, Configured, HardwareLimit, Job, JobDone, Refusal, SdoDone, SdoRequest};

/// The most axes that a slave has: a two-channel HSP has two.
pub const MAX_AXES: usize = 2;

/// How long a network takes at least from SET_STATE until its slaves leave OP, beside [`CHANGE_SLAVE_NS`] for each, ns.
///
/// \[OURS] A change "takes several cycles" (SK-3.1), in which the FIFO goes on: commands that wait there when SET_STATE comes,
/// such as SV_OFF behind the end of a motion, are still executed in this time, on every bus.
pub const LEAVING_OP_NS: Ns = 20_000_000;
/// What each slave that takes part adds to a change of state, ns. \[OURS]
pub const CHANGE_SLAVE_NS: Ns = 2_000_000;

/// How long the commands that wait in the FIFO are still executed before that many slaves leave OP, ns.
pub(crate) const fn leaving_op_ns(slaves: u8) -> Ns {
    LEAVING_OP_NS + CHANGE_SLAVE_NS * slaves as Ns
}

/// The inputs of a slave are stale, and it is lost, after so many cycles without new ones, and so long, ns. \[OURS] In this time it
/// is found out who is missing, so that others which share a datagram with a lost slave go on. While that has no answer it is waited for
/// [`STALE_AT_LAST_NS`].
pub const STALE_AFTER: (u32, Ns) = (10, 20_000_000);
/// After so long inputs are stale in any case, ns: as long as the watchdogs of slaves wait for outputs. \[OURS]
pub const STALE_AT_LAST_NS: Ns = 100_000_000;

/// Whether inputs are stale after so many cycles of that length without new ones. `is_searched`: who is missing was looked for since.
pub(crate) const fn is_stale(cycles: u32, cycle_ns: Ns, is_searched: bool) -> bool {
    let (least_cycles, least_ns) = STALE_AFTER;
    let time_ns = cycles as Ns * cycle_ns;
    cycles >= least_cycles && (is_searched && time_ns >= least_ns || time_ns >= STALE_AT_LAST_NS)
}

/// Who owns the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// Our runner owns it: one push and one poll a cycle.
    Runner,
    /// The bus owns it and takes outputs ahead.
    Bus {
        /// The most sets of outputs that it holds, whatever process data are configured. [`Fieldbus::room`] says how many
        /// it takes now.
        depth: u16,
        /// The most cycles by which the answer to a cycle is polled late, and by which a lost slave is named late.
        answer_delay: u16,
    },
}

/// What a slave is used as. The role decides which process data are mapped (SK-7, table).
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
    /// The role of a slave that SET_AXIS declares as that kind, and DRIVE_MODE to run in that mode.
    pub const fn of(kind: SlaveKind, mode: Mode) -> Self {
        match kind {
            SlaveKind::Drive => Self::Drive(mode),
            SlaveKind::Step => Self::Step(mode),
            SlaveKind::Hsp => Self::Hsp(mode),
            SlaveKind::Io => Self::Io,
            SlaveKind::None => Self::Unused,
        }
    }

    /// The mode of operation of its axes; `None`: it has no axes.
    pub const fn mode(self) -> Option<Mode> {
        match self {
            Self::Drive(mode) | Self::Step(mode) | Self::Hsp(mode) => Some(mode),
            Self::Io | Self::Unused => None,
        }
    }

    /// Whether the board has process data for this role (SK-7, table): it has none for a pulse module in CST, and for a
    /// stepper in CSP alone \[OURS]. True of a slave that is not used, which needs none.
    pub fn has_process_data(self) -> bool {
        self == Self::Unused || pdo::ProcessData::of(self, false).is_some()
    }
}

/// How one slave is to be configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveConfig {
    /// What the slave is used as.
    pub role: Role,
    /// Synchronization type, 0x1C32:1 and 0x1C33:1.
    pub sync: DriveSync,
}

/// What a bus needs to know before slaves can go to SafeOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// The EtherCAT cycle in OP.
    pub cycle: CycleTime,
    /// The slaves that are to be configured. The others keep their configuration and their state: slaves that were lost are
    /// configured again while the rest stays in OP.
    pub selected: SlaveSet,
    /// Slave n is `slaves[n - 1]`; entries beyond the slaves found have no effect.
    pub slaves: [SlaveConfig; MAX_SLAVES],
}

/// What the master sends to one axis in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisOut {
    /// Controlword, 0x6040.
    pub controlword: Controlword,
    /// Digital outputs: 0x60FE:1 of an HSP, the 16 outputs of an IO slave.
    pub outputs: u16,
    /// The target that is mapped for the role: 0x607A in CSP (counts), 0x60FF in CSV (counts/s), 0x6071 in CST (0.1 % of
    /// rated torque).
    pub target: i32,
}

/// What one axis sends back in a cycle.
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
    /// Digital inputs: 0x60FD of an HSP, the 16 inputs of an IO slave.
    pub inputs: u16,
}

/// Process data to one slave.
pub type SlaveOut = [AxisOut; MAX_AXES];
/// Process data from one slave.
pub type SlaveIn = [AxisIn; MAX_AXES];

/// Process data of one cycle to all slaves.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// The number that the engine gives this set; it comes back in [`CycleDone::outputs`].
    pub id: u64,
    /// Slave n is `slaves[n - 1]`.
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
    /// Slave n is `slaves[n - 1]`; the entry of a slave that did not answer stays as it was.
    pub slaves: [SlaveIn; MAX_SLAVES],
    /// Slaves that were found and did not answer in this cycle: their cable is cut, they have no power, or they have left
    /// the state that they were brought to. The engine takes a slave for lost after one such cycle, so that a bus on which
    /// single frames may get lost has to wait before it names a slave.
    pub lost: SlaveSet,
    /// Of each slave in `lost` (slave n is `lost_from[n - 1]`) the id of the first outputs that may not have reached it, where the
    /// bus learns of the loss later than they were sent, or has lost the answers in between; `None`: the outputs of the
    /// cycle that names it first.
    pub lost_from: [Option<u64>; MAX_SLAVES],
    /// Slaves that are not in OP as far as the bus knows, and so took no outputs in this cycle: on a way down some slaves
    /// leave OP before others.
    pub without_outputs: SlaveSet,
    /// The slaves among those that are below SafeOP as far as the bus knows, and so sent no inputs either.
    pub without_inputs: SlaveSet,
    /// Slaves that are not lost and whose inputs are not those of this cycle, but older: the working counter beside them was wrong, or
    /// may have been.
    pub held: SlaveSet,
    /// The slaves in `lost` that answer, but whose inputs were held for too long ([`STALE_AFTER`]).
    pub stale: SlaveSet,
    /// The AL status code with which each slave in `lost` that answers has left its state (slave n is `left_with[n - 1]`); 0: it has
    /// left none, or the bus does not know.
    pub left_with: [u16; MAX_SLAVES],
    /// For how long this machine has sent no frame a short time ago, since it was late by that, ns; 0: it was not, or the bus does not
    /// know.
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

/// A cycle that has passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleDone {
    /// When the cycle ran, in board time. Its answer may have come later.
    pub at: Ns,
    /// The id of the newest outputs that were sent by then: this cycle carried them, for the first time or again. Outputs
    /// with a lower id were sent before. `None`: none were sent yet, or the cycle repeated outputs on a bus that loses no
    /// answers.
    pub outputs: Option<u64>,
    /// How many sets of outputs that were taken, since the cycle polled before, have been given up: they reach no slave for
    /// all that the bus knows. The ids of later ones are higher all the same.
    pub outputs_lost: u32,
    /// How many cycles right before this one have lost answers, because they were not polled in time.
    pub answers_lost: u32,
    /// The working counter of the process data.
    pub working_counter: u16,
    /// What the working counter is when every slave answers; 0 on a bus that does not know it.
    pub expected_working_counter: u16,
    /// When the next cycle should run to stay in step with the distributed clocks; `None`: a period after this one.
    pub next_deadline: Option<Ns>,
}

/// How a [`Fieldbus::clear_ahead`] has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cleared {
    /// The id of the newest outputs that were sent; later ones never will be. `None`: none were sent.
    pub newest_sent: Option<u64>,
}

/// Why a bus takes no outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// [`Fieldbus::room`] was 0.
    #[error("the bus takes no more outputs now; push again when a cycle has passed")]
    Full,
    /// Frames reach no slave: the cable before the first one is cut, or the interface is down.
    #[error("the bus is down; check the cable to the first slave")]
    Down,
}

/// How a ring of cables is, with a network card at each end of the line of slaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RingState {
    /// Nothing has come back yet.
    #[default]
    Unknown,
    /// All cables are whole.
    Whole,
    /// A cable between two slaves is cut.
    Open,
    /// No frame comes from the first card to a slave.
    FirstDead,
    /// No frame comes from the second card to a slave.
    SecondDead,
}

impl RingState {
    /// Whether the next cut would cost slaves.
    pub const fn is_broken(self) -> bool {
        matches!(self, Self::Open | Self::FirstDead | Self::SecondDead)
    }
}

/// What comes back of the wire beside the answers of slaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Strangers {
    /// The source address of another master's newest frame, as slaves have changed it; `None`: there was none.
    pub other_master: Option<[u8; 6]>,
    /// Frames of ours that have come back as they were sent: they have passed no slave.
    pub unpassed: u64,
}

impl Strangers {
    /// What it means that there is no slave and so many frames have come back as they were sent.
    pub fn echo(unpassed: u64) -> String {
        format!(
            "{unpassed} frames came back as they were sent, with the source address of this card, which each slave changes: the cable \
             ends in something that sends them back (a loop, a switch, another card of this machine); look where it goes"
        )
    }
}

/// Network cards that are gone for good: their adapter was pulled, or their interface deleted. If one comes back it has to be opened
/// again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CardsGone {
    /// Which, and what to do.
    pub text: Arc<str>,
    /// Whether no card is left, so that no frame reaches a slave any more.
    pub is_all: bool,
}

/// A way to run an EtherCAT network. The page of this module says who calls what when.
pub trait Fieldbus: Send {
    /// Who owns the cycle. The answer never changes.
    fn pacing(&self) -> Pacing;

    /// Starts a job.
    ///
    /// # Errors
    /// [`Busy`] while another job or an SDO is under way, beside which it cannot run.
    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy>;

    /// Starts the transfer of an SDO.
    ///
    /// # Errors
    /// [`Busy`] while another one is under way, or a job. Whether an SDO may run beside a change of state is up to the bus.
    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy>;

    /// Tells what the next [`Job::Configure`] will be, as far as is declared, while all slaves are in PreOP and nothing is under way.
    /// A bus whose configurations take long may begin with it, as long as no SDO shows that and no job waits for it longer than it
    /// would have taken.
    fn prepare(&mut self, _config: &BusConfig, _now: Ns) {}

    /// How the job has ended, once.
    fn poll_job(&mut self, now: Ns) -> Option<JobDone>;

    /// How the SDO has ended, once.
    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone>;

    /// Cancels the job under way, if there is one. [`Self::poll_job`] never gives its end.
    fn cancel_job(&mut self);

    /// Cancels the SDO under way, if there is one. [`Self::poll_sdo`] never gives its end.
    fn cancel_sdo(&mut self);

    /// How many sets of outputs the bus takes now, as far as it knows: it may take more, never less. With
    /// [`Pacing::Runner`] 1, or 0 while the bus is down.
    fn room(&self) -> u16;

    /// How many sets of outputs the bus holds that it could have sent sooner, by estimate; those on their way do not count.
    /// `None`: it does not know, and the engine estimates it from the cycles that have passed. This never says which outputs
    /// were sent.
    fn held_estimate(&self) -> Option<u64> {
        None
    }

    /// Starts to discard the outputs that were taken and not sent. Until it has ended cycles may go on sending them, and
    /// nothing may be pushed.
    fn clear_ahead(&mut self, now: Ns);

    /// How the clear under way has ended, once. It ends while the bus is down, too.
    fn poll_clear(&mut self, now: Ns) -> Option<Cleared>;

    /// Hands over a set of outputs.
    ///
    /// # Errors
    /// [`BusError`] if the bus has no room or is down; it has taken nothing then.
    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError>;

    /// The next cycle that has passed by `now`, and in `inputs` what the slaves sent in it; `None`: no further cycle has
    /// passed.
    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone>;

    /// It is `now` on the runner's clock, and the time until then is the bus's. A bus whose exchanges take real time makes them
    /// here, in the runner's own thread, and in [`Self::poll`] none that would end later than it was asked for. A runner that
    /// is late gives a time that has passed, and catches up on its cycles.
    fn work_until(&mut self, _now: Ns, _until: Ns) {}

    /// Whether cycles that a runner is late for are run one right after the other. A bus whose slaves have clocks of their own
    /// cannot: of two sets of outputs within a cycle of a slave it acts on the second one alone. Its late cycles are left out.
    fn catches_up(&self) -> bool {
        true
    }

    /// The runner was late, and has left out cycles that take so long together: the time that it gives does not include them, and is
    /// behind a clock of the bus's own by so much more than before.
    fn leave_out(&mut self, _left_out_ns: Ns) {}

    /// Whether the hardware that runs the bus does not answer: nothing is sent then, whatever is pushed.
    fn is_down(&self) -> bool {
        false
    }

    /// The slave with the reference clock: the first one found that has distributed clocks (SK-11, UG15). `None`: no slave
    /// has, or the bus does not know.
    fn reference_clock(&self) -> Option<u8> {
        None
    }

    /// How the ring of cables is; `None`: the bus has no second card.
    fn ring(&self) -> Option<RingState> {
        None
    }

    /// The network cards that are gone; `None`: all are there, or the bus has none. Asked in each cycle, so it must not allocate.
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }

    /// What comes back of the wire beside the answers of slaves; the default: nothing, or the bus does not know.
    fn strangers(&self) -> Strangers {
        Strangers::default()
    }

    /// The six inputs of the chip that runs the bus, bit k is input k (SK-8). `None`: the bus has none, and the board shows
    /// those that scripts and tests set.
    fn local_inputs(&self) -> Option<u8> {
        None
    }

    /// Sets the six outputs of the chip that runs the bus. Called when they change.
    fn set_local_outputs(&mut self, _bits: u8) {}
}
