//! The errors of the verbs of `ecmsk bus`.

use std::io;
use std::path::PathBuf;

use ecmsk::bus::BusError;
use ecmsk::bus::eeprom::ContentError;
use ecmsk::link::LinkError;
use ecmsk::link::config::{FILE_NAME, LINK_VARIABLE};
use ecmsk::machine_file::FILE_NAME as MACHINE_FILE;

use crate::board::BoardError;
use crate::link_option::ChoiceError;
use crate::output_file::OutputFileError;

/// Why a verb of `ecmsk bus` failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum BusVerbError {
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// `ECMSK_LINK` or a configuration file with the link is invalid.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The machine file has no axis with that name, or there is no machine file.
    #[error(transparent)]
    // Boxed, because every error is as large as its largest variant.
    Axis(#[from] Box<BoardError>),
    /// The command line names no link to a network, and there is no default link.
    #[error(
        "no network was named: no --link, {LINK_VARIABLE} is not set, there is no {FILE_NAME} and no link in {MACHINE_FILE}; \
         give one, e.g. --link nic:eth1, or to try it --link 'sim:?slaves=drive*2'"
    )]
    NoLink,
    /// The network or a slave reports an error, or does not answer.
    #[error(transparent)]
    Bus(Box<BusError>),
    /// The command line requests something that is not possible.
    #[error("{what}: {why}; {next}")]
    WrongRequest {
        /// The operation that failed, as the error text names it.
        what: &'static str,
        /// What is wrong with the request, for the error text.
        why: String,
        /// What the user can do next; the error text ends with it.
        next: String,
    },
    /// The length of the object is not that of the type in `--type`.
    #[error("slave {slave}: {object} has {found} bytes, not {wanted}; name another type with --type, or leave it out")]
    SizeMismatch {
        /// The slave, from 1.
        slave: u8,
        /// Index and sub-index of the object.
        object: String,
        /// The length of the object, in bytes.
        found: usize,
        /// The length of the type in `--type`, in bytes.
        wanted: usize,
    },
    /// The file that is to be written to a slave or its EEPROM cannot be read.
    #[error("cannot read {}: {source}; name another file", file.display())]
    Read {
        /// The path of the file that cannot be read.
        file: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file of `--output` cannot be written, or exists and may not be replaced.
    #[error(transparent)]
    File(#[from] OutputFileError),
    /// The file that is to be written to an EEPROM is invalid, or is for another device.
    #[error("{}: {error}", file.display())]
    Content {
        /// The path of the file that does not fit.
        file: PathBuf,
        /// What is wrong with the content of the file.
        error: ContentError,
    },
    /// An EEPROM would be changed, but the user has not confirmed this with `--yes`.
    #[error("nothing was written; a wrong EEPROM makes the slave useless: check the changes, then add --yes")]
    NotConfirmed,
}

impl From<BusError> for BusVerbError {
    fn from(error: BusError) -> Self {
        Self::Bus(Box::new(error))
    }
}

impl BusVerbError {
    /// The exit code: 2 if the command line is wrong, otherwise 1.
    pub fn code(&self) -> u8 {
        match self {
            Self::NoLink | Self::Axis(_) | Self::WrongRequest { .. } => crate::WRONG_COMMAND_LINE,
            Self::Bus(error) if matches!(**error, BusError::Link(LinkError::Uri(_))) => crate::WRONG_COMMAND_LINE,
            _ => 1,
        }
    }
}
