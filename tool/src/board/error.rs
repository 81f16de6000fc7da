//! Errors of the verbs that talk to a board.

use std::io;

use ecmsk::cia402::ErrorCode;
use ecmsk::ecm::EcmError;
use ecmsk::engine::StateFailure;
use ecmsk::link::LinkError;
use ecmsk::machine_file::MachineFileError;
use ecmsk::sk::{MasterState, StateByte};

use crate::link_option::{ChoiceError, Unnamed};
use crate::streams;

/// Why a verb that talks to a board failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// See [`super::super::record_option::RecordError`].
    #[error(transparent)]
    Record(#[from] crate::record_option::RecordError),
    /// Standard output cannot be written to, see [`crate::CliError::Output`].
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(io::Error),
    /// The operating system refuses a thread, memory or a file.
    #[error("cannot {what}: {source}; free some of the system's memory, threads or files, then run it again")]
    System {
        /// What the call was to do.
        what: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The recording lacks frames, or its end.
    #[error("{lacks}")]
    NotRecorded {
        /// The file, what it lacks, and the next step.
        lacks: String,
    },
    /// Standard input cannot be read.
    #[error("cannot read standard input: {0}; give it lines of text")]
    Input(io::Error),
    /// A line of the shell is invalid.
    #[error("{why}")]
    Typed {
        /// What is wrong with the line, and what may be typed.
        why: String,
    },
    /// See [`MachineFileError`].
    #[error(transparent)]
    Machine(#[from] MachineFileError),
    /// The configuration of the link is invalid.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The command line names no link, and the default link does not open.
    #[error(transparent)]
    Unnamed(#[from] Unnamed),
    /// The link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The operation failed on the board.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// The network is in a lower state than the operation needs.
    #[error("{what} needs {needs}, the network is in {found}; {next}")]
    NotUp {
        /// The operation.
        what: String,
        /// The states that allow the operation.
        needs: &'static str,
        /// The present state.
        found: StateByte,
        /// The next step.
        next: String,
    },
    /// A change of state has failed, and the board in this process knows why.
    #[error("{wanted} was not reached, the board is in {found}: {why}")]
    StateStuck {
        /// The requested state.
        wanted: MasterState,
        /// The state in which the change ended.
        found: StateByte,
        /// Why the change failed.
        why: StateFailure,
    },
    /// An axis that has to be on is off.
    #[error("{what} needs axis {slave} on, it is in {state}; {next}")]
    AxisOff {
        /// The operation.
        what: String,
        /// The number of the slave.
        slave: u8,
        /// The CiA 402 state of the axis.
        state: String,
        /// The next step.
        next: String,
    },
    /// An axis has an alarm.
    #[error("axis {slave} has alarm {}; remove the cause (drive's manual), then {next}", ErrorCode(*.code))]
    Alarm {
        /// The number of the slave.
        slave: u8,
        /// The error code, 0x603F.
        code: u16,
        /// The next step.
        next: String,
    },
    /// The target of a cycle is too far ahead of its axis.
    #[error(
        "axis {slave} does not follow: it is at {actual}, and the target {target} of this cycle is {} counts away, the limit is \
         {limit}; see its load and its limits, move slower, or widen --lead-limit",
        target.wrapping_sub(*actual).unsigned_abs()
    )]
    TooFarAhead {
        /// The number of the slave.
        slave: u8,
        /// The target, counts.
        target: i32,
        /// The actual position, counts.
        actual: i32,
        /// The greatest distance that `--lead-limit` allows, counts.
        limit: u32,
    },
    /// The slaves of the network are not known.
    #[error("{what} needs the list of slaves; give it with --slaves, e.g. --slaves drive*2,io")]
    UnknownNetwork {
        /// The operation.
        what: String,
    },
    /// The network has no slave with that number.
    #[error("{what}: there is no slave {slave}; the network is {network}, correct the number or --slaves")]
    NoSlave {
        /// The operation.
        what: String,
        /// The number of the slave.
        slave: u8,
        /// All slaves of the network.
        network: String,
    },
    /// The slave is of another kind.
    #[error("{what}: slave {slave} is {found}; name {wanted}, or correct --slaves")]
    WrongKind {
        /// The operation.
        what: String,
        /// The number of the slave.
        slave: u8,
        /// The kind and mode of the slave.
        found: String,
        /// The kinds that the operation is for.
        wanted: &'static str,
    },
    /// The reports have another slot size.
    #[error(
        "no report has a right CRC with slots of {slot} bytes ({bad_crc} were wrong); leave out --slot-size, or give {other}"
    )]
    WrongSlot {
        /// The slot size that was given.
        slot: usize,
        /// The number of reports with a wrong CRC.
        bad_crc: u64,
        /// The other slot size.
        other: usize,
    },
    /// The step cannot be carried out.
    #[error("{what}: {why}; {next}")]
    Refused {
        /// The operation.
        what: String,
        /// Why the step cannot be carried out.
        why: String,
        /// The next step.
        next: String,
    },
    /// A line of a script failed.
    #[error("{place}: {why}")]
    Line {
        /// The name of the script, and the line.
        place: String,
        /// What is wrong, with the next step.
        why: String,
    },
    /// A script has errors, of which all but the last one were printed.
    #[error("{last} (nothing was sent)")]
    Script {
        /// File, line, what is wrong, and the next step.
        last: String,
    },
    /// A signal such as Ctrl-C has ended the operation.
    #[error("stopped by {}; {next}", crate::signals::name(*.signal))]
    Stopped {
        /// The number of the signal.
        signal: u8,
        /// What the axes do now, and the next step.
        next: String,
    },
}

impl From<io::Error> for BoardError {
    /// An error of standard output, or the signal that ended the wait for its reader.
    fn from(error: io::Error) -> Self {
        match streams::signal().filter(|_| error.kind() == io::ErrorKind::Interrupted) {
            Some(signal) => Self::Stopped { signal, next: "the board is still open".into() },
            None => Self::Output(error),
        }
    }
}

impl BoardError {
    /// An error of the operating system that has nothing to do with standard output.
    pub const fn system(what: &'static str) -> impl Fn(io::Error) -> Self {
        move |source| Self::System { what, source }
    }

    /// The exit code: 128 + n after signal n, `NOT_WHOLE` for an incomplete
    /// recording, otherwise 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Stopped { signal, .. } => 128 + *signal,
            Self::NotRecorded { .. } => crate::recording_end::NOT_WHOLE,
            _ => 1,
        }
    }
}
