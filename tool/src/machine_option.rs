//! The option `--machine`: the machine file of a verb.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, Once};

use ecmsk::cia402::error_name;
use ecmsk::link::config::find;
use ecmsk::link::keys::Scheme;
use ecmsk::link::tcp;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::{FILE_NAME, MachineAxis, MachineFile, MachineFileError, Unit};
use ecmsk::recording::CarriedFile;

use super::link_option::{belongs_to_user, environment, is_of_another_user};
use super::lock::lock;
use super::stderr::say;

/// The help text of `--machine`.
pub const HELP: &str = "Machine file: axes by name, units, limits, slaves, link; none: no such file [default: machine.toml in this \
                        folder, if there is one]";
/// The value of `--machine` that means: use no machine file.
const NONE: &str = "none";

/// The machine file that the option names, otherwise the one in the working directory, about which a note is printed
/// once.
///
/// # Errors
/// The file cannot be read or is invalid. This also holds for a file in the working directory that the user has not
/// named: a move may be meant in its units, and would be wrong in counts.
pub fn load(given: Option<&Path>) -> Result<Option<MachineFile>, MachineFileError> {
    static SAID: Once = Once::new();
    match given {
        Some(path) if path == Path::new(NONE) => Ok(None),
        Some(path) => MachineFile::load(path).map(Some),
        None => {
            let path = PathBuf::from(FILE_NAME);
            if path.symlink_metadata().is_err() || !belongs_to_user(&path, "name it with --machine") {
                return Ok(None);
            }
            let machine = MachineFile::load(&path)?;
            SAID.call_once(|| say("note", &format_args!("machine file {FILE_NAME} in this folder")));
            Ok(Some(machine))
        }
    }
}

/// Whether [`load`] passes over the machine file in the working directory, because it is another user's.
pub fn passes_over(given: Option<&Path>) -> bool {
    given.is_none() && is_of_another_user(Path::new(FILE_NAME))
}

/// The machine file for a recording: that of the option, otherwise the one that the recording carries, about which a note is
/// printed once, otherwise the one in the working directory. A carried file that this version cannot read is passed over, with
/// a note.
///
/// # Errors
/// As [`load`].
pub fn of_recording(
    given: Option<&Path>,
    carried: Option<&CarriedFile>,
) -> Result<Option<MachineFile>, MachineFileError> {
    static SAID: Once = Once::new();
    if let (None, Some(carried)) = (given, carried) {
        match MachineFile::parse(carried.name(), carried.text()) {
            Ok(machine) => {
                SAID.call_once(|| say("note", &format_args!("machine file {} of the recording", carried.name())));
                return Ok(Some(machine));
            }
            Err(error) => say("note", &format_args!("the machine file of the recording is passed over: {error}")),
        }
    }
    load(given)
}

/// The text of a machine file, as a server passes it on; `None` if it cannot be read any more.
pub fn carried(machine: &MachineFile) -> Option<CarriedFile> {
    let (_, text) = MachineFile::load_with_text(&machine.path).ok()?;
    Some(CarriedFile::new(&machine.path, &text))
}

/// The machine file for a board: that of the option or of the working directory, as [`load`] has it, otherwise that of the
/// server of the link.
///
/// # Errors
/// As [`load`].
pub fn of_link(given: Option<&Path>, link: Option<&LinkUri>) -> Result<Option<MachineFile>, MachineFileError> {
    let machine = load(given)?;
    Ok(if machine.is_none() && given.is_none() { of_server(link) } else { machine })
}

/// The machine file of the server of a link `tcp:`, about which a note is printed once. `None`: the link is another one, or
/// the server has no such file. A server that cannot be reached is no error here: opening the link reports it.
fn of_server(link: Option<&LinkUri>) -> Option<MachineFile> {
    static ASKED: Mutex<Option<(LinkUri, Option<MachineFile>)>> = Mutex::new(None);
    let configured = || LinkUri::parse(&find(&environment()).ok()?.link).ok();
    let uri = link.cloned().or_else(configured).filter(|uri| uri.scheme() == Scheme::Tcp)?;
    let mut asked = lock(&ASKED);
    if let Some((_, machine)) = asked.as_ref().filter(|(of, _)| *of == uri) {
        return machine.clone();
    }
    let served = tcp::machine(&uri).ok().flatten();
    let machine = served.and_then(|file| match MachineFile::parse(file.name(), file.text()) {
        Ok(machine) => {
            say("note", &format_args!("machine file {} of the server", file.name()));
            Some(machine)
        }
        Err(error) => {
            say("note", &format_args!("the machine file of the server is passed over: {error}"));
            None
        }
    });
    *asked = Some((uri, machine.clone()));
    machine
}

/// A number with a unit directly behind it or after spaces: `0.5mm`, `500 counts`.
pub fn number_and_unit(text: &str) -> Option<(f64, Unit)> {
    let with = |unit: Unit| Some((text.strip_suffix(unit.word())?.trim_end().parse().ok()?, unit));
    Unit::ALL.into_iter().find_map(with)
}

/// A position or speed in the unit of an axis, with so many decimals that each count changes the number, at most six:
/// `12.500 mm`.
pub fn in_unit(axis: &MachineAxis, counts: f64) -> String {
    /// The most decimals of a printed number; with more it would only be harder to read.
    const DECIMALS_MAX: f64 = 6.0;
    let per_unit = axis.scale.counts_per_unit;
    let decimals = per_unit.abs().log10().ceil().clamp(0.0, DECIMALS_MAX) as usize;
    format!("{:.decimals$} {}", counts / per_unit, axis.unit)
}

/// What an error code (0x603F) of a slave means: as the machine file says it, else as CiA 402 does.
pub fn alarm_words(machine: Option<&MachineFile>, slave: u8, code: u16) -> &str {
    machine.and_then(|machine| machine.alarm_text(slave, code)).unwrap_or_else(|| error_name(code))
}

/// The name of an axis, as messages have it: `X`, or the number of its slave.
pub fn label(machine: Option<&MachineFile>, slave: u8) -> String {
    machine.and_then(|machine| machine.axis_of(slave)).map_or_else(|| slave.to_string(), |axis| axis.name.clone())
}
