//! `ecmsk params`: saves the parameters of drives to files, compares them, and writes them back.
//!
//! Files:
//!
//! - `params.rs`: the verbs
//! - `params/file.rs`: a file of parameters
//! - `params/choice.rs`: which objects are parameters, and the order of writes that changes the PDO mapping
//! - `params/drive.rs`: a drive on a network, and one behind a board
//! - `params/restore.rs`: compares a file with a drive, and writes the differences
//! - `params/show.rs`: what the verbs print

mod choice;
mod drive;
mod error;
mod file;
mod restore;
mod show;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Subcommand, ValueHint};
use ecmsk::bus::{self, BusError};
use ecmsk::ecm::Ecm;
use ecmsk::link::manufacturer_objects;
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::MasterState;
use ecmsk::slave::{ManufacturerObject, ManufacturerObjects};
use serde_json::json;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use crate::board::{Reporter, SLAVES_MAX};
use crate::hex::hex;
use crate::link_option::ChosenLink;

use drive::{BehindBoard, Drive, OnNetwork};
use file::{Device, ParameterFile};
use restore::{Compared, Difference, Fate};
use show::{answer_shown, object_json, put_answer, show, shown, summarise};

pub use error::ParamsError;

/// Keep the parameters of drives in files, compare them, and write them back, e.g. to a drive that takes the place of a
/// broken one
///
/// A parameter is an object that can be read and written and that does not command the drive at the moment: no controlword,
/// target, mode or output, nothing that stores or deletes. On a network of its own (nic:, xf-spi:, xf-usb:) the drive itself
/// says which objects it has. A board (usb:, spi:, tcp:) transfers at most 4 bytes of an object and cannot list the objects of
/// a drive: --objects names a file that lists them, made by `ecmsk objects from-esi` from the ESI file of the drive's maker;
/// without it the indexes 0x2000 to 0x67FF are tried, and each object that answers is kept.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk params backup 1 --link nic:eth1 --output axis1.params
  ecmsk params backup all --link nic:eth1 --output machine/
  ecmsk params diff axis1.params 1 --link nic:eth1
  ecmsk params diff monday.params friday.params
  ecmsk params restore axis1.params 1 --link nic:eth1 --yes
  ecmsk params backup 1 --link usb: --objects sv2.objects --output axis1.params

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
        /// The slave, from 1 in the order of the cable, or `all`
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
        /// The drive to compare with, by its number from 1; or another file
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
        /// The slave, from 1 in the order of the cable
        #[arg(value_parser = clap::value_parser!(u8).range(1..=40))]
        slave: u8,
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

// No doc comment: clap would show it as the help of every verb.
#[derive(Clone, clap::Args)]
#[group(skip)]
struct Place {
    /// Network or board with the drive, see `ecmsk link help` [default: ECMSK_LINK, else the one of ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// The objects of a drive behind a board with their types, see `ecmsk objects from-esi`
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    objects: Option<PathBuf>,

    /// Print JSON: one JSON object per line
    #[arg(long)]
    json: bool,
}

/// The drives to save the parameters of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    One(u8),
    All,
}

impl Which {
    fn parse(text: &str) -> Result<Self, String> {
        let slave = || text.parse().ok().filter(|slave| (1..=SLAVES_MAX).contains(slave)).map(Self::One);
        if text == "all" {
            return Ok(Self::All);
        }
        slave().ok_or_else(|| format!("allowed: 1 to {SLAVES_MAX}, or all"))
    }
}

/// What a file is compared with: a drive, or another file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Other {
    Slave(u8),
    File(PathBuf),
}

impl Other {
    fn parse(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(slave) if (1..=SLAVES_MAX).contains(&slave) => Ok(Self::Slave(slave)),
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
            backup(*which, place, output.as_deref(), *overwrite).map(|()| ExitCode::SUCCESS)
        }
        Verb::Diff { file, with, place } => {
            let differ = diff(file, with, place).map_err(|error| ParamsError::NotCompared(Box::new(error)))?;
            Ok(ExitCode::from(u8::from(differ)))
        }
        Verb::Restore { file, slave, place, yes, force, store } => {
            let options = RestoreOptions { yes: *yes, force: *force, store: *store };
            restore_file(file, *slave, place, options)
        }
    }
}

