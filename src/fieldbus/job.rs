//! Jobs: operations of a bus that take longer than one cycle, and their results. SDO transfers are polled in the same way.

use super::{AlState, BusConfig, Ns, SlaveSet};
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};

/// An SDO transfer of up to 4 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoRequest {
    /// The number of the slave, counted from 1. If no slave has this number, the transfer ends in a timeout.
    pub slave: u8,
    /// The object to read or write.
    pub object: ObjectAddress,
    /// `None`: an upload. `Some`: a download of this value with this size.
    pub write: Option<(SdoSize, u32)>,
    /// The timeout for the slave's answer, ns. After it the transfer ends with [`AbortCode::TIMEOUT`].
    pub timeout_ns: Ns,
}

/// An operation that takes longer than one cycle. A bus runs one job at a time. An SDO may run beside [`Job::State`], so
/// that a slave that changes its state slowly does not block the mailboxes of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "a job is made a few times in a board's life and never stored in bulk")]
pub enum Job {
    /// Find the slaves. Every configuration is lost, and every slave goes to Init.
    Scan,
    /// Map the process data and write the mode of operation, in PreOP.
    Configure(BusConfig),
    /// Bring these slaves to an AL state.
    State {
        /// The requested state.
        target: AlState,
        /// The slaves that are to enter the requested state.
        slaves: SlaveSet,
        /// The timeout of the change, ns.
        timeout_ns: Ns,
    },
}

/// The result of a job, when it has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobDone {
    /// The scan has ended.
    Scan {
        /// How many slaves the scan has found, 0..=40.
        found: u8,
    },
    /// The slaves are configured, or the error names the first one that refused.
    Configure(Result<Configured, Refusal>),
    /// The configuration has failed because it exceeds a limit of the hardware that runs the bus.
    Beyond(HardwareLimit),
    /// The slaves are in the requested state, or the error names the first one that is not.
    State(Result<(), Refusal>),
}

/// The result of an SDO: the value that was read (zero-extended) or written, or the abort code.
pub type SdoDone = Result<u32, AbortCode>;

/// What is known after a successful [`Job::Configure`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configured {
    /// Slaves of [`Role::Hsp`](super::Role::Hsp) that have a second axis: this is known because their controlword 0x6840 can be
    /// read by SDO \[OURS].
    pub second_axes: SlaveSet,
    /// Slaves that were not selected but have left OP, because the bus cannot configure the selected ones otherwise. They
    /// keep their mapping and stay below OP until a [`Job::State`] brings them back.
    pub disturbed: SlaveSet,
}

/// A slave that has refused a configuration or a change of state, or has not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The number of the slave, counted from 1.
    pub slave: u8,
    /// The AL status code of the slave (ETG.1000.6 table 11); 0 if the slave has not answered, [`Self::WITHOUT_REASON`] if
    /// it answers but has no code.
    pub al_status: u16,
    /// The SDO that the slave has aborted, or that has failed with this code; `None`: the refusal does not concern an SDO.
    pub abort: Option<(ObjectAddress, AbortCode)>,
}

impl Refusal {
    /// Replaces the AL status code if the slave answers and is not in the requested state, but has no AL status code.
    /// \[OURS] No known slave uses this code.
    pub const WITHOUT_REASON: u16 = u16::MAX;

    /// The refusal by a slave with this AL status code.
    pub(crate) const fn of(slave: u8, AlStatus(al_status): AlStatus) -> Self {
        Self { slave, al_status, abort: None }
    }

    /// The refusal that stands for a slave that has not answered.
    pub(crate) const fn no_answer(slave: u8) -> Self {
        Self::of(slave, AlStatus::NONE)
    }
}

/// A limit of the hardware that runs a bus, such as an ECM-XF, that a configuration exceeds. It concerns no single
/// slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HardwareLimit {
    /// The exchanges with the chip take longer than the cycle.
    #[error(
        "a cycle of {} us cannot be held: the exchanges with the chip take {} us for each; take a longer cycle (SET_DC), a \
         faster clock (speed=), INT0 (int0=) or fewer slaves",
        .cycle_ns / 1000,
        .needed_ns.div_ceil(1000)
    )]
    Cycle {
        /// The requested cycle time, ns.
        cycle_ns: Ns,
        /// The minimum time for the exchanges with the chip in one cycle, ns.
        needed_ns: Ns,
    },
    /// The process data of one cycle do not fit into a packet.
    #[error("{bytes} bytes of process data in a cycle do not fit into a packet, which holds {most}; use fewer slaves")]
    ProcessData {
        /// The number of bytes of all outputs or of all inputs, whichever is larger.
        bytes: usize,
        /// How many bytes of process data a packet can hold.
        most: usize,
    },
}

/// A job or an SDO was not started, because a job or an SDO is running beside which it cannot run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;
