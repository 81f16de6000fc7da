//! Why the network is not in the requested state. Byte 2 of slot 0 in reports shows only that there is a failure: it is 0x10
//! plus the last state that all slaves have reached, most often 0x12.

use std::fmt;

use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{HardwareLimit, Ns, Refusal, ScanError};
use crate::sk::{MasterState, SlaveKind, StateByte};

/// The AL status code for an invalid watchdog configuration (ETG.1000.6 table 11).
const WRONG_WATCHDOG: u16 = AlStatus::INVALID_WATCHDOG.0;

/// A slave that has left SafeOP or OP by itself, with its AL status code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveFall {
    /// The number of the slave in network order, counted from 1.
    pub slave: u8,
    /// The AL status code (ETG.1000.6 table 11).
    pub al_status: u16,
    /// For how long this machine sent no frames just before the slave left its state, ns; 0: it was not late, or the
    /// bus does not know. The slave's watchdog may have expired in such a pause.
    pub stood_still_ns: Ns,
}

impl fmt::Display for SlaveFall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { slave, al_status, stood_still_ns } = *self;
        let status = Status(al_status);
        match (AlStatus(al_status), stood_still_ns / 1_000_000) {
            (AlStatus::WATCHDOG, 0) => write!(
                f,
                "slave {slave} got no outputs for too long, and its watchdog took it out of OP, {status}: frames are lost on their way \
                 (`ecmsk bus errors`), or this machine is late (`ecmsk doctor`); then send SET_STATE to bring it back"
            ),
            (AlStatus::WATCHDOG, ms) => write!(
                f,
                "this machine stood still for {ms} ms; the slaves' watchdog took slave {slave} out of OP, {status}: give the cycle a \
                 priority and a processor of its own (priority=, cpu=), see `ecmsk doctor`, then send SET_STATE to bring it back"
            ),
            _ => write!(
                f,
                "slave {slave} has left its state by itself, {status}; look at its display and its manual, then send SET_STATE to \
                 bring it back"
            ),
        }
    }
}

