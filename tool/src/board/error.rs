//! Errors of the verbs that talk to a board.

use std::io;

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
    /// The recording of `--record` cannot be made.
    #[error(transparent)]
    Record(#[from] crate::record_option::RecordError),
    /// Standard output cannot be written to, see [`crate::CliError::Output`].
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(io::Error),
    /// The operating system refuses a thread, memory or a file.
    #[error("cannot {what}: {source}; free some of the system's memory, threads or files, then run it again")]
    System {
        /// The purpose of the failed call, such as `start a thread`.
        what: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The recording of the run lacks frames, or has no end.
    #[error("{lacks}")]
    NotRecorded {
        /// The file, what is missing in it, and the next step.
        lacks: String,
    },
    /// The results of a script cannot be written.
    #[error(transparent)]
    Junit(#[from] crate::output_file::OutputFileError),
    /// Standard input cannot be read.
    #[error("cannot read standard input: {0}; give it lines of text")]
    Input(io::Error),
    /// A line typed in `ecmsk shell` is invalid.
    #[error("{why}")]
    Typed {
        /// What is wrong with the line, and what may be typed.
        why: String,
    },
    /// The machine file cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineFileError),
    /// `ECMSK_LINK` or a configuration file with the link is invalid.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The command line names no link, and the default link does not open.
    #[error(transparent)]
    Unnamed(#[from] Unnamed),
    /// The link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The board was lost while the verb commanded axes, and it is not certain that anything stops them.
    #[error("{0}; axes may go on: use the emergency stop if they do")]
    MayGoOn(LinkError),
    /// A server could not be reached to stop the axes of its board.
    #[error("{0}; use the emergency stop if axes move")]
    NotStopped(LinkError),
    /// A server has not stopped the axes of its board.
    #[error(transparent)]
    Stop(#[from] ecmsk::link::tcp::StopError),
    /// An error of the library, from the board, its link or a slave, that has no variant of its own here.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// The network is in a lower state than the operation needs.
    #[error("{what} needs {needs}, the network is in {found}; {next}")]
    NotUp {
        /// The operation that failed, as the error text names it.
        what: String,
        /// The states that allow the operation.
        needs: &'static str,
        /// The present state of the network.
        found: StateByte,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// A state change has failed, and the link knows the reason, as the link of a simulated board in this process does.
    #[error("{wanted} was not reached, the board is in {found}: {why}")]
    StateStuck {
        /// The requested state of the network.
        wanted: MasterState,
        /// The state in which the change ended.
        found: StateByte,
        /// Why the change failed.
        why: StateFailure,
    },
    /// The operation needs an axis enabled that is not enabled.
    #[error("{what} needs axis {axis} on, it is in {state}; {next}")]
    AxisOff {
        /// The operation that failed, as the error text names it.
        what: String,
        /// The name of the axis in the machine file, or the number of its slave.
        axis: String,
        /// The CiA 402 state of the axis.
        state: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// An axis has an alarm.
    #[error("axis {axis} has alarm {alarm}; remove the cause (drive's manual), then {next}")]
    Alarm {
        /// The name of the axis in the machine file, or the number of its slave.
        axis: String,
        /// The error code, 0x603F, and its meaning, by the machine file or else by CiA 402.
        alarm: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// The axis does not follow: the target of this cycle is too far from its actual position.
    #[error(
        "axis {axis} does not follow: it is at {actual}, and the target {target} of this cycle is {away} away, the limit is \
         {limit}; see its load and its limits, move slower, or widen --lead-limit"
    )]
    TooFarAhead {
        /// The name of the axis in the machine file, or the number of its slave.
        axis: String,
        /// The target of the cycle, in counts or in units and counts.
        target: String,
        /// The actual position of the axis.
        actual: String,
        /// The distance between the target and the actual position.
        away: String,
        /// The greatest distance that `--lead-limit` allows.
        limit: String,
    },
    /// The library reports an error of a slave whose axis has a name in the machine file.
    #[error("axis {axis}: {error}")]
    OfAxis {
        /// The name of the axis.
        axis: String,
        /// The error.
        // Boxed, because every error is as large as its largest variant.
        error: Box<EcmError>,
    },
    /// Neither an option nor the link says which slaves the network has.
    #[error("{what} needs the list of slaves; give it with --slaves, e.g. --slaves drive*2,io")]
    UnknownNetwork {
        /// The operation that failed, as the error text names it.
        what: String,
    },
    /// The network has no slave with that number.
    #[error("{what}: there is no slave {slave}; the network is {network}, correct the number or --slaves")]
    NoSlave {
        /// The operation that failed, as the error text names it.
        what: String,
        /// The number of the slave, from 1 in network order.
        slave: u8,
        /// All slaves of the network, as text.
        network: String,
    },
    /// The slave is not of a kind that the operation is for, such as an IO slave for a move.
    #[error("{what}: slave {slave} is {found}; name {wanted}, or correct --slaves")]
    WrongKind {
        /// The operation that failed, as the error text names it.
        what: String,
        /// The number of the slave, from 1 in network order.
        slave: u8,
        /// The kind and mode of the slave.
        found: String,
        /// The kinds that the operation is for.
        wanted: &'static str,
    },
    /// The board's reports have another slot size than the one that was given by the user or assumed by default.
    #[error(
        "no report has a right CRC with slots of {slot} bytes ({bad_crc} were wrong); leave out --slot-size, or give {other}"
    )]
    WrongSlot {
        /// The slot size that was given or assumed, in bytes.
        slot: usize,
        /// The number of reports with a wrong CRC.
        bad_crc: u64,
        /// The other slot size, in bytes, for the user to try.
        other: usize,
    },
    /// The operation cannot be carried out in the present state or with these arguments.
    #[error("{what}: {why}; {next}")]
    Refused {
        /// The operation that failed, as the error text names it.
        what: String,
        /// Why the operation cannot be carried out.
        why: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// A line of a script is invalid, or its step has failed.
    #[error("{place}: {why}")]
    Line {
        /// The name of the script and the number of the line.
        place: String,
        /// What is wrong, with the next step.
        why: String,
    },
    /// A script has errors. All but the last one were already printed.
    #[error("{last} (nothing was sent)")]
    Script {
        /// The text of the last error: file, line, what is wrong, and the next step.
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
    /// Converts an error of writing to standard output. If a signal has arrived, `Interrupted` becomes
    /// [`Self::Stopped`]: nobody reads standard output, and the signal has ended the wait for a reader.
    fn from(error: io::Error) -> Self {
        match streams::signal().filter(|_| error.kind() == io::ErrorKind::Interrupted) {
            Some(signal) => Self::Stopped { signal, next: "the board is still open".into() },
            None => Self::Output(error),
        }
    }
}

impl BoardError {
    /// Returns a function for `map_err` that makes [`Self::System`] from an error of the operating system. `what` is
    /// the operation that failed. Not for errors of writing to standard output.
    pub const fn system(what: &'static str) -> impl Fn(io::Error) -> Self {
        move |source| Self::System { what, source }
    }

    /// The exit code: 128 + n after signal n, `NOT_WHOLE` for an incomplete recording, otherwise 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Stopped { signal, .. } => 128 + *signal,
            Self::NotRecorded { .. } => crate::recording_end::NOT_WHOLE,
            _ => 1,
        }
    }
}
