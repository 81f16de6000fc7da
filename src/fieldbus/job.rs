//! Jobs: operations of a bus that take longer than one cycle, and their results. The engine starts an SDO transfer and
//! polls for its result in the same way.

use super::{AlState, BusConfig, Ns, SlaveSet};
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::master::ScanError;

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

/// An operation that takes longer than one cycle. A bus runs one job at a time. Some buses can run an SDO transfer
/// beside [`Job::State`], so that a slave that is slow to change its state does not delay SDO transfers with other
/// slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "a job is made a few times in a board's life and never stored in bulk")]
pub enum Job {
    /// Finds the slaves in the network. Every slave goes to Init, so its earlier configuration is no longer valid.
    Scan,
    /// In PreOP, maps the process data of the selected slaves and writes the mode of operation (0x6060) of their axes.
    Configure(BusConfig),
    /// Brings the given slaves to an AL state.
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
    /// The scan has failed, and no slave can be used.
    NotScanned(ScanError),
    /// The slaves are configured, or the error names the first one that refused.
    Configure(Result<Configured, Refusal>),
    /// The configuration has failed because it exceeds a limit of the hardware that runs the bus.
    Beyond(HardwareLimit),
    /// The slaves are in the requested state, or the error names the first one that is not.
    State(Result<(), Refusal>),
}

/// The result of an SDO: the value that was read (zero-extended) or written, or the abort code.
pub type SdoDone = Result<u32, AbortCode>;

/// What the bus has found out in a successful [`Job::Configure`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configured {
    /// The slaves in [`Role::Hsp`](super::Role::Hsp) that have a second axis: its controlword 0x6840 was readable by
    /// SDO \[OURS].
    pub second_axes: SlaveSet,
    /// Slaves that are not in [`BusConfig::selected`] but have left OP, because the bus could configure the selected
    /// slaves only that way. They keep their mapping and stay below OP until a [`Job::State`] brings them back.
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
    /// The SDO transfer that has failed, and its abort code. `None`: the refusal does not concern an SDO transfer.
    pub abort: Option<(ObjectAddress, AbortCode)>,
}

impl Refusal {
    /// The value of [`Self::al_status`] if the slave answers and is not in the requested state, but reports no AL
    /// status code. \[OURS] No known slave reports this value itself.
    pub const WITHOUT_REASON: u16 = u16::MAX;

    /// A refusal that does not concern an SDO transfer, with this AL status code.
    pub(crate) const fn of(slave: u8, AlStatus(al_status): AlStatus) -> Self {
        Self { slave, al_status, abort: None }
    }

    pub(crate) const fn no_answer(slave: u8) -> Self {
        Self::of(slave, AlStatus::NONE)
    }
}

/// A limit of the hardware that runs a bus, such as an ECM-XF, that a configuration exceeds. It concerns no single
/// slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HardwareLimit {
    /// The exchanges of packets with the chip (ECM-XF) that one cycle needs take longer than the cycle.
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
    /// The process data of one cycle do not fit into a packet to or from the chip.
    #[error("{bytes} bytes of process data in a cycle do not fit into a packet, which holds {most}; use fewer slaves")]
    ProcessData {
        /// The number of bytes of all outputs or of all inputs, whichever is larger.
        bytes: usize,
        /// The maximum number of bytes of process data in a packet.
        most: usize,
    },
}

/// A job or an SDO transfer was not started because another job or SDO transfer is running. Only an SDO transfer and
/// [`Job::State`] may run at the same time, on a bus that can do so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;