/// An open link to drives, on a network or behind a board.
struct Opened {
    link: String,
    reporter: Reporter,
    /// The numbers of the slaves that a scan has found. `None` behind a board, whose slaves this command does not list: a
    /// missing slave shows when its object is read.
    slaves: Option<Vec<u8>>,
    drive: Box<dyn Drive>,
}

impl Opened {
    fn drive(&mut self, slave: u8) -> Result<&mut dyn Drive, ParamsError> {
        if let Some(slaves) = &self.slaves
            && !slaves.contains(&slave)
        {
            return Err(BusError::NoSuchSlave { slave, found: slaves.len() }.into());
        }
        self.drive.choose(slave);
        Ok(&mut *self.drive)
    }

    /// Returns a callback that shows the index being read, if standard error is a terminal.
    fn progress(reporter: &Reporter, slave: u8) -> impl FnMut(u16) {
        let mut shown = u16::MAX;
        let is_watched = std::io::IsTerminal::is_terminal(&std::io::stderr());
        move |index| {
            if is_watched && index >> 4 != shown {
                shown = index >> 4;
                // The result is ignored: reading goes on even if the terminal was closed.
                let _ = reporter.progress(format_args!("slave {slave}: 0x{index:04X}"), || json!({}));
            }
        }
    }
}

impl Place {
    fn open(&self) -> Result<Opened, ParamsError> {
        let chosen = ChosenLink::find(self.link.as_ref())?;
        if !chosen.is_named() {
            return Err(ParamsError::NoLink);
        }
        let known = self.objects.as_deref().map(manufacturer_objects::load).transpose()?;
        crate::recording_end::opens(&chosen.uri);
        let link = chosen.uri.to_string();
        match bus::open(&link) {
            Ok(mut network) => {
                if known.is_some() {
                    return Err(ParamsError::ObjectsOnNetwork);
                }
                let slaves = network.scan()?.iter().map(|slave| slave.slave).collect();
                let reporter = Reporter::new(self.json, network.is_virtual());
                let drive = Box::new(OnNetwork { network, slave: 1 });
                Ok(Opened { link, reporter, slaves: Some(slaves), drive })
            }
            Err(BusError::IsBoard { .. }) => {
                let ecm = Ecm::open(&link)?;
                let state = ecm.state()?;
                if state.state().is_some_and(|state| state > MasterState::PreOp) {
                    return Err(ParamsError::Runs { state: state.to_string() });
                }
                let drive = Box::new(BehindBoard { ecm, slave: 1, known });
                Ok(Opened { link, reporter: Reporter::new(self.json, false), slaves: None, drive })
            }
            Err(error) => Err(error.into()),
        }
    }
}

fn backup(which: Which, place: &Place, output: Option<&Path>, overwrite: bool) -> Result<(), ParamsError> {
    let mut opened = place.open()?;
    let slaves = match (which, &opened.slaves) {
        (Which::One(slave), _) => vec![slave],
        (Which::All, Some(slaves)) => slaves.clone(),
        (Which::All, None) => return Err(ParamsError::AllBehindBoard),
    };
    if let (Which::All, Some(folder)) = (which, output) {
        std::fs::create_dir_all(folder).map_err(|source| ParamsError::Write { file: folder.to_owned(), source })?;
    }
    for slave in slaves {
        let file = match (which, output) {
            (Which::All, Some(folder)) => Some(folder.join(format!("slave{slave}.params"))),
            (_, output) => output.map(Path::to_owned),
        };
        backup_one(&mut opened, slave, file.as_deref(), overwrite)?;
    }
    Ok(())
}

fn backup_one(opened: &mut Opened, slave: u8, file: Option<&Path>, overwrite: bool) -> Result<(), ParamsError> {
    if let Some(file) = file.filter(|file| !overwrite && file.exists()) {
        return Err(ParamsError::Exists { file: file.to_owned() });
    }
    let source = format!("slave {slave} of {}", opened.link);
    let (device, objects) = {
        let reporter = Reporter::new(false, false);
        let mut at = Opened::progress(&reporter, slave);
        let drive = opened.drive(slave)?;
        let found = (drive.device()?, drive.parameters(&mut at)?);
        reporter.clear();
        found
    };
    let text = ParameterFile::text(&device, &objects, &source, &now());
    let Some(file) = file else { return Ok(crate::output::print(text)?) };
    std::fs::write(file, text).map_err(|source| ParamsError::Write { file: file.to_owned(), source })?;
    let count = objects.len();
    let json = json!({
        "verb": "params backup", "slave": slave, "file": file.display().to_string(), "parameters": count,
        "vendor": device.vendor, "product": device.product, "revision": device.revision, "serial": device.serial,
    });
    let text = format!("slave {slave}, {device}: {count} parameters in {}", file.display());
    Ok(opened.reporter.result(text, &json)?)
}

