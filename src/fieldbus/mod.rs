//! How the EC01M model reaches its slaves: the seam behind which a simulator, an ECM-XF or a network card stands.
//!
//! A bus never blocks and never asks for the time: what takes long (scan, configure, states, SDO) is started as a
//! [`Job`] and polled, one at a time, but that an SDO may run beside a change of state; process data are pushed and
//! polled once a cycle. Who owns the cycle differs and is said by
//! [`Fieldbus::pacing`]:
//!
//! - [`Pacing::Runner`]: our runner decides when a cycle is; one [`Outputs`] goes in, one [`CycleDone`] comes out.
//! - [`Pacing::Bus`]: the bus runs its own cycle and takes outputs ahead, up to a depth. One poll may find that any
//!   number of cycles have passed, and the inputs of a cycle belong to outputs pushed some cycles ago. What was sent is
//!   known by the ids that come back in [`CycleDone::outputs`] and by nothing else: how full such a bus is it knows only
//!   as of some exchanges ago. Throwing away what lies ahead takes a while, too: [`Fieldbus::clear_ahead`].

#[cfg(feature = "sim")]
pub mod cable;
pub mod pdo;
#[cfg(feature = "sim")]
pub mod sim;

use crate::cia402::{Controlword, Mode, Statusword};
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::sk::{CycleTime, DriveSync};

pub use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};

/// Axes of one slave at most: a two-channel HSP has two.
pub const MAX_AXES: usize = 2;

/// Who owns the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// Our runner: one push and one poll a cycle.
    Runner,
    /// The bus, which takes outputs ahead.
    Bus {
        /// Sets of outputs that it holds at most, whatever process data are configured. What holds now is said by
        /// [`Fieldbus::room`].
        depth: u16,
        /// Cycles after which the answer of a cycle is polled at the latest, and after which a lost slave is named.
        answer_delay: u16,
    },
}

/// What a slave is used as; it fixes its process data (SK-7, table).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Not used: stays in PreOP.
    Unused,
    /// Servo drive in CSP, CSV or CST.
    Drive(Mode),
    /// Stepper, CSP.
    Step(Mode),
    /// Pulse module in CSP or CSV.
    Hsp(Mode),
    /// 16 + 16 inputs and outputs.
    Io,
}

impl Role {
    /// The mode in which its axes move, `None` if it has none.
    pub const fn mode(self) -> Option<Mode> {
        match self {
            Self::Drive(mode) | Self::Step(mode) | Self::Hsp(mode) => Some(mode),
            Self::Io | Self::Unused => None,
        }
    }

    /// Whether there are process data for it (SK-7, table): a pulse module has none in CST, and a stepper in CSP alone
    /// \[OURS]. True of a slave that is not used, which needs none.
    pub fn has_process_data(self) -> bool {
        self == Self::Unused || pdo::ProcessData::of(self, false).is_some()
    }
}

/// How one slave is to be configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveConfig {
    /// What it is used as.
    pub role: Role,
    /// Its synchronisation.
    pub sync: DriveSync,
}

/// What a bus needs to know before SafeOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// EtherCAT cycle in OP.
    pub cycle: CycleTime,
    /// Who is to be configured. The others stay as they are, in whatever state: slaves that were lost are configured
    /// again while the rest goes on in OP.
    pub who: SlaveSet,
    /// Slave n is `slaves[n - 1]`; entries beyond the slaves found are without effect.
    pub slaves: [SlaveConfig; MAX_SLAVES],
}

/// An SDO transfer of up to 4 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoRequest {
    /// Slave, from 1. It may be absent: the transfer then ends in a timeout.
    pub slave: u8,
    /// Object.
    pub object: ObjectAddress,
    /// `None`: read. `Some`: write that many bytes of that value.
    pub write: Option<(SdoSize, u32)>,
    /// After this time without an answer the transfer ends with [`AbortCode::TIMEOUT`].
    pub timeout_ns: Ns,
}

/// Something that takes more than a cycle. A bus does one at a time; only [`Job::Sdo`] and [`Job::State`] run side by
/// side, so that a slave that is waited for does not keep the mailboxes of the others closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "a job is made a few times in a board's life and never stored in bulk")]
pub enum Job {
    /// Find the slaves. Whatever was configured before is forgotten, and every slave goes to Init.
    Scan,
    /// Map the process data and write the mode, in PreOP.
    Configure(BusConfig),
    /// Bring these slaves to a state.
    State {
        /// The state.
        target: AlState,
        /// Who.
        slaves: SlaveSet,
        /// After this time the change has failed.
        timeout_ns: Ns,
    },
    /// Move an SDO.
    Sdo(SdoRequest),
}

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobDone {
    /// That many slaves were found, 0..=40.
    Scan {
        /// Slaves.
        found: u8,
    },
    /// The slaves are configured, or the first one that refused.
    Configure(Result<Configured, Refusal>),
    /// The slaves are in the state asked for, or the first one that is not.
    State(Result<(), Refusal>),
    /// The value (read: zero-extended; written: as requested), or the abort code.
    Sdo(Result<u32, AbortCode>),
}

/// What has become of the slaves in a [`Job::Configure`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configured {
    /// Slaves of [`Role::Hsp`] that have a second axis: those whose controlword 0x6840 can be read by SDO \[OURS].
    pub second_axes: SlaveSet,
    /// Slaves that were not to be configured and have left OP all the same, because the bus can configure none without
    /// them. Their mapping is as it was, and they stay below OP until a [`Job::State`] brings them back.
    pub disturbed: SlaveSet,
}

/// A slave that does not follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Slave, from 1.
    pub slave: u8,
    /// Its AL status code (ETG.1000.6 table 11), 0 if it said nothing.
    pub al_status: u16,
    /// The SDO that it aborted, if it was one.
    pub abort: Option<(ObjectAddress, AbortCode)>,
}

