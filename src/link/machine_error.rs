//! Errors in the files that describe a simulated machine: scripts of faults, and manufacturer-specific objects.

use crate::address::keys::WHERE_TO_LOOK;

/// Why a file of manufacturer-specific objects cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot take the objects of {file}: {message}; name another file or correct it, {WHERE_TO_LOOK}")]
pub struct ManufacturerObjectsError {
    /// The path of the file.
    pub file: String,
    /// The fault in the file, with the number of the line.
    pub message: String,
}

/// Why a script of faults (key `script=`) is invalid. A script lists what happens to simulated slaves, and when.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ScriptError {
    /// The file cannot be read.
    #[error("cannot read the script {file}: {message}; name another file or leave it out")]
    Unreadable { file: String, message: String },
    /// A line has a syntax error, or names a slave, an axis or an input that this network does not have.
    #[error("{file}, line {line}, column {column}: {message}; {WHERE_TO_LOOK}")]
    Line {
        file: String,
        line: u32,
        /// The position of the fault in the line, in characters from 1.
        column: usize,
        /// What is wrong, and what is allowed there.
        message: String,
    },
    /// A line of the script damages or drops EtherCAT frames. The simulated board has no frames: it calls its simulated
    /// slaves directly.
    #[error(
        "{file}, line {line}: `{verb}` happens to frames, and a simulated board reaches its slaves without any; take the line out, \
         or serve the slaves with `ecmsk serve ethercat`"
    )]
    NoFrames { file: String, line: u32, verb: &'static str },
}

/// Why simulated slaves cannot be set up, or their script cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum SimulatedSlavesError {
    /// The file of manufacturer-specific objects of a slave cannot be used.
    #[error(transparent)]
    Objects(#[from] ManufacturerObjectsError),
    /// The script is invalid.
    #[error(transparent)]
    Script(#[from] ScriptError),
    /// A line of the script acts on a board, but the link opens only a chip.
    #[error("{file}, line {line}: `{verb}` happens to a board, and there is none here; take the line out")]
    NoBoard { file: String, line: u32, verb: &'static str },
}
