//! Writes the udev rule. If the user may not write it, prints the commands with which root can.

use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use ecmsk::machine::Machine;
use ecmsk::machine::udev::{PLACE, RELOAD, RULE, by_hand};

use crate::{CliError, output};

/// Why the udev rule was not written.
#[derive(Debug, thiserror::Error)]
pub enum RuleError {
    /// This user may not write the file of the udev rule.
    #[error("{PLACE} was not written: {0}; type the lines above")]
    Refused(io::Error),
    /// The file of the rule exists, but with other content.
    #[error("{PLACE} exists with another content and was not changed; check it, sudo rm {PLACE}, then try again")]
    Different,
    /// The file of the udev rule cannot be written, for a reason other than missing rights.
    #[error("{PLACE} was not written: {0}; does this machine have udev, and room on its disk?")]
    Failed(io::Error),
}

/// Writes the udev rule, unless its file already exists with the same content.
///
/// # Errors
/// [`RuleError`] if the file exists with other content or cannot be written; an error of standard output.
pub fn write(machine: &Machine) -> Result<(), CliError> {
    let file = machine.file(PLACE);
    if let Ok(there) = std::fs::read(&file) {
        if there != RULE.as_bytes() {
            return Err(RuleError::Different.into());
        }
        return Ok(output::print(format!("{PLACE} is there already; to use it:\n{}", reload()))?);
    }
    match put(&file) {
        Ok(()) => Ok(output::print(format!("{RULE}\nwritten to {PLACE}; to use it:\n{}", reload()))?),
        Err(error) if matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => {
            output::print(by_hand())?;
            Err(RuleError::Refused(error).into())
        }
        Err(error) => Err(RuleError::Failed(error).into()),
    }
}

/// Writes the udev rule to a new file. If writing fails, the file is removed.
fn put(file: &Path) -> io::Result<()> {
    let mut opened = OpenOptions::new().write(true).create_new(true).open(file)?;
    opened.write_all(RULE.as_bytes()).inspect_err(|_| {
        // An error of removing the file is ignored, because the error of writing is the one to report.
        let _ = std::fs::remove_file(file);
    })
}

fn reload() -> String {
    RELOAD.iter().map(|line| format!("sudo {line}\n")).collect()
}
