//! Why a verb that talks to a board failed.

use std::io;

use ecmsk::ecm::EcmError;
use ecmsk::engine::StateFailure;
use ecmsk::link::LinkError;
use ecmsk::sk::{MasterState, StateByte};

use crate::link_option::{ChoiceError, Unnamed};

/// Why a verb that talks to a board failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// See [`super::super::record_option::RecordError`].
    #[error(transparent)]
    Record(#[from] crate::record_option::RecordError),
    /// Standard output took no more, see [`crate::CliError::Output`].
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// Standard input gives no more.
    #[error("cannot read standard input: {0}; give it lines of text")]
    Input(io::Error),
    /// A line of the shell is wrong.
    #[error("{why}")]
    Typed {
        /// What is wrong with it and what may be typed.
        why: String,
    },
    /// It cannot be told which link is meant.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// Nobody has named a link.
    #[error(transparent)]
    Unnamed(#[from] Unnamed),
    /// The link does not open.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The board did not do it.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// The network is not where the verb needs it.
    #[error("{what} needs {needs}, the network is in {found}; {next}")]
    NotUp {
        /// What was asked for.
        what: String,
        /// The states that allow it.
        needs: &'static str,
        /// The state.
        found: StateByte,
        /// What to do.
        next: String,
    },
    /// A change of state ended somewhere else, and the board in this process knows why.
    #[error("{wanted} was not reached, the board is in {found}: {why}")]
    StateStuck {
        /// What was asked for.
        wanted: MasterState,
        /// Where it ended.
        found: StateByte,
        /// Why.
        why: StateFailure,
    },
    /// An axis that has to be on is off.
    #[error("{what} needs axis {slave} on, it is in {state}; {next}")]
    AxisOff {
        /// What was asked for.
        what: String,
        /// Slave.
        slave: u8,
        /// State of CiA 402.
        state: String,
        /// What to do.
        next: String,
    },
    /// An axis has an alarm.
    #[error("axis {slave} has alarm 0x{code:04X}; remove the cause (drive's manual), then {next}")]
    Alarm {
        /// Slave.
        slave: u8,
        /// 0x603F.
        code: u16,
        /// What to do.
        next: String,
    },
    /// Nobody said what the network is.
    #[error("{what} needs to know what the network is; say it with --slaves, e.g. --slaves drive*2,io")]
    UnknownNetwork {
        /// What was asked for.
        what: String,
    },
    /// No slave of that number.
    #[error("{what}: there is no slave {slave}; the network is {network}, correct the number or --slaves")]
    NoSlave {
        /// What was asked for.
        what: String,
        /// The number.
        slave: u8,
        /// All slaves.
        network: String,
    },
    /// A slave of another kind.
    #[error("{what}: slave {slave} is {found}; name {wanted}, or correct --slaves")]
    WrongKind {
        /// What was asked for.
        what: String,
        /// Slave.
        slave: u8,
        /// Its kind and mode.
        found: String,
        /// What it is for.
        wanted: &'static str,
    },
    /// Reports of another slot size.
    #[error(
        "no report has a right CRC with slots of {slot} bytes ({bad_crc} were wrong); leave out --slot-size, or give {other}"
    )]
    WrongSlot {
        /// What was given.
        slot: usize,
        /// Reports thrown away.
        bad_crc: u64,
        /// The other size.
        other: usize,
    },
    /// What a step asks for cannot be.
    #[error("{what}: {why}; {next}")]
    Refused {
        /// What was asked for.
        what: String,
        /// Why not.
        why: String,
        /// What to do.
        next: String,
    },
    /// A line of a script failed.
    #[error("{place}: {why}")]
    Line {
        /// File and line.
        place: String,
        /// What is wrong; it ends with the next step.
        why: String,
    },
    /// A script has errors; those before the last one are told.
    #[error("{last} (nothing was sent)")]
    Script {
        /// File, line, what is wrong and what to do.
        last: String,
    },
    /// Ctrl-C or another signal.
    #[error("stopped by {}; {next}", crate::signals::name(*.signal))]
    Stopped {
        /// Its number.
        signal: u8,
        /// What the axes do, and what to do.
        next: String,
    },
}

impl BoardError {
    /// The exit code: 128 + n after signal n, else 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Stopped { signal, .. } => 128 + *signal,
            _ => 1,
        }
    }
}