/// Why a change of state has failed, or which slave has left its state. Reports do not show the reason: programs get it
/// from a [`Snapshot`](super::Snapshot).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateFailure {
    /// No slave was found.
    NoSlave,
    /// The scan has failed: there are too many slaves, their number has changed, or frames were lost.
    Scan(ScanError),
    /// In the change from PreOP to SafeOP a slave has refused the PDOs of the kind that SET_AXIS has declared for it.
    /// Usually no SET_AXIS has declared the slave, so that it counts as IO.
    Declared {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The kind of slave that SET_AXIS has declared; IO if the slave is undeclared.
        kind: SlaveKind,
        /// The AL status code (ETG.1000.6 table 11), 0 if there was none.
        al_status: u16,
        /// The SDO that the slave has aborted; `None`: it has aborted no SDO.
        abort: Option<(ObjectAddress, AbortCode)>,
    },
    /// DRIVE_MODE has given a slave a mode for which its kind has no process data (SK-7): CST to an HSP, or a mode
    /// other than CSP to a STEP.
    Mode {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The kind of slave that SET_AXIS has declared.
        kind: SlaveKind,
    },
    /// In a change of state a slave has refused to go to the requested state.
    Refused {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The state that the slave has refused.
        target: MasterState,
        /// The AL status code (ETG.1000.6 table 11).
        al_status: u16,
    },
    /// A slave does not accept the watchdog timeout (registers 0x0400 and 0x0420), or reports it as invalid. After this
    /// time without outputs a slave leaves OP.
    Watchdog {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// In a change of state a slave has not answered the master.
    Silent {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// In a change of state a slave answers, but has not reached the target state, and shows no AL status code.
    WithoutReason {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The state that the slave had to reach.
        target: MasterState,
    },
    /// The master hardware that runs the network, such as an ECM-XF, cannot do what SET_AXIS and SET_DC have declared.
    Hardware(HardwareLimit),
    /// The change of state exceeded its timeout.
    Late {
        /// The state that the network had to reach next.
        target: MasterState,
    },
    /// A slave was lost: it does not answer any more, or it has left SafeOP or OP by itself and its AL status code is
    /// unknown.
    Lost {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// A slave has left SafeOP or OP by itself, and its AL status code is known.
    Fell(SlaveFall),
    /// A slave answers, but its inputs are stale: the working counter of the datagram with its inputs was wrong for at
    /// least [`STALE_AFTER`](crate::fieldbus::STALE_AFTER).
    Stale {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
}

impl StateFailure {
    /// The state failure that follows from a slave's `refusal`. `configuring`: the refused step was the configuration
    /// of the slaves. `target`: the state that the step leads to. `kind`: the declared kind of that slave.
    pub(super) const fn of(refusal: Refusal, configuring: bool, target: MasterState, kind: SlaveKind) -> Self {
        let Refusal { slave, al_status, abort } = refusal;
        match (al_status, abort, configuring) {
            (WRONG_WATCHDOG, None, _) => Self::Watchdog { slave },
            (0, None, _) => Self::Silent { slave },
            (Refusal::WITHOUT_REASON, None, _) => Self::WithoutReason { slave, target },
            (_, _, true) => Self::Declared { slave, kind, al_status, abort },
            (_, _, false) => Self::Refused { slave, target, al_status },
        }
    }

    /// The slave that has caused the failure, from 1; `None`: no single slave has caused it.
    pub const fn slave(&self) -> Option<u8> {
        match *self {
            Self::Declared { slave, .. }
            | Self::Mode { slave, .. }
            | Self::Refused { slave, .. }
            | Self::Watchdog { slave }
            | Self::Silent { slave }
            | Self::WithoutReason { slave, .. }
            | Self::Lost { slave }
            | Self::Fell(SlaveFall { slave, .. })
            | Self::Stale { slave } => Some(slave),
            Self::NoSlave | Self::Scan(_) | Self::Hardware(_) | Self::Late { .. } => None,
        }
    }

    /// Whether a scan has failed, or has found no slave. The next scan that finds slaves ends such a failure.
    pub(super) const fn is_of_scan(&self) -> bool {
        matches!(self, Self::NoSlave | Self::Scan(_))
    }

    /// The text to show beside a state byte: the reason `why` if it is known, else what the state byte says by itself
    /// ([`StateByte::explanation`]). `None`: the byte shows no failure.
    pub fn explain(state: StateByte, why: Option<&Self>) -> Option<String> {
        let general = state.explanation()?;
        Some(why.map_or_else(|| general.to_owned(), Self::to_string))
    }
}

/// Formats a kind of slave for users: its name, and its nibble in SET_AXIS.
struct Kind(SlaveKind);

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (nibble {:X})", self.0.name(), self.0.nibble())
    }
}

/// Formats the reason, followed by what the user can do.
impl fmt::Display for StateFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSlave => f.write_str("no slave was found; look at the network cable and at the slaves' power"),
            Self::Scan(error) => error.fmt(f),
            Self::Declared { slave, kind, al_status, abort } => {
                write!(f, "slave {slave} refused to go to SafeOP as what SET_AXIS says it is, {}", Kind(*kind))?;
                if *kind == SlaveKind::Io {
                    f.write_str(", which is also what a slave is that no SET_AXIS has declared")?;
                }
                match (abort, al_status) {
                    (Some((object, code)), 0) => write!(f, ": SDO {object} aborted with {code}")?,
                    (Some((object, code)), _) => {
                        write!(f, ": {}: SDO {object} aborted with {code}", Status(*al_status))?;
                    }
                    (None, _) => write!(f, ": {}", Status(*al_status))?,
                }
                f.write_str(
                    "; declare it in PreOP with SET_AXIS (0 drive, 1 IO, 2 HSP, 3 STEP, F none), then SET_STATE again",
                )
            }
            Self::Mode { slave, kind } => write!(
                f,
                "slave {slave} is a {} and has no process data in the mode that DRIVE_MODE gave it; an HSP takes CSP and \
                 CSV, a STEP CSP alone: mend DRIVE_MODE in PreOP, then SET_STATE again",
                Kind(*kind)
            ),
            Self::Refused { slave, target, al_status } => {
                write!(
                    f,
                    "slave {slave} refused {target}: {}; look at the slave, then SET_STATE again",
                    Status(*al_status)
                )
            }
            Self::Watchdog { slave } => write!(
                f,
                "slave {slave} does not take the time of the watchdog that stops it when no frame comes (registers 0x0400 and \
                 0x0420), {}; switch it off and on, then SET_STATE again, and leave it out of the network if that does not help",
                Status(WRONG_WATCHDOG)
            ),
            Self::Silent { slave } => {
                write!(f, "slave {slave} does not answer; look at its power and its cable, then SET_STATE again")
            }
            Self::WithoutReason { slave, target } => write!(
                f,
                "slave {slave} answers, has not reached {target}, and does not say why (no AL status code); look at its display and \
                 its manual, then SET_STATE again"
            ),
            Self::Hardware(limit) => limit.fmt(f),
            Self::Late { target } => {
                write!(f, "{target} was not reached in time; look at the slaves, then SET_STATE again")
            }
            Self::Lost { slave } => write!(
                f,
                "slave {slave} fell out of the network; look at its power and its cable, then send SET_STATE to bring it back"
            ),
            Self::Fell(fall) => fall.fmt(f),
            Self::Stale { slave } => write!(
                f,
                "the inputs of slave {slave} do not come any more, or come with a wrong working counter, and nobody knows where its axes \
                 are; look at its cables (`ecmsk bus errors`), then send SET_STATE to bring it back"
            ),
        }
    }
}

/// Formats an AL status code for users, with its meaning.
struct Status(u16);

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match AlStatus(self.0) {
            AlStatus::INVALID_OUTPUTS | AlStatus::INVALID_INPUTS => {
                let of = if self.0 == AlStatus::INVALID_OUTPUTS.0 { "output" } else { "input" };
                write!(f, "AL status 0x{:04X} (invalid {of} configuration: it has other process data)", self.0)
            }
            status => write!(f, "AL status {status}"),
        }
    }
}
