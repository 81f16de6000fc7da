//! Why the network is not in the state that it was asked to go to: what byte 2 of slot 0 shows as 0x10 beside the last
//! state that all slaves reached, 0x12 most often.

use std::fmt;

use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::Refusal;
use crate::sk::{MasterState, SlaveKind, StateByte};

/// What the board knows of a change of state that has failed, or of a slave that has fallen. The wire shows nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateFailure {
    /// No slave was found.
    NoSlave,
    /// A slave has refused the process data of what it is declared as, on the way from PreOP to SafeOP: the usual cause is
    /// a slave that no SET_AXIS has declared, and that counts as IO then.
    Declared {
        /// Slave, from 1.
        slave: u8,
        /// What SET_AXIS says it is; IO if none said anything.
        kind: SlaveKind,
        /// Its AL status code (ETG.1000.6 table 11), 0 if it said none.
        al_status: u16,
        /// The SDO that it aborted, if it was one.
        abort: Option<(ObjectAddress, AbortCode)>,
    },
    /// DRIVE_MODE has given a slave a mode in which its kind has no process data (SK-7): CST to an HSP, another one than CSP
    /// to a STEP.
    Mode {
        /// Slave, from 1.
        slave: u8,
        /// What SET_AXIS says it is.
        kind: SlaveKind,
    },
    /// A slave has refused a state.
    Refused {
        /// Slave, from 1.
        slave: u8,
        /// The state.
        target: MasterState,
        /// Its AL status code (ETG.1000.6 table 11).
        al_status: u16,
    },
    /// A slave did not answer, or was not there in time.
    Silent {
        /// Slave, from 1.
        slave: u8,
    },
    /// The change took longer than a change may.
    Late {
        /// The state that was on its way.
        target: MasterState,
    },
    /// A slave fell from SafeOP or OP.
    Lost {
        /// Slave, from 1.
        slave: u8,
    },
}

impl StateFailure {
    /// Of a job of the bus that a slave has ended; `kind` is what that slave is declared as.
    pub(super) const fn of(refusal: Refusal, configuring: bool, target: MasterState, kind: SlaveKind) -> Self {
        let Refusal { slave, al_status, abort } = refusal;
        match (al_status, abort, configuring) {
            (0, None, _) => Self::Silent { slave },
            (_, _, true) => Self::Declared { slave, kind, al_status, abort },
            (_, _, false) => Self::Refused { slave, target, al_status },
        }
    }

    /// The slave that it is about, from 1; `None`: none in particular.
    pub const fn slave(&self) -> Option<u8> {
        match *self {
            Self::Declared { slave, .. }
            | Self::Mode { slave, .. }
            | Self::Refused { slave, .. }
            | Self::Silent { slave }
            | Self::Lost { slave } => Some(slave),
            Self::NoSlave | Self::Late { .. } => None,
        }
    }

    /// What to say beside a state byte wherever one is shown: this reason if there is one, else what such a byte means on
    /// any board ([`StateByte::explanation`]). `None`: the state has not failed.
    pub fn explain(state: StateByte, why: Option<&Self>) -> Option<String> {
        let general = state.explanation()?;
        Some(why.map_or_else(|| general.to_owned(), Self::to_string))
    }
}

/// A kind's name and its nibble.
struct Kind(SlaveKind);

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (nibble {:X})", self.0.name(), self.0.nibble())
    }
}

/// What happened, then what to do.
impl fmt::Display for StateFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSlave => f.write_str("no slave was found; look at the network cable and at the slaves' power"),
            Self::Declared { slave, kind, al_status, abort } => {
                write!(f, "slave {slave} refused to go to SafeOP as what SET_AXIS says it is, {}", Kind(*kind))?;
                if *kind == SlaveKind::Io {
                    f.write_str(", which is also what a slave is that no SET_AXIS has declared")?;
                }
                match abort {
                    Some((object, code)) => write!(f, ": SDO {object} aborted with {code}")?,
                    None => write!(f, ": {}", Status(*al_status))?,
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
            Self::Silent { slave } => {
                write!(f, "slave {slave} does not answer; look at its power and its cable, then SET_STATE again")
            }
            Self::Late { target } => {
                write!(f, "{target} was not reached in time; look at the slaves, then SET_STATE again")
            }
            Self::Lost { slave } => write!(
                f,
                "slave {slave} fell out of the network; look at its power and its cable, then send SET_STATE to bring it back"
            ),
        }
    }
}

/// An AL status code with its words.
struct Status(u16);

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AL status 0x{:04X}", self.0)?;
        // ETG.1000.6 table 11.
        f.write_str(match self.0 {
            0x0011 => " (invalid requested state change)",
            0x001B => " (sync manager watchdog)",
            0x001D => " (invalid output configuration: it has other process data)",
            0x001E => " (invalid input configuration: it has other process data)",
            _ => "",
        })
    }
}
