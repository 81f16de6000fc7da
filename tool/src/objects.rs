//! `ecmsk objects`: makes the files of manufacturer-specific objects that simulated drives load, `slaves=drive:objects@FILE`.

mod attributes;
mod drive;
mod encoding;
mod esi;

use std::fmt::Write as _;
use std::io::{self, IsTerminal as _, Write as _};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::Subcommand;
use ecmsk::ecm::EcmError;
use ecmsk::link::manufacturer_objects;
use ecmsk::link::uri::LinkUri;
use ecmsk::slave::{ManufacturerObject, ManufacturerObjects};
use serde_json::json;

use super::CliError;
use super::board::{Reporter, whole};

pub use drive::read_from as read_drive;

/// Make a file of a drive's manufacturer-specific objects, for simulated drives: slaves=drive:objects@FILE
///
/// Many programs write manufacturer-specific objects, such as 0x2000 or 0x2101, to their drives when they start. A
/// simulated drive lacks these objects; with such a file it has them, and stores written values. A line of the file is
/// INDEX:SUB TYPE ACCESS VALUE NAME, with rx, tx or rxtx before the value of an object that may be mapped as process data.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk objects from-esi ACME_SV2.xml --device SV2-750 > sv2.objects
  ecmsk objects from-drive usb: 1 > axis1.objects
  ecmsk exec --link 'sim:?slaves=drive:objects@sv2.objects*2' -- ./program"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Print the objects that an ESI file (.xml, of the drive's maker) lists, with their types and defaults
    FromEsi {
        /// The ESI file
        file: PathBuf,
        /// Device in the file: its type, name or product code, e.g. SV2-750 or 0x1234 [default: the only one]
        #[arg(long, value_name = "DEVICE")]
        device: Option<String>,
    },
    /// Print the readable objects of a real drive, by SDO; nothing is written to the drive
    ///
    /// SDO answers show neither types nor access rights, so a simulated drive with the printed file accepts writes of 1, 2
    /// and 4 bytes to every object. An ESI file has both.
    FromDrive {
        /// Link URI of the board, e.g. usb:; see `ecmsk link help`
        #[arg(value_parser = LinkUri::parse)]
        link: LinkUri,
        /// The slave, from 1
        #[arg(value_parser = clap::value_parser!(u8).range(1..=40))]
        slave: u8,
        /// Indexes to read, e.g. 0x2000..0x2FFF; may be given several times [default: 0x2000..0x5FFF 0x6000..0x67FF]
        #[arg(long, value_name = "FIRST..LAST", value_parser = indexes)]
        range: Vec<RangeInclusive<u16>>,
    },
}

/// The indexes that are read by default: manufacturer-specific objects and those of the CiA 402 profile of one axis.
const DEFAULT_RANGES: [RangeInclusive<u16>; 2] = [0x2000..=0x5FFF, 0x6000..=0x67FF];

