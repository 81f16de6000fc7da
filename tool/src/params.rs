//! `ecmsk params`: saves the parameters of drives to files, compares them, and writes them back.
//!
//! Files:
//!
//! - `params.rs`: the verbs, and `params backup`
//! - `params/differ.rs`, `params/put_back.rs`: `params diff` and `params restore`
//! - `params/place.rs`: the network or board that the options name
//! - `params/file.rs`: a file of parameters
//! - `params/choice.rs`: which objects are parameters, and the order of writes that changes the PDO mapping
//! - `params/drive.rs`: a drive on a network, and one behind a board
//! - `params/kept.rs`: what a backup keeps and what it leaves out, by what a link transfers
//! - `params/restore.rs`: compares a file with a drive, and writes the differences
//! - `params/show.rs`: what the verbs print

mod choice;
mod differ;
mod drive;
mod error;
mod file;
mod kept;
mod place;
mod put_back;
mod restore;
mod show;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Subcommand, ValueHint};
use ecmsk::bus::BusError;
use serde_json::{Value as Json, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use crate::board::{AxisWord, SLAVES_MAX};
use crate::output_file::{Kind, OutputFile, Replace};

use file::ParameterFile;
use kept::{Carries, LeftOut};
use place::{Opened, Place};
use put_back::Options;
use show::{parameters, show_left_out};

pub use error::ParamsError;

/// Keep the parameters of drives in files, compare them, and write them back, e.g. to a drive that takes the place of a
/// broken one
///
/// A parameter is an object that can be read and written and that does not command the drive at the moment: no controlword,
/// target, mode or output, nothing that stores or deletes. On a network of its own (nic:, xf-spi:, xf-usb:) the drive itself
/// says which objects it has. A board (usb:, spi:, tcp:) transfers values of 1, 2 or 4 bytes and cannot list the objects of a
/// drive: --objects names the ESI file of the drive's maker, or a list; without it the indexes 0x2000 to 0x67FF are tried, and
/// each object that answers is kept, of a longer value the first 4 bytes. What a link does not transfer is named.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk params backup 1 --link nic:eth1 --output axis1.params
  ecmsk params backup all --link nic:eth1 --output machine/
  ecmsk params backup X --machine machine.toml --output X.params
  ecmsk params diff axis1.params 1 --link nic:eth1
  ecmsk params diff monday.params friday.params
  ecmsk params restore axis1.params 1 --link nic:eth1 --yes
  ecmsk params backup 1 --link usb: --objects ACME_SV2.xml --output axis1.params

Exit codes of diff: 0 nothing differs, 1 something does, 2 it could not be compared."
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Write the parameters of a drive, or of all drives, to a file each; nothing is written to a drive
    Backup {
        /// The slave, from 1 in the order of the cable, or the name of its axis in the machine file, or `all`
        #[arg(value_name = "SLAVE", value_parser = Which::parse)]
        which: Which,
        #[command(flatten)]
        place: Place,
        /// The file, or with `all` the folder, which gets slave1.params, slave2.params .. [default: standard output]
        #[arg(long, short, value_name = "FILE", value_hint = ValueHint::AnyPath, required_if_eq("which", "all"))]
        output: Option<PathBuf>,
        /// Replace output files that exist
        #[arg(long)]
        overwrite: bool,
    },
    /// Show in which parameters a drive or a file differs from a file
    Diff {
        /// A file that `params backup` or `ecmsk objects` made
        #[arg(value_hint = ValueHint::FilePath)]
        file: PathBuf,
        /// The drive to compare with, by its number from 1 or by the name of its axis; or another file
        #[arg(value_name = "SLAVE|FILE", value_parser = Other::parse, value_hint = ValueHint::FilePath)]
        with: Other,
        #[command(flatten)]
        place: Place,
    },
    /// Write the parameters of a file to a drive, only those that differ, and read them back
    ///
    /// A parameter that the drive refuses is tried again after the others, since one limit may depend on another one. The
    /// mapping of process data comes last. Some drives use a new value only after their next power-on; their manual says
    /// for which parameters.
    Restore {
        /// A file that `params backup` or `ecmsk objects` made
        #[arg(value_hint = ValueHint::FilePath)]
        file: PathBuf,
        /// The slave, from 1 in the order of the cable, or the name of its axis in the machine file
        #[arg(value_parser = AxisWord::of_slave)]
        slave: AxisWord,
        #[command(flatten)]
        place: Place,
        /// Write; without this option the differences are only shown
        #[arg(long)]
        yes: bool,
        /// Write although the file is of another product, or does not say of which
        #[arg(long)]
        force: bool,
        /// After writing, let the drive store its parameters in non-volatile memory (0x1010:1, `save`)
        #[arg(long)]
        store: bool,
    },
}