/// The bus is at another job, beside which this one cannot run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

/// What the master sends to one axis in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisOut {
    /// 0x6040.
    pub controlword: Controlword,
    /// Digital outputs: 0x60FE of an HSP, the 16 outputs of an IO slave.
    pub outputs: u16,
    /// The target that the role maps: 0x607A in CSP (counts), 0x60FF in CSV, 0x6071 in CST (0.1 % of rated torque).
    pub target: i32,
}

/// What one axis sends back in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisIn {
    /// 0x6041.
    pub statusword: Statusword,
    /// 0x6077, 0.1 % of rated torque.
    pub torque: i16,
    /// 0x6064, counts.
    pub position: i32,
    /// 0x603F.
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
    /// The engine's number for this set; it comes back in [`CycleDone::outputs`].
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
    /// Slave n is `slaves[n - 1]`; a slave that did not answer keeps what stood here.
    pub slaves: [SlaveIn; MAX_SLAVES],
    /// Slaves that did not answer in this cycle although they were found: cut off, switched off, or fallen from the
    /// state they were brought to. The engine takes one such cycle for a loss, so a bus on which single frames may go
    /// astray waits before it names a slave.
    pub lost: SlaveSet,
    /// Of each slave in `lost` (slave n is `lost_from[n - 1]`) the first outputs that it has not got, where the bus knows
    /// that later than they were sent, or has lost the answers in between; `None`: those of the cycle that names it first.
    pub lost_from: [Option<u64>; MAX_SLAVES],
    /// Slaves that took no outputs in this cycle because they are not in OP, as far as the bus knows: on the way down
    /// some leave it before others.
    pub deaf: SlaveSet,
    /// Those of them that sent no inputs either because they are below SafeOP, as far as the bus knows.
    pub mute: SlaveSet,
}

impl Default for Inputs {
    fn default() -> Self {
        let slaves = [[AxisIn::default(); MAX_AXES]; MAX_SLAVES];
        let (lost, deaf, mute) = (SlaveSet::EMPTY, SlaveSet::EMPTY, SlaveSet::EMPTY);
        Self { slaves, lost, lost_from: [None; MAX_SLAVES], deaf, mute }
    }
}

/// A cycle that has passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleDone {
    /// When it was, in board time: not when its answer came.
    pub at: Ns,
    /// The newest outputs that were sent by then: the cycle carried them, as new ones or once more. Those with a lower
    /// id have been sent before. `None`: none yet, or the cycle repeated them on a bus that loses no answers.
    pub outputs: Option<u64>,
    /// Cycles right before this one whose answers are lost, because they were not polled in time.
    pub answers_lost: u32,
    /// Working counter of the process data.
    pub working_counter: u16,
    /// The working counter if every slave answers; 0 on a bus that does not say it.
    pub expected_working_counter: u16,
    /// When the bus would like the next cycle to run (distributed clocks nudge our runner); `None`: as planned.
    pub next_deadline: Option<Ns>,
}

/// What was left of the outputs that a bus had taken when [`Fieldbus::clear_ahead`] has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cleared {
    /// The newest outputs that were sent; those after them never will be. `None`: none were.
    pub newest_sent: Option<u64>,
}

/// Why a bus takes no outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// No room: [`Fieldbus::room`] was 0.
    #[error("the bus takes no more outputs now; push again when a cycle has passed")]
    Full,
    /// There is no bus: cable cut before the first slave, interface down.
    #[error("the bus is down; check the cable to the first slave")]
    Down,
}

/// A way to run an EtherCAT network. See the module's page for who calls what when.
pub trait Fieldbus: Send {
    /// Who owns the cycle. Never changes.
    fn pacing(&self) -> Pacing;

    /// Starts a job.
    ///
    /// # Errors
    /// [`Busy`] while another one is under way; a bus may take an SDO beside a change of state, or refuse it, too.
    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy>;

    /// The end of a job under way, once; of two, one after the other.
    fn poll_job(&mut self, now: Ns) -> Option<JobDone>;

    /// Gives up the job under way that is no SDO, if any; it then never ends.
    fn cancel_job(&mut self);

    /// Gives up the SDO under way, if any; it then never ends.
    fn cancel_sdo(&mut self);

    /// Sets of outputs the bus takes now, as far as it knows: it may take more, never less. [`Pacing::Runner`]: 1, or 0
    /// while the bus is down.
    fn room(&self) -> u16;

    /// Starts to throw away the outputs that were taken and not sent. Cycles may go on sending them until it has ended,
    /// and nothing is pushed meanwhile.
    fn clear_ahead(&mut self, now: Ns);

    /// The end of the clear under way, once; also while the bus is down.
    fn poll_clear(&mut self, now: Ns) -> Option<Cleared>;

    /// Hands outputs over.
    ///
    /// # Errors
    /// [`BusError`] if there is no room or no bus; nothing was taken then.
    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError>;

    /// The next cycle that has passed by `now`, with what the slaves sent in it; `None`: none (any more).
    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone>;

    /// The slave whose clock the others follow: the first one found that has distributed clocks (SK-11, UG15). `None`:
    /// there is none, or the bus cannot say.
    fn reference_clock(&self) -> Option<u8> {
        None
    }

    /// The six inputs at the chip that runs the bus, bit k is input k (SK-8). `None`: it has none, and they are those that
    /// the board is told.
    fn local_inputs(&self) -> Option<u8> {
        None
    }

    /// Sets the six outputs at the chip that runs the bus. Called when they change.
    fn set_local_outputs(&mut self, _bits: u8) {}
}
