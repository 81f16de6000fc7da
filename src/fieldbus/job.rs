//! What takes a bus longer than a cycle, and how it ends.

use super::{AlState, BusConfig, Ns, SlaveSet};
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};

/// An SDO transfer of up to 4 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoRequest {
    /// Slave, from 1. If there is none with this number the transfer ends in a timeout.
    pub slave: u8,
    /// The object that is read or written.
    pub object: ObjectAddress,
    /// `None`: an upload. `Some`: a download of that many bytes of that value.
    pub write: Option<(SdoSize, u32)>,
    /// How long the slave may take to answer; then the transfer ends with [`AbortCode::TIMEOUT`].
    pub timeout_ns: Ns,
}

/// Something that takes more than a cycle. A bus does one job at a time. An SDO may run beside [`Job::State`], so that a slave
/// which is slow to change its state does not block the mailboxes of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "a job is made a few times in a board's life and never stored in bulk")]
pub enum Job {
    /// Find the slaves. Every configuration is lost, and every slave goes to Init.
    Scan,
    /// Map the process data and write the mode of operation, in PreOP.
    Configure(BusConfig),
    /// Bring these slaves to an AL state.
    State {
        /// The state that is requested.
        target: AlState,
        /// The slaves that are to enter it.
        slaves: SlaveSet,
        /// How long the change may take before it has failed.
        timeout_ns: Ns,
    },
}

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobDone {
    /// The scan has ended.
    Scan {
        /// How many slaves were found, 0..=40.
        found: u8,
    },
    /// The slaves are configured, or the error names the first one that refused.
    Configure(Result<Configured, Refusal>),
    /// The slaves could not be configured, since the hardware that runs the bus cannot do what was asked for.
    Beyond(HardwareLimit),
    /// The slaves are in the requested state, or the error names the first one that is not.
    State(Result<(), Refusal>),
}

/// How an SDO ended: the value that was read, zero-extended, or written, or the abort code.
pub type SdoDone = Result<u32, AbortCode>;

/// What a [`Job::Configure`] found out about the slaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configured {
    /// Slaves of [`Role::Hsp`](super::Role::Hsp) that have a second axis: their controlword 0x6840 can be read by SDO \[OURS].
    pub second_axes: SlaveSet,
    /// Slaves that were not selected and have left OP all the same, because the bus cannot configure the selected ones
    /// otherwise. They keep their mapping, and they stay below OP until a [`Job::State`] brings them back.
    pub disturbed: SlaveSet,
}

/// A slave that has refused a configuration or a change of state, or has not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Slave, from 1.
    pub slave: u8,
    /// Its AL status code (ETG.1000.6 table 11); 0 if it has not answered, [`Self::WITHOUT_REASON`] if it answers and gives none.
    pub al_status: u16,
    /// The SDO that the slave has aborted, or that has failed with this code; `None`: the refusal was no SDO.
    pub abort: Option<(ObjectAddress, AbortCode)>,
}

impl Refusal {
    /// In the place of an AL status code: the slave answers, is not in the state that was asked for, and does not say why. \[OURS] No
    /// slave that is known has this code.
    pub const WITHOUT_REASON: u16 = u16::MAX;

    /// A slave that has this AL status code.
    pub(crate) const fn of(slave: u8, AlStatus(al_status): AlStatus) -> Self {
        Self { slave, al_status, abort: None }
    }

    /// A slave that has not answered.
    pub(crate) const fn no_answer(slave: u8) -> Self {
        Self::of(slave, AlStatus::NONE)
    }
}

/// What the hardware that runs a bus cannot do, whatever its slaves can.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HardwareLimit {
    /// Its exchanges with the chip take longer than the cycle.
    #[error(
        "a cycle of {} us cannot be held: the exchanges with the chip take {} us for each; take a longer cycle (SET_DC), a \
         faster clock (speed=), INT0 (int0=) or fewer slaves",
        .cycle_ns / 1000,
        .needed_ns.div_ceil(1000)
    )]
    Cycle {
        /// The cycle that was asked for, in nanoseconds.
        cycle_ns: Ns,
        /// The least that the exchanges of a cycle take, in nanoseconds.
        needed_ns: Ns,
    },
    /// No packet holds the process data of one cycle.
    #[error("{bytes} bytes of process data in a cycle do not fit into a packet, which holds {most}; use fewer slaves")]
    ProcessData {
        /// Bytes of all outputs or of all inputs, whichever are more.
        bytes: usize,
        /// What a packet holds.
        most: usize,
    },
}

/// Another job is under way, beside which the new one cannot run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;