/// The drives to save the parameters of.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Which {
    One(AxisWord),
    All,
}

impl Which {
    fn parse(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        AxisWord::of_slave(text).map(Self::One).map_err(|allowed| format!("{allowed}, or all"))
    }
}

/// What a file is compared with: a drive, or another file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Other {
    Slave(AxisWord),
    /// A file, or an axis by its name.
    File(PathBuf),
}

impl Other {
    fn parse(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(slave) if (1..=SLAVES_MAX).contains(&slave) => Ok(Self::Slave(AxisWord::Number(slave))),
            Ok(_) => Err(format!("allowed: 1 to {SLAVES_MAX}, or a file")),
            Err(_) => Ok(Self::File(text.into())),
        }
    }
}

/// Runs `ecmsk params`. The exit code of `diff` is 1 if there are differences; that of `restore` is 1 if a parameter was
/// refused or reads back with another value.
///
/// # Errors
/// [`ParamsError`] if no link was named, a file cannot be read or written, the link or the drive does not answer, or
/// `restore` was not confirmed with `--yes` or is of another product.
pub fn run(args: &Args) -> Result<ExitCode, ParamsError> {
    match &args.verb {
        Verb::Backup { which, place, output, overwrite } => {
            backup(which, place, output.as_deref(), *overwrite).map(|()| ExitCode::SUCCESS)
        }
        Verb::Diff { file, with, place } => {
            let differ = differ::diff(file, with, place).map_err(|error| ParamsError::NotCompared(Box::new(error)))?;
            Ok(ExitCode::from(u8::from(differ)))
        }
        Verb::Restore { file, slave, place, yes, force, store } => {
            put_back::restore(file, slave, place, Options { yes: *yes, force: *force, store: *store })
        }
    }
}

fn backup(which: &Which, place: &Place, output: Option<&Path>, overwrite: bool) -> Result<(), ParamsError> {
    if let Which::One(word) = which {
        let (mut opened, slave) = place.open_for(word)?;
        return backup_one(&mut opened, slave, output, overwrite);
    }
    let mut opened = place.open()?;
    let folder = output.unwrap_or(Path::new("."));
    let slaves = opened.slaves()?;
    std::fs::create_dir_all(folder).map_err(|source| ParamsError::Folder { folder: folder.to_owned(), source })?;
    let mut kept = 0;
    for slave in &slaves {
        let file = folder.join(format!("slave{slave}.params"));
        match backup_one(&mut opened, *slave, Some(&file), overwrite) {
            Ok(()) => kept += 1,
            Err(ParamsError::Bus(error)) if matches!(*error, BusError::NoCoe { .. }) => opened.reporter.note(error),
            Err(error) => return Err(error),
        }
    }
    if kept < slaves.len() {
        opened.reporter.note(format_args!("the parameters of {kept} of {} slaves were kept", slaves.len()));
    }
    Ok(())
}

/// Writes the parameters of a slave to a file, or to standard output.
fn backup_one(opened: &mut Opened, slave: u8, file: Option<&Path>, overwrite: bool) -> Result<(), ParamsError> {
    const VERB: &str = "params backup";
    let replace = Replace::Asked(overwrite);
    let output = file.map(|file| OutputFile { file, option: "--output", kind: Kind::Any, replace });
    output.map_or(Ok(()), |output| output.check())?;
    let source = format!("slave {slave} of {}", opened.link);
    let (device, kept) = opened.read(slave)?;
    let text = ParameterFile::text(&device, &kept, &source, &now());
    match output {
        None => crate::output::print(text)?,
        Some(output) => {
            output.write(text.as_bytes())?;
            let file = output.file;
            let (count, left_out) = (kept.objects.len(), kept.left_out.len());
            let json = json!({
                "verb": VERB, "slave": slave, "file": file.display().to_string(), "parameters": count,
                "left_out": kept.left_out.iter().map(LeftOut::json).collect::<Vec<Json>>(),
                "vendor": device.vendor, "product": device.product, "revision": device.revision, "serial": device.serial,
            });
            let left = if left_out == 0 { String::new() } else { format!(", {left_out} were not kept") };
            let text = format!("slave {slave}, {device}: {} in {}{left}", parameters(count), file.display());
            opened.reporter.result(text, &json)?;
        }
    }
    show_left_out(&opened.reporter, "not kept", &kept.left_out);
    if opened.objects.is_none() && opened.drive(slave)?.carries() == Carries::Board {
        let note = "the types are not known without --objects: of a value longer than 4 bytes the first 4 were kept";
        opened.reporter.note(note);
    }
    Ok(())
}

/// The present time in UTC as ISO 8601, to the second.
fn now() -> String {
    let now = OffsetDateTime::now_utc();
    now.replace_nanosecond(0).unwrap_or(now).format(&Rfc3339).unwrap_or_default()
}