/// The present time in UTC as ISO 8601, to the second.
fn now() -> String {
    let now = OffsetDateTime::now_utc();
    now.replace_nanosecond(0).unwrap_or(now).format(&Rfc3339).unwrap_or_default()
}

/// Compares a file with a drive or another file, and prints the differences. Returns whether there are any.
fn diff(path: &Path, with: &Other, place: &Place) -> Result<bool, ParamsError> {
    const VERB: &str = "params diff";
    let file = ParameterFile::read(path)?;
    let slave = match with {
        Other::File(other) => {
            let reporter = Reporter::new(place.json, false);
            return Ok(show_file_diff(&reporter, &file.objects, &ParameterFile::read(other)?.objects)?);
        }
        Other::Slave(slave) => *slave,
    };
    let mut opened = place.open()?;
    let compared = compare_with(&mut opened, slave, &file, true)?;
    for Difference { wanted, present } in &compared.different {
        let (from, to) = (shown(wanted, wanted.value.bytes()), answer_shown(wanted, present));
        let text = format!("{:<10}  {from} | {to}  {}", wanted.address.to_string(), wanted.name);
        let mut json = object_json(VERB, slave, wanted);
        json["file"] = hex(wanted.value.bytes()).into();
        put_answer(&mut json, "drive", present);
        opened.reporter.result(text.trim_end(), &json)?;
    }
    summarise(&opened.reporter, &compared);
    Ok(!compared.different.is_empty())
}

/// Prints the objects in which two files differ. Returns whether there are any.
fn show_file_diff(
    reporter: &Reporter,
    first: &ManufacturerObjects,
    second: &ManufacturerObjects,
) -> std::io::Result<bool> {
    let find = |objects: &ManufacturerObjects, wanted: &ManufacturerObject| {
        objects.objects().iter().find(|object| object.address == wanted.address).cloned()
    };
    let only_second = second.objects().iter().filter(|object| find(first, object).is_none());
    let pairs = first.objects().iter().map(|object| (Some(object.clone()), find(second, object)));
    let mut pairs: Vec<_> = pairs.chain(only_second.map(|object| (None, Some(object.clone())))).collect();
    pairs.sort_by_key(|(first, second)| first.as_ref().or(second.as_ref()).map(|object| object.address));
    let mut differ = false;
    for (first, second) in pairs {
        let value = |object: &Option<ManufacturerObject>| object.as_ref().map(|object| object.value.clone());
        if value(&first) == value(&second) {
            continue;
        }
        differ = true;
        let Some(object) = first.as_ref().or(second.as_ref()) else { continue };
        let side = |of: &Option<ManufacturerObject>| {
            of.as_ref().map_or_else(|| "-".to_owned(), |of| shown(of, of.value.bytes()))
        };
        let text = format!("{:<10}  {} | {}  {}", object.address.to_string(), side(&first), side(&second), object.name);
        let bytes = |of: &Option<ManufacturerObject>| of.as_ref().map(|of| hex(of.value.bytes()));
        let json = json!({
            "verb": "params diff", "index": object.address.index, "sub": object.address.sub, "name": object.name,
            "file": bytes(&first), "other": bytes(&second),
        });
        reporter.result(text.trim_end(), &json)?;
    }
    Ok(differ)
}

/// Compares a drive with a file. `is_allowed`: whether the file may be of another product than the drive; if not, that is an
/// error.
fn compare_with(
    opened: &mut Opened,
    slave: u8,
    file: &ParameterFile,
    is_allowed: bool,
) -> Result<Compared, ParamsError> {
    let progress = Reporter::new(false, false);
    let mut at = Opened::progress(&progress, slave);
    let drive = opened.drive(slave)?;
    let found = drive.device()?;
    let same = file.device.as_ref().is_some_and(|device| device.is_same_product(&found));
    let note = other_device(file.device.as_ref(), &found);
    if !same && !is_allowed {
        return Err(ParamsError::OtherProduct { what: note.unwrap_or_default() });
    }
    let compared = restore::compare(drive, file.objects.objects(), &mut at)?;
    progress.clear();
    if let Some(note) = note {
        opened.reporter.note(note);
    }
    Ok(compared)
}