/// Why no file of objects was made.
#[derive(Debug, thiserror::Error)]
pub enum ObjectsError {
    /// The ESI file cannot be read.
    #[error(transparent)]
    File(#[from] manufacturer_objects::ManufacturerObjectsError),
    /// The ESI file has no objects, or they cannot be read, for example because the file is not XML.
    #[error("{}: {error}", .file.display())]
    Esi {
        /// The path of the file.
        file: PathBuf,
        /// Why no objects can be read from the file.
        error: esi::EsiError,
    },
    /// The board or the slave does not answer.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
}

fn indexes(text: &str) -> Result<RangeInclusive<u16>, String> {
    let index = |text: &str| whole(text).and_then(|index| u16::try_from(index).ok());
    let range = match text.split_once("..") {
        Some((first, last)) => index(first).zip(index(last.trim_start_matches('='))),
        None => index(text).map(|only| (only, only)),
    };
    let range = range.filter(|(first, last)| first <= last);
    range.map(|(first, last)| first..=last).ok_or_else(|| "allowed: e.g. 0x2000..0x2FFF, the lower one first".into())
}

/// Runs `ecmsk objects`: prints a file of objects on standard output.
///
/// # Errors
/// [`CliError`] if the ESI file cannot be read or has no objects, if the board or the slave does not answer, or if standard
/// output cannot be written to.
pub fn run(args: &Args) -> Result<(), CliError> {
    match &args.verb {
        Verb::FromEsi { file, device } => from_esi(file, device.as_deref())?,
        Verb::FromDrive { link, slave, range } => from_drive(link, *slave, range)?,
    }
    Ok(())
}

fn from_esi(file: &Path, device: Option<&str>) -> Result<(), ObjectsError> {
    let bytes = manufacturer_objects::read_bytes(file, ESI_BYTES_MAX)?;
    let mut out = io::stdout().lock();
    out.write_all(converted(&bytes, file, device)?.as_bytes())?;
    Ok(out.flush()?)
}

/// Converts the bytes of an ESI file to the text of a file of objects. `file` is the name of the ESI file, for messages.
/// `device` is the type, the name or the product code of the device; `None` if the file has only one.
///
/// # Errors
/// [`ObjectsError::Esi`] if the bytes are not an ESI file, or have no object dictionary for the device.
pub fn converted(bytes: &[u8], file: &Path, device: Option<&str>) -> Result<String, ObjectsError> {
    let wrong = |error| ObjectsError::Esi { file: file.to_path_buf(), error };
    let esi = esi::read(bytes, device).map_err(wrong)?;
    let mut lines = head(&format!("{} of {}", esi.device, file.display()));
    for object in ManufacturerObjects::of(esi.objects).objects() {
        // Writing to a String does not fail.
        let _ = writeln!(lines, "{object}");
    }
    Ok(lines)
}

/// The objects that an ESI file lists for the device with this product code.
///
/// # Errors
/// [`ObjectsError`] if the file cannot be read, is no ESI file, or has no object dictionary for such a device.
pub fn of_esi(file: &Path, product: u32) -> Result<ManufacturerObjects, ObjectsError> {
    let bytes = manufacturer_objects::read_bytes(file, ESI_BYTES_MAX)?;
    let device = format!("0x{product:08X}");
    let esi = esi::read(&bytes, Some(&device)).map_err(|error| ObjectsError::Esi { file: file.to_owned(), error })?;
    Ok(ManufacturerObjects::of(esi.objects))
}

/// The largest ESI file that is read, in bytes \[OURS]. Manufacturers put all their devices into one file.
const ESI_BYTES_MAX: u64 = 64 << 20;

fn from_drive(link: &LinkUri, slave: u8, range: &[RangeInclusive<u16>]) -> Result<(), ObjectsError> {
    let range = if range.is_empty() { &DEFAULT_RANGES } else { range };
    let all: usize = range.iter().map(|range| range.len()).sum();
    let reporter = Reporter::new(false, false);
    // Progress is shown only if standard error is a terminal.
    let is_watched = io::stderr().is_terminal();
    let mut out = io::stdout().lock();
    out.write_all(head(&format!("slave {slave} of {link}")).as_bytes())?;
    let mut read = 0;
    let found = |object: ManufacturerObject| Ok::<_, ObjectsError>(writeln!(out, "{object}")?);
    drive::read(&link.to_string(), slave, range, found, |index| {
        read += 1;
        if is_watched && read % 64 == 1 {
            // The result is ignored: reading goes on even if the terminal was closed.
            let _ = reporter.progress(format_args!("0x{index:04X}, {} of {all} indexes read", read - 1), || json!({}));
        }
    })?;
    reporter.clear();
    Ok(out.flush()?)
}

fn head(what: &str) -> String {
    let what = what.replace(|c: char| c.is_control(), " ");
    format!(
        "# objects of {what}; for slaves=drive:objects@THIS_FILE; a line is INDEX:SUB TYPE ACCESS [rx|tx|rxtx] VALUE NAME\n"
    )
}
