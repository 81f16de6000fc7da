//! `params restore`: writes the parameters of a file to a drive, and prints the outcome of each.

use std::path::Path;
use std::process::ExitCode;

use ecmsk::coe::ObjectAddress;

use super::ParamsError;
use super::differ::compare_with;
use super::file::ParameterFile;
use super::place::{Opened, Place};
use super::restore::{Compared, Fate, Restore, Stage};
use super::show::{show, shown, summarise};
use crate::board::{AxisWord, Reporter};

const VERB: &str = "params restore";

/// The options of the command line for a restore.
#[derive(Clone, Copy)]
pub struct Options {
    pub yes: bool,
    pub force: bool,
    pub store: bool,
}

/// Writes the parameters of a file to a drive, as far as they differ. The exit code is 1 if the drive has refused a
/// parameter, or reads it back with another value.
///
/// # Errors
/// [`ParamsError`] if the file cannot be read, the link does not open, the drive is of another product or no longer
/// answers, or `--yes` is not given.
pub fn restore(path: &Path, word: &AxisWord, place: &Place, options: Options) -> Result<ExitCode, ParamsError> {
    let file = ParameterFile::read(path)?;
    let (mut opened, slave) = place.open_for(word)?;
    put_back(&mut opened, slave, &file, options)
}

/// Writes the parameters of a file to a drive on an open link, see [`restore`].
///
/// # Errors
/// As [`restore`].
pub fn put_back(
    opened: &mut Opened,
    slave: u8,
    file: &ParameterFile,
    options: Options,
) -> Result<ExitCode, ParamsError> {
    if let Some((slave, state)) = opened.runs {
        return Err(ParamsError::ChipRuns { slave, state });
    }
    let compared = compare_with(opened, slave, file, options.force);
    if !options.yes {
        let compared = compared?;
        for difference in &compared.different {
            show(&opened.reporter, VERB, slave, difference, "differs", "")?;
        }
        summarise(opened, VERB, slave, &compared)?;
        let is_done = compared.different.is_empty() && !options.store;
        return if is_done { Ok(ExitCode::SUCCESS) } else { Err(ParamsError::NotConfirmed) };
    }
    let compared = compared.map_err(|error| match error {
        error @ ParamsError::OtherProduct { .. } => error,
        error => ParamsError::Untouched(Box::new(error)),
    })?;
    let failed = write(opened, slave, file, &compared)?;
    summarise(opened, VERB, slave, &compared)?;
    let count = compared.different.len();
    if count > 0 {
        opened.reporter.note(format_args!("written and read back: {} of {count}", count - failed));
    }
    match failed {
        0 if options.store => store(opened, slave)?,
        1.. if options.store => {
            opened
                .reporter
                .note(format_args!("slave {slave} was not asked to store: not all parameters are those of the file"));
        }
        _ => {}
    }
    Ok(ExitCode::from(u8::from(failed > 0)))
}

/// Writes the parameters that differ, and prints the outcome of each. Returns the number of parameters that the drive
/// has refused or reads back with another value.
///
/// # Errors
/// [`ParamsError::Halfway`] if the drive no longer answers.
fn write(opened: &mut Opened, slave: u8, file: &ParameterFile, compared: &Compared) -> Result<usize, ParamsError> {
    let (mut failed, mut restore) = (0, Restore::default());
    let reporter = Reporter::new(opened.json, false);
    let drive = opened.drive(slave)?;
    let result = restore.run(drive, file.objects.objects(), &compared.different, &mut |difference, fate| {
        failed += usize::from(fate != Fate::Written);
        let (word, what) = match &fate {
            Fate::Written => ("written", String::new()),
            Fate::Refused(code) => ("refused", format!(": refused, {code}")),
            Fate::ReadsBack(bytes) => {
                let value = shown(&difference.wanted, bytes);
                ("reads_back", format!(": written, and reads back as {value}"))
            }
        };
        Ok(show(&reporter, VERB, slave, difference, word, &what)?)
    });
    let Err(error) = result else { return Ok(failed) };
    let (mut sent, mut left) = (0, 0);
    for difference in &compared.different {
        let (count, word, what) = match restore.stage(difference.wanted.address) {
            Stage::Decided => continue,
            Stage::Sent => (&mut sent, "unknown", ": may be written, was not read back"),
            Stage::NotWritten => (&mut left, "not_written", ": not written"),
        };
        *count += 1;
        // A failure is ignored. If standard output was the reason for ending early, `error` already says so.
        let _ = show(&reporter, VERB, slave, difference, word, what);
    }
    let written = compared.different.len() - sent - left - failed;
    Err(ParamsError::Halfway { written, failed, sent, left, error: Box::new(error) })
}

/// The object 0x1010:1 stores all parameters in the drive's non-volatile memory when [`SAVE`] is written to it (ETG.1020 table
/// 55, CiA 301 7.5.2.13).
const STORE: ObjectAddress = ObjectAddress::new(0x1010, 1);
const SAVE: &[u8; 4] = b"save";

fn store(opened: &mut Opened, slave: u8) -> Result<(), ParamsError> {
    opened.drive(slave)?.write(STORE, SAVE)?.map_err(|code| ParamsError::NotStored { slave, code })?;
    opened.reporter.note(format_args!("slave {slave} has stored its parameters"));
    Ok(())
}
