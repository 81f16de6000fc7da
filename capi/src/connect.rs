//! Opens the link that the user's configuration names, or one whose URI the program gives.

use std::fs::OpenOptions;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

use ecmsk::link::config::{self, Environment};
use ecmsk::link::{self, Link, LinkError, Share};
use ecmsk::summary::writer;

use crate::error::CallError;
use crate::module;

/// Opens the link that `ECMSK_LINK` or a configuration file names, or else `usb:`. A simulated board that was opened with
/// the same URI before continues as it was left.
///
/// # Errors
/// [`CallError::Link`]: the configuration cannot be read or is invalid. [`CallError::Configured`]: the link that it names
/// cannot be opened.
pub fn configured() -> Result<Arc<dyn Link>, Box<CallError>> {
    report_opened();
    // The folder of this library may have the configuration file with the link. If the variable gives the link, no file is
    // needed, and finding out the folder would only cost time at each open.
    let is_given = config::variable(config::LINK_VARIABLE).is_some_and(|link| !link.is_empty());
    let folder = if is_given { None } else { module::folder() };
    let configured = config::find(&Environment::from_process(folder)).map_err(LinkError::from)?;
    log::info!("link {}: {}", configured.source, configured.link);
    // The summary of `ecmsk exec` says how many reports were dropped, so they have to be counted. Without a summary the
    // link is opened for a faster mode that does not count them.
    let open = if writer::of_process().is_some() { link::open } else { link::open_uncounted };
    open(&configured.link, Share::ByUri)
        .map(watched)
        .map_err(|error| CallError::Configured { from: configured.source, error: error.into() }.into())
}

/// Opens the link with this URI. Two links to simulated boards reach the same board only if they have the same `name=`.
///
/// # Errors
/// [`CallError::Link`]: the URI is invalid, or the link cannot be opened.
pub fn named(uri: &str) -> Result<Arc<dyn Link>, Box<CallError>> {
    report_opened();
    Ok(watched(link::open(uri, Share::ByName)?))
}

/// Wraps the link so that its frames are watched for problems, if `ecmsk exec` has started the program and wants a summary.
fn watched(link: Arc<dyn Link>) -> Arc<dyn Link> {
    match writer::of_process() {
        Some(summary_writer) => summary_writer.watch(link),
        None => link,
    }
}

/// Tells `ecmsk exec`, if that has started the program, that the program opens a board: creates an empty file whose path an
/// environment variable gives.
fn report_opened() {
    if let Some(file) = config::variable(config::OPENED_VARIABLE) {
        create(Path::new(&file));
    }
}

/// Creates an empty file. An existing one is left as it is, and symbolic links are not followed.
fn create(file: &Path) {
    match OpenOptions::new().write(true).create_new(true).open(file) {
        // The program has opened a board before and created the file then.
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        // The program can continue without the file, which only the tool reads. The tool may have ended and removed its
        // folder.
        Err(error) => log::debug!("{}: {error}", file.display()),
        Ok(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// LIB-59 An existing file keeps its content. A symbolic link is not followed: its target is neither changed nor
    /// created.
    #[test]
    fn no_file_is_cut_short() {
        let folder = tempfile::tempdir().expect("a folder");
        let in_folder = |name: &str| folder.path().join(name);
        create(&in_folder("new"));
        assert_eq!(fs::read(in_folder("new")).expect("it was made"), b"");
        fs::write(in_folder("kept"), "kept").expect("a file");
        create(&in_folder("kept"));
        assert_eq!(fs::read(in_folder("kept")).expect("it is there"), b"kept");
        #[cfg(unix)]
        for (to, link) in [("kept", "to_kept"), ("nothing", "to_nothing")] {
            std::os::unix::fs::symlink(in_folder(to), in_folder(link)).expect("a symbolic link");
            create(&in_folder(link));
            assert_eq!(fs::read(in_folder("kept")).expect("it is there"), b"kept");
            assert!(!in_folder("nothing").exists());
        }
        create(&in_folder("no folder").join("file"));
    }
}
