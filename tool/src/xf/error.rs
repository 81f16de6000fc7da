//! The errors of the verbs of `ecmsk xf`.

use std::io;

use ecmsk::link::config::{FILE_NAME, LINK_VARIABLE};
use ecmsk::machine_file::FILE_NAME as MACHINE_FILE;
use ecmsk::xf::host::HostError;
use ecmsk::xf_api::XfError;

use crate::link_option::ChoiceError;

/// Why a verb of `xf` failed. Every error text ends with what the user can do next.
#[derive(Debug, thiserror::Error)]
pub enum XfVerbError {
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// The link from `ECMSK_LINK` or a configuration file is invalid, or that file cannot be used.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The command line names no chip.
    #[error(
        "no chip was named: no --link, {LINK_VARIABLE} is not set, there is no {FILE_NAME} and no link in {MACHINE_FILE}; give \
         one, e.g. --link 'xf-sim:?slaves=drive*2', see `ecmsk link help`"
    )]
    NoLink,
    /// An error of the chip, its link or a slave.
    #[error(transparent)]
    // Boxed, because every error is as large as its largest variant.
    Xf(Box<XfError>),
    /// The command line requests something that is not possible.
    #[error("{what}: {why}; {next}")]
    WrongRequest {
        /// The operation that failed, as the error text names it.
        what: String,
        /// What is wrong with the request, for the error text.
        why: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// The state of the chip does not allow the operation.
    #[error("{what}: {why}; {next}")]
    Refused {
        /// The operation that failed, as the error text names it.
        what: &'static str,
        /// Why the operation is not possible.
        why: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
}

impl From<XfError> for XfVerbError {
    fn from(error: XfError) -> Self {
        Self::Xf(Box::new(error))
    }
}

impl XfVerbError {
    /// The exit code: 2 if the command line is wrong, otherwise 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::NoLink | Self::WrongRequest { .. } => crate::WRONG_COMMAND_LINE,
            _ => 1,
        }
    }
}

/// Returns `None` for a command that the chip refuses, as it does if its firmware does not have the command.
pub fn unless_refused<T>(result: Result<T, XfError>) -> Result<Option<T>, XfError> {
    match result {
        Ok(result) => Ok(Some(result)),
        Err(XfError::Chip(HostError::Refused { .. })) => Ok(None),
        Err(error) => Err(error),
    }
}
