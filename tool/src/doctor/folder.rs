//! `ecmsk doctor DIR`: checks the folder of a Windows program, either on Windows or from Linux on a network share.

mod contents;
mod program;

use std::io;
use std::path::{Path, PathBuf};

use ecmsk::link::config::{self, Environment, FILE_NAME, Platform, Source};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::findings::Finding;

use contents::{Contents, LIBRARY, Library};

/// Why a folder cannot be checked.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder cannot be read.
    #[error("{}: {source}; name the folder that the program's .exe is in", .folder.display())]
    Unreadable {
        /// The path as the user gave it.
        folder: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
}

/// Checks the folder; returns a finding for each program and file.
///
/// # Errors
/// [`FolderError`] if the folder cannot be read.
pub fn findings(folder: &Path) -> Result<Vec<Finding>, FolderError> {
    let failed = |source| FolderError::Unreadable { folder: folder.to_owned(), source };
    let there = Contents::of(folder).map_err(failed)?;
    let mut all: Vec<Finding> = there.programs.iter().map(|program| program::finding(program, &there)).collect();
    if there.programs.is_empty() {
        let next = "name the folder that the program's .exe is in";
        all.push(Finding::wrong(program::CHECK, "no program (.exe) in this folder", next));
    }
    all.extend(there.libraries.iter().map(library));
    all.extend(there.assemblies.iter().map(|assembly| {
        let found = match &assembly.image {
            Ok(image) if image.managed.is_some() => contents::whose(image),
            Ok(_) => "no .NET assembly".to_owned(),
            Err(why) => why.clone(),
        };
        Finding::fine("assembly", found).of(&assembly.name)
    }));
    all.push(configuration(folder, ""));
    let with_file = there.libraries.iter().filter_map(|library| library.folder);
    all.extend(
        with_file.filter(|name| folder.join(name).join(FILE_NAME).exists()).map(|name| configuration(folder, name)),
    );
    Ok(all)
}

/// The finding about a single NEXTWUSBLib.dll: whether it can be read, and whether its width fits the folder. Whether a
/// program finds it is checked in `program.rs`.
fn library(library: &Library) -> Finding {
    const CHECK: &str = "library";
    let finding = match &library.image {
        Ok(image) => match library.folder {
            Some(folder) if image.width.folder() != Some(folder) => Finding::wrong(
                CHECK,
                format!("{}, {}: in a folder for the other width", image.width, contents::whose(image)),
                format!("copy {folder}\\{LIBRARY} of this project's package there"),
            ),
            _ => Finding::fine(CHECK, format!("{}, {}", image.width, contents::whose(image))),
        },
        Err(why) => Finding::wrong(CHECK, why.clone(), "copy the one of this project's package anew"),
    };
    finding.of(&library.name)
}

/// The finding about `ecmsk.toml`. `inside` is the sub-folder of `folder` that contains it; empty if it is in `folder` itself.
fn configuration(folder: &Path, inside: &str) -> Finding {
    const CHECK: &str = "config";
    let environment = Environment {
        link: None,
        working_dir: None,
        program_dir: Some(folder.join(inside)),
        library_dir: None,
        platform: Platform::Windows { app_data: None, program_data: None },
        privileged: false,
    };
    let name = if inside.is_empty() { FILE_NAME.to_owned() } else { format!("{inside}\\{FILE_NAME}") };
    let wrong = |error: String| {
        let (found, next) = super::link::split(&error);
        Finding::wrong(CHECK, found, next).of(&name)
    };
    let configured = match config::find(&environment) {
        Ok(configured) => configured,
        Err(error) => return wrong(error.to_string()),
    };
    if configured.source == Source::Default {
        let found = "not there: the program gets the board of ECMSK_LINK, of the user's or the machine's ecmsk.toml, or \
                     usb:";
        return Finding::fine(CHECK, found).of(&name);
    }
    match LinkUri::parse(&configured.link) {
        Ok(link) if matches!(link.scheme(), Scheme::Spi | Scheme::XfSpi | Scheme::XfUsb) => Finding::wrong(
            CHECK,
            format!("{}: Windows has no {}: links", configured.link, link.scheme()),
            "serve the board by `ecmsk serve tcp` on the machine it is wired to, and name it by tcp://HOST:PORT",
        )
        .of(&name),
        Ok(_) => Finding::fine(CHECK, configured.link).of(&name),
        Err(error) => wrong(format!("link = \"{}\": {error}", configured.link)),
    }
}
