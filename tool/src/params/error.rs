//! The errors of `ecmsk params`.

use std::io;
use std::path::PathBuf;

use ecmsk::bus::BusError;
use ecmsk::coe::AbortCode;
use ecmsk::ecm::EcmError;
use ecmsk::link::config::{FILE_NAME, LINK_VARIABLE};
use ecmsk::link::manufacturer_objects::ManufacturerObjectsError;
use ecmsk::machine_file::FILE_NAME as MACHINE_FILE;

use crate::board::BoardError;
use crate::link_option::ChoiceError;
use crate::output_file::OutputFileError;

/// Why parameters were not saved, compared or written. Every error text ends with what the user can do next.
#[derive(Debug, thiserror::Error)]
pub enum ParamsError {
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// The link from `ECMSK_LINK` or a configuration file is invalid, or that file cannot be used.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// The machine file has no axis with that name, or there is no machine file.
    #[error(transparent)]
    // Boxed, because every error is as large as its largest variant.
    Axis(#[from] Box<BoardError>),
    /// The command line names no link.
    #[error(
        "no network or board was named: no --link, {LINK_VARIABLE} is not set, there is no {FILE_NAME} and no link in \
         {MACHINE_FILE}; give one, e.g. --link nic:eth1 or --link usb:"
    )]
    NoLink,
    /// A parameter file or a file of objects cannot be read.
    #[error(transparent)]
    File(#[from] ManufacturerObjectsError),
    /// The parameter file has an invalid line, or contains no object.
    #[error("cannot take the parameters of {}: {reason}; name a file that `ecmsk params backup` made", file.display())]
    Content {
        /// The path of the file.
        file: PathBuf,
        /// What is wrong with the content of the file.
        reason: String,
    },
    /// The folder for the files cannot be made.
    #[error("cannot write {}: {source}; name another place with --output", folder.display())]
    Folder {
        /// The path of the folder.
        folder: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file cannot be written, or exists and may not be replaced.
    #[error(transparent)]
    NewFile(#[from] OutputFileError),
    /// An error of the network or of a slave.
    #[error(transparent)]
    Bus(Box<BusError>),
    /// An error of the board or of a slave.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// The network of the board is in SafeOP or OP, where drives may be moving.
    #[error(
        "the network of the board is in {state}, where drives may move: parameters are read and written in PreOP; end the program that \
         runs it, or say `ecmsk state preop`"
    )]
    Runs {
        /// The state of the network.
        state: String,
    },
    /// The network of a chip is in SafeOP or OP, so another program runs it and drives may be moving. Parameters are
    /// not written then.
    #[error(
        "nothing was written: slave {slave} is in {state}, where drives may move; end the program that runs the network of this chip, \
         or say `ecmsk xf state preop`"
    )]
    ChipRuns {
        /// The slave, from 1.
        slave: u8,
        /// The name of its EtherCAT state.
        state: &'static str,
    },
    /// A slave has no SDO information service, and the user has given no list of its objects.
    #[error(
        "slave {slave} does not list its objects (no SDO information); name them with --objects: the ESI file of its maker, or a list \
         of `ecmsk objects`"
    )]
    NoList {
        /// The slave, from 1.
        slave: u8,
    },
    /// The ESI file of `--objects` has no objects of this drive, or cannot be read.
    #[error("{0}; or make a list of its objects, `ecmsk objects from-esi`, and name that with --objects")]
    Esi(#[from] crate::objects::ObjectsError),
    /// The parameters in the file are from a drive of another product.
    #[error("nothing was written: {what}; give the file of such a drive, or say --force")]
    OtherProduct {
        /// The product in the file, and the product of the drive.
        what: String,
    },
    /// Parameters differ or would be stored, but the user has not confirmed it with `--yes`.
    #[error("nothing was written or stored; look at what differs, and say --yes")]
    NotConfirmed,
    /// The drive or its link was lost before anything was written to it.
    #[error("{0}; nothing was written")]
    Untouched(Box<ParamsError>),
    /// The drive or its link was lost in the middle of a restore.
    #[error(
        "{error}; the restore has ended early: {written} written and read back, {failed} refused, {sent} may be written, {left} not \
         written; restore once more"
    )]
    Halfway {
        /// The number of parameters that were written and read back.
        written: usize,
        /// The number of parameters that the drive has refused, or reads back with another value.
        failed: usize,
        /// The number of parameters that were sent but not read back, so that they may be written or not.
        sent: usize,
        /// The number of parameters that were not written.
        left: usize,
        /// The error that ended the restore.
        error: Box<ParamsError>,
    },
    /// The drive refuses to store its parameters in non-volatile memory.
    #[error(
        "slave {slave} has the parameters of the file now, and does not store them: object 0x1010:1, aborted with {code}; see its \
         manual on how they outlast its power"
    )]
    NotStored {
        /// The slave, from 1.
        slave: u8,
        /// The abort code.
        code: AbortCode,
    },
    /// An error of `ecmsk params diff` before anything was compared. Its exit code is 2, because exit code 1 means that
    /// there are differences.
    #[error(transparent)]
    NotCompared(Box<ParamsError>),
}

impl From<BusError> for ParamsError {
    fn from(error: BusError) -> Self {
        Self::Bus(Box::new(error))
    }
}

impl ParamsError {
    /// The exit code of `ecmsk params`: 2 if a comparison was not made or the command line is wrong, otherwise 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::NotCompared(_) => crate::compare::TROUBLE,
            Self::NoLink | Self::Axis(_) => crate::WRONG_COMMAND_LINE,
            _ => 1,
        }
    }
}
