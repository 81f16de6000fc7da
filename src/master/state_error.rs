//! Errors of changes of state: why a slave is not in the requested state.

use super::bus::Unanswered;
use crate::ethercat::registers::RequestedState;
use crate::ethercat::{AlState, AlStatus, Ns};

/// A slave that has not reached the requested state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("slave {slave} does not reach {target:?}: {reason}")]
pub struct StateError {
    /// Slave, from 1.
    pub slave: u8,
    /// The requested state, which the slave has not reached.
    pub target: AlState,
    /// Why the slave has not reached the state.
    pub reason: StateReason,
}

/// Why a slave is not in the requested state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateReason {
    /// The slave refuses the state, or has left it again.
    #[error("it stays in state 0x{:X} with AL status code {code}", .state.code())]
    Refused {
        /// The present state of the slave.
        state: RequestedState,
        /// The AL status code of the slave.
        code: AlStatus,
    },
    /// The timeout has passed.
    #[error("it is in state 0x{:X} at the timeout", .state.code())]
    TimeUp {
        /// The state of the slave at the timeout.
        state: RequestedState,
    },
    /// Another change of the slave's state is under way, or its EEPROM is in use.
    #[error(
        "another change of its state is under way, or its EEPROM is in use; wait until that has ended, or cancel it"
    )]
    Busy,
    /// The slave does not answer.
    #[error("it does not answer; check its cable and its power")]
    NoAnswer,
    /// The slave answers, but a register that the change needs could not be read or written.
    #[error(
        "it answers, but a register was not read or not written (working counter {0} instead of 1); switch it off and \
         on, and check that no two slaves have the same station address"
    )]
    NotTaken(u16),
    /// The slave controller refuses the watchdog time after which it leaves OP without outputs. Without that it could
    /// stay in OP for ever after the end of the master.
    #[error(
        "its watchdog of process data (registers 0x0400 and 0x0420) has {} us instead of {} us; switch it off and on, and if \
         that does not help leave it out of this network", .is_ns / 1000, .wanted_ns / 1000
    )]
    Watchdog {
        /// The watchdog time that the slave has, ns.
        is_ns: Ns,
        /// The watchdog time that it should have, ns.
        wanted_ns: Ns,
    },
}

impl StateReason {
    /// The AL status code; [`AlStatus::NONE`] if the slave gave none.
    pub const fn code(self) -> AlStatus {
        match self {
            Self::Refused { code, .. } => code,
            // The master has found this fault. It gets the AL status code with which slaves report an invalid watchdog
            // themselves.
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
