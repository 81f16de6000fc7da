//! The option `--machine`: the machine file of a verb. `differing.rs` compares it with that of a server.

mod differing;

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, Once};

use ecmsk::cia402::error_name;
use ecmsk::link::config::find;
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{LinkError, tcp};
use ecmsk::machine_file::{FILE_NAME, MachineAxis, MachineFile, MachineFileError, Unit};
use ecmsk::recording::{Address, CarriedFile, RecordError};
use ecmsk::sk::SlotSize;

use super::link_option::{belongs_to_user, environment, is_of_another_user, is_variable_set};
use super::lock::lock;
use super::recording::{self, Frames};
use super::stderr::say;
pub use differing::{AxisDifference, note_differences};

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

/// Whether [`load`] ignores the machine file in the working directory, because it belongs to another user.
pub fn passes_over(given: Option<&Path>) -> bool {
    given.is_none() && is_of_another_user(Path::new(FILE_NAME))
}

/// The machine file for a recording: that of the option, otherwise the one that the recording carries, otherwise the
/// one in the working directory. A note on a carried file is printed once. A carried file that this version cannot read
/// is ignored, with a note.
///
/// # Errors
/// The errors of [`load`].
pub fn of_recording(
    given: Option<&Path>,
    carried: Option<&CarriedFile>,
) -> Result<Option<MachineFile>, MachineFileError> {
    static SAID: Once = Once::new();
    if let (None, Some(carried)) = (given, carried) {
        match MachineFile::parse(carried.name(), carried.text()) {
            Ok(machine) => {
                SAID.call_once(|| say("note", &format_args!("machine file {} of the recording", carried.name())));
                return Ok(Some(of_elsewhere(machine)));
            }
            Err(error) => say("note", &format_args!("the machine file of the recording is passed over: {error}")),
        }
    }
    load(given)
}

/// Standard input, if it was opened, and the machine file that the recording carries.
pub type Carrying = (Option<Frames<Box<dyn Read + Send>>>, Option<Arc<CarriedFile>>);

/// The machine file that a recording carries, for a verb that reports what is wrong in its own arguments before it opens the
/// recording. Standard input can be read only once, so it is opened, and returned, too.
///
/// # Errors
/// [`RecordError`] if standard input cannot be read or is not a recording.
pub fn carried_by(file: &Path, size: Option<SlotSize>, device: Option<Address>) -> Result<Carrying, RecordError> {
    if file != Path::new(recording::STDIN) {
        return Ok((None, recording::carried(file)));
    }
    let frames = Frames::open_board(file, size, device)?;
    let carried = frames.carried();
    Ok((Some(frames), carried))
}

/// The text of a machine file, as a server passes it on; `None` if it cannot be read any more.
pub fn carried(machine: &MachineFile) -> Option<CarriedFile> {
    let (_, text) = MachineFile::load_with_text(&machine.path).ok()?;
    Some(CarriedFile::new(&machine.path, &text))
}

/// Like [`load`], for a verb that stops axes or switches them off. It must not fail because of a file that nobody has
/// named: a file in the working directory that cannot be used is ignored, with a warning. \[OURS]
///
/// # Errors
/// The errors of [`load`] for a file that the option names.
pub fn load_or_pass_over(given: Option<&Path>) -> Result<Option<MachineFile>, MachineFileError> {
    static SAID: Once = Once::new();
    match load(given) {
        Err(error) if given.is_none() => {
            SAID.call_once(|| say("warning", &format_args!("the machine file is passed over: {error}")));
            Ok(None)
        }
        loaded => loaded,
    }
}

/// The link in the machine file of the working directory, if that file cannot be used but its link can be read. So a
/// wrong field elsewhere in the file does not lead to another board. `None`: the file does not exist, is valid, belongs
/// to another user or has no link, or `ECMSK_LINK` takes precedence.
///
/// # Errors
/// The text of the file cannot be parsed, or its link is invalid, so that the link is not known.
pub fn link_passed_over() -> Result<Option<LinkUri>, MachineFileError> {
    #[derive(serde::Deserialize)]
    struct OnlyLink {
        link: Option<String>,
    }
    let path = Path::new(FILE_NAME);
    if is_variable_set() || path.symlink_metadata().is_err() || is_of_another_user(path) {
        return Ok(None);
    }
    match MachineFile::load(path) {
        Ok(_) => Ok(None),
        Err(error @ (MachineFileError::Unreadable { .. } | MachineFileError::Syntax { .. })) => Err(error),
        Err(error) => {
            let text = std::fs::read_to_string(path).unwrap_or_default();
            match toml::from_str(&text) {
                Ok(OnlyLink { link: None }) => Ok(None),
                Ok(OnlyLink { link: Some(link) }) => LinkUri::parse(&link).map(Some).map_err(|_| error),
                Err(_) => Err(error),
            }
        }
    }
}

/// The machine file for a board: that of the option or of the working directory, as [`load`] has it, otherwise that of the
/// server of the link.
///
/// # Errors
/// The errors of [`load`].
pub fn of_link(given: Option<&Path>, link: Option<&LinkUri>) -> Result<Option<MachineFile>, MachineFileError> {
    Ok(or_of_server(load(given)?, given, link))
}

