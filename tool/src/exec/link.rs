//! Determines the value of `ECMSK_LINK` for the program, with a recording and a control socket if the user requests
//! them.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use ecmsk::link::config::{self, Environment};
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::MachineFile;

use super::clock::ProgramClock;
use super::{Args, ExecError};
use crate::link_option::{is_variable_set, with_key};
use crate::{control_option, record_option};

/// The link to set for `program`: the link of the user, with the machine file, recording, control socket, clock and
/// flight recorder of the options. `None` leaves the choice of the link to the library.
///
/// The keys `axes=`, `record=`, `control=`, `clock=` and `flight=` must be part of a link. So if the user has given no
/// link, they are added to the link of the machine file, or else to the link that the library would choose.
pub fn for_program(
    args: &Args,
    machine: Option<MachineFile>,
    program: &Path,
    library: &Path,
) -> Result<Option<LinkUri>, ExecError> {
    let Args { record, control, clock, flight, .. } = args;
    let is_changed = machine.is_some() || record.is_some() || control.is_some() || clock.is_some() || flight.is_given();
    // The path must be absolute, because the program may change its working directory before it opens the board.
    let machine = machine.map(|mut machine| {
        machine.path = std::path::absolute(&machine.path).unwrap_or(machine.path);
        machine
    });
    let of_file = machine.as_ref().filter(|_| !is_variable_set()).and_then(|machine| machine.link.clone());
    let link = match (&args.link, of_file) {
        (Some(link), _) => link.clone(),
        (None, _) if !is_changed => return Ok(None),
        (None, Some(link)) => link,
        (None, None) => configured(program, library)?,
    };
    let link = match &machine {
        Some(machine) => {
            let link = machine.link(Some(&link)).unwrap_or(link);
            link.with_axes(&machine.path.display().to_string())
        }
        None => link,
    };
    if !link.scheme().in_build() {
        return Err(ExecError::NotInBuild { link });
    }
    let link = control_option::controlled(link, control.as_deref())?;
    let link = match clock {
        Some(ProgramClock::Virtual) => virtual_time(link)?,
        None => link,
    };
    let link = record.as_deref().map_or(Ok(link.clone()), |file| record_option::with_record(&link, file))?;
    Ok(Some(flight.added_to(&link)?))
}

/// The link with its board on the virtual clock.
fn virtual_time(link: LinkUri) -> Result<LinkUri, ExecError> {
    if !link.scheme().is_model() {
        return Err(ExecError::ClockOfHardware { link });
    }
    if link.value("clock") == Some("virtual") {
        return Ok(link);
    }
    // `clock=real` is the default and is left out of the normal form, so the key can be added.
    Ok(with_key(&link, "clock", "virtual")?)
}

/// The link that the library would choose for the program.
fn configured(program: &Path, library: &Path) -> Result<LinkUri, ExecError> {
    let folder = |file: &Path| file.parent().map(Path::to_path_buf);
    let environment = Environment {
        program_dir: program_file(program).as_deref().and_then(folder),
        ..Environment::from_process(folder(library))
    };
    Ok(LinkUri::parse(&config::find(&environment)?.link)?)
}

/// The file of the program, searched for in the folders of `PATH`.
pub fn program_file(program: &Path) -> Option<PathBuf> {
    let file = if program.components().count() > 1 {
        program.to_owned()
    } else {
        let folders = env::var_os("PATH")?;
        env::split_paths(&folders).find_map(|folder| as_started(folder.join(program)))?
    };
    fs::canonicalize(as_started(file)?).ok()
}

/// The file that Windows starts: for the command `press` it is `press.exe`.
fn as_started(file: PathBuf) -> Option<PathBuf> {
    let mut whole = file.clone().into_os_string();
    whole.push(env::consts::EXE_SUFFIX);
    [file, whole.into()].into_iter().find(|file| file.is_file())
}
