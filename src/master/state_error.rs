//! Why a slave is not in the state that was asked for.

use super::bus::Unanswered;
use crate::ethercat::registers::RequestedState;
use crate::ethercat::{AlState, AlStatus, Ns};

/// A slave that is not in the state that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("slave {slave} does not reach {target:?}: {reason}")]
pub struct StateError {
    /// Which one, from 1.
    pub slave: u8,
    /// The state that was asked for.
    pub target: AlState,
    /// Why.
    pub reason: StateReason,
}

/// Why a slave is not in a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateReason {
    /// It refuses, or has left the state again.
    #[error("it stays in state 0x{:X} with AL status code {code}", .state.code())]
    Refused {
        /// Where it is.
        state: RequestedState,
        /// Why.
        code: AlStatus,
    },
    /// The time is up.
    #[error("it is in state 0x{:X} when the time is up", .state.code())]
    TimeUp {
        /// Where it is.
        state: RequestedState,
    },
    /// Another change of its state is under way, or its EEPROM is in use.
    #[error(
        "another change of its state is under way, or its EEPROM is in use; wait until that has ended, or cancel it"
    )]
    Busy,
    /// It does not answer.
    #[error("it does not answer; check its cable and its power")]
    NoAnswer,
    /// It answers, but not to what the change has to read or to write.
    #[error(
        "it answers, but one of its registers that this needs was not read or not written (working counter {0} instead of 1); \
         switch it off and on, and look whether two slaves have one station address"
    )]
    NotTaken(u16),
    /// Its controller does not take the time after which it leaves OP without outputs: it could go on for ever after the master's end.
    #[error(
        "its watchdog of process data (registers 0x0400 and 0x0420) has {} us instead of {} us; switch it off and on, and if \
         that does not help leave it out of this network", .is_ns / 1000, .wanted_ns / 1000
    )]
    Watchdog {
        /// The time that it has, ns.
        is_ns: Ns,
        /// The time that it should have, ns.
        wanted_ns: Ns,
    },
}

impl StateReason {
    /// The AL status code; [`AlStatus::NONE`] if the slave has given none.
    pub const fn code(self) -> AlStatus {
        match self {
            Self::Refused { code, .. } => code,
            // What a slave says that finds that itself.
            Self::Watchdog { .. } => AlStatus::INVALID_WATCHDOG,
            Self::TimeUp { .. } | Self::Busy | Self::NoAnswer | Self::NotTaken(_) => AlStatus::NONE,
        }
    }
}

impl From<Unanswered> for StateReason {
    fn from(unanswered: Unanswered) -> Self {
        match unanswered {
            Unanswered::Lost => Self::NoAnswer,
            Unanswered::Counter(counter) => Self::NotTaken(counter),
        }
    }
}