/// How the device that a file names differs from the drive that was found, as text; `None` if it does not.
fn other_device(of_file: Option<&Device>, found: &Device) -> Option<String> {
    let Some(device) = of_file else {
        return Some(format!("the file does not say of which device it is; the drive is {found}"));
    };
    if !device.is_same_product(found) {
        return Some(format!("the file is of {device}, the drive is {found}"));
    }
    let firmware = [device.firmware(), found.firmware()];
    if device.revision != found.revision {
        return Some(format!(
            "the file is of revision 0x{:08X}, the drive has 0x{:08X}: their parameters may differ",
            device.revision, found.revision
        ));
    }
    let differs = firmware[0] != firmware[1] && firmware.iter().all(|version| !version.is_empty());
    differs.then(|| {
        format!("the file is of firmware {}, the drive has {}: their parameters may differ", firmware[0], firmware[1])
    })
}

#[derive(Clone, Copy)]
struct RestoreOptions {
    yes: bool,
    force: bool,
    store: bool,
}

fn restore_file(path: &Path, slave: u8, place: &Place, options: RestoreOptions) -> Result<ExitCode, ParamsError> {
    const VERB: &str = "params restore";
    let file = ParameterFile::read(path)?;
    let mut opened = place.open()?;
    let compared = compare_with(&mut opened, slave, &file, options.force)?;
    if !options.yes {
        for difference in &compared.different {
            show(&opened.reporter, VERB, slave, difference, "differs", "")?;
        }
        summarise(&opened.reporter, &compared);
        return if compared.different.is_empty() { Ok(ExitCode::SUCCESS) } else { Err(ParamsError::NotConfirmed) };
    }
    let (mut decided, mut failed) = (0, 0);
    let reporter = Reporter::new(place.json, false);
    let result =
        restore::restore(opened.drive(slave)?, file.objects.objects(), &compared.different, &mut |difference, fate| {
            decided += 1;
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
    if let Err(error) = result {
        let left = compared.different.len() - decided;
        return Err(ParamsError::Halfway { decided, left, error: Box::new(error) });
    }
    summarise(&opened.reporter, &compared);
    if decided > 0 {
        opened.reporter.note(format_args!("written and read back: {} of {decided}", decided - failed));
    }
    if options.store {
        store(&mut opened, slave)?;
    }
    Ok(ExitCode::from(u8::from(failed > 0)))
}

/// The object 0x1010:1 stores all parameters in the drive's non-volatile memory when [`SAVE`] is written to it (ETG.1020 table
/// 55, CiA 301 7.5.2.13).
const STORE: ecmsk::coe::ObjectAddress = ecmsk::coe::ObjectAddress::new(0x1010, 1);
const SAVE: &[u8; 4] = b"save";

fn store(opened: &mut Opened, slave: u8) -> Result<(), ParamsError> {
    opened.drive(slave)?.write(STORE, SAVE)?.map_err(|code| ParamsError::NotStored { slave, code })?;
    opened.reporter.note(format_args!("slave {slave} has stored its parameters"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_of_another_product_or_version_is_named() {
        let device = |product, revision, firmware: &str| Device {
            vendor: 1,
            product,
            revision,
            serial: 1,
            texts: [String::new(), String::new(), firmware.to_owned()],
        };
        let said = |file: Option<Device>, found: Device| other_device(file.as_ref(), &found).unwrap_or_default();
        assert_eq!(said(Some(device(2, 3, "1.0")), device(2, 3, "")), "");
        assert!(said(Some(device(2, 3, "1.0")), device(2, 3, "1.1")).contains("firmware 1.0, the drive has 1.1"));
        assert!(
            said(Some(device(2, 3, "")), device(2, 4, "")).contains("revision 0x00000003, the drive has 0x00000004")
        );
        assert!(said(Some(device(2, 3, "")), device(5, 3, "")).contains("product 0x00000002, the drive is vendor"));
        assert!(said(None, device(2, 3, "")).contains("does not say of which device"));
    }
}