/// The machine file `loaded`, otherwise that of the server of the link, unless the option is given (such as `none`). A
/// server that cannot be reached is no error here: opening the link reports it. A file that cannot be used is ignored,
/// with a note.
pub fn or_of_server(loaded: Option<MachineFile>, given: Option<&Path>, link: Option<&LinkUri>) -> Option<MachineFile> {
    if loaded.is_some() || given.is_some() {
        return loaded;
    }
    of_server(link).unwrap_or_else(|error| {
        if let ServedFileError::File(error) = error {
            say("note", &format_args!("the machine file of the server is passed over: {error}"));
        }
        None
    })
}

/// Why the machine file of a server is not known.
#[derive(Debug)]
pub enum ServedFileError {
    /// The server cannot be reached, or does not give the file.
    Link(LinkError),
    /// The file cannot be used.
    File(MachineFileError),
}

/// The machine file of the server of a link `tcp:`, about which a note is printed once. `None`: the link is another one, or
/// the server has no such file.
///
/// # Errors
/// [`ServedFileError`]: whether the server has a file, and which limits are in it, is not known.
pub fn of_server(link: Option<&LinkUri>) -> Result<Option<MachineFile>, ServedFileError> {
    static SAID: Once = Once::new();
    let configured = || LinkUri::parse(&find(&environment()).ok()?.link).ok();
    let link = link.cloned().or_else(configured);
    let Some(uri) = link.filter(|uri| uri.scheme() == Scheme::Tcp) else { return Ok(None) };
    let machine = served(&uri)?;
    if let Some(machine) = &machine {
        SAID.call_once(|| say("note", &format_args!("machine file {}", machine.path.display())));
    }
    Ok(machine)
}

/// The machine file of the server of a link `tcp:`, which is asked once; `None` if it has none.
fn served(uri: &LinkUri) -> Result<Option<MachineFile>, ServedFileError> {
    static ASKED: Mutex<Option<(LinkUri, Option<MachineFile>)>> = Mutex::new(None);
    let mut asked = lock(&ASKED);
    if let Some((_, machine)) = asked.as_ref().filter(|(of, _)| of == uri) {
        return Ok(machine.clone());
    }
    let file = tcp::machine(uri).map_err(ServedFileError::Link)?;
    let machine = file.map(|file| {
        // The name says "of the server", because no file on this machine is meant.
        let name = format!("{} of the server", file.name());
        MachineFile::parse(&name, file.text()).map(of_elsewhere).map_err(ServedFileError::File)
    });
    let machine = machine.transpose()?;
    *asked = Some((uri.clone(), machine.clone()));
    Ok(machine)
}

/// Removes the link from a machine file of a server or of a recording. On this machine the link would lead to another
/// board, and open files that somebody else has chosen. \[OURS]
fn of_elsewhere(mut machine: MachineFile) -> MachineFile {
    machine.link = None;
    machine
}

/// Whether a machine file was read from this machine's disk, by the option or from the working directory, and not from a
/// server.
pub fn is_on_disk(given: Option<&Path>, machine: &MachineFile) -> bool {
    machine.path == given.unwrap_or(Path::new(FILE_NAME))
}

/// The machine file that this command line uses, and the names of its axes, for an error of its words; `None` if there is none,
/// it has no axis or cannot be used. Nothing is printed.
pub fn names_of_axes() -> Option<(String, String)> {
    let words: Vec<_> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let option = |(word, next): (&String, Option<&String>)| match word.strip_prefix("--machine") {
        Some("") => next.cloned(),
        Some(rest) => rest.strip_prefix('=').map(str::to_owned),
        None => None,
    };
    let given = words.iter().enumerate().find_map(|(place, word)| option((word, words.get(place + 1))));
    if passes_over(given.as_deref().map(Path::new)) {
        return None;
    }
    // The option `none` names no file, unless there is one of that name, which is not used.
    let file = given.unwrap_or_else(|| FILE_NAME.to_owned());
    let machine = MachineFile::load(Path::new(&file)).ok().filter(|_| file != NONE)?;
    let names = machine.axes.iter().map(|axis| &*axis.name).collect::<Vec<_>>().join(", ");
    (!names.is_empty()).then_some((file, names))
}

/// Parses a number with a unit directly after it or after spaces: `0.5mm`, `500 counts`.
pub fn number_and_unit(text: &str) -> Option<(f64, Unit)> {
    let with = |unit: Unit| Some((text.strip_suffix(unit.word())?.trim_end().parse().ok()?, unit));
    Unit::ALL.into_iter().find_map(with)
}

/// Formats a position or speed in the unit of an axis. The number has as many decimals as a single count needs to
/// change it, at most six: `12.500 mm`.
pub fn in_unit(axis: &MachineAxis, counts: f64) -> String {
    /// The most decimals of a printed number; with more it would only be harder to read.
    const DECIMALS_MAX: f64 = 6.0;
    let per_unit = axis.scale.counts_per_unit;
    let decimals = per_unit.abs().log10().ceil().clamp(0.0, DECIMALS_MAX) as usize;
    format!("{:.decimals$} {}", counts / per_unit, axis.unit)
}

/// The meaning of an error code (0x603F) of a slave: the text in the machine file, otherwise that of CiA 402.
pub fn alarm_words(machine: Option<&MachineFile>, slave: u8, code: u16) -> &str {
    machine.and_then(|machine| machine.alarm_text(slave, code)).unwrap_or_else(|| error_name(code))
}

/// The name of an axis, as messages have it: `X`, or the number of its slave.
pub fn label(machine: Option<&MachineFile>, slave: u8) -> String {
    machine.and_then(|machine| machine.axis_of(slave)).map_or_else(|| slave.to_string(), |axis| axis.name.clone())
}
