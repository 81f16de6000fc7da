//! Where a link comes from: the user's configuration, or a URI of the program's.

use std::fs::OpenOptions;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

use ecmsk::link::config::{self, Environment};
use ecmsk::link::{self, Link, LinkError, Share};
use ecmsk::summary::teller;

use crate::error::CallError;
use crate::module;

/// The link that `ECMSK_LINK` or a configuration file names, else `usb:`. The C ABI's board of the same URI is found
/// again as it was left.
///
/// # Errors
/// [`CallError::Link`], [`CallError::Configured`].
pub fn configured() -> Result<Arc<dyn Link>, Box<CallError>> {
    say_opened();
    let configured = config::find(&Environment::from_process(module::folder())).map_err(LinkError::from)?;
    log::info!("link {}: {}", configured.source, configured.link);
    // Who is to be told how many reports were lost is told all of them.
    let open = if teller::of_process().is_some() { link::open } else { link::open_uncounted };
    open(&configured.link, Share::ByUri)
        .map(watched)
        .map_err(|error| CallError::Configured { from: configured.source, error: error.into() }.into())
}

/// The link of that URI. Boards are shared by their `name=` only.
///
/// # Errors
/// [`CallError::Link`].
pub fn named(uri: &str) -> Result<Arc<dyn Link>, Box<CallError>> {
    say_opened();
    Ok(watched(link::open(uri, Share::ByName)?))
}

/// With a look at what goes by, for `ecmsk exec` if that started the program.
fn watched(link: Arc<dyn Link>) -> Arc<dyn Link> {
    match teller::of_process() {
        Some(teller) => teller.watch(link),
        None => link,
    }
}

/// Tells `ecmsk exec`, if that started the program.
fn say_opened() {
    if let Some(file) = config::variable(config::OPENED) {
        make(Path::new(&file));
    }
}

/// Makes the file. One that is there stays as it is, and no link is followed.
fn make(file: &Path) {
    match OpenOptions::new().write(true).create_new(true).open(file) {
        // The tool looks whether it is there: the program has opened a board before.
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        // Nobody but the tool asks for it, and its folder may be gone by now.
        Err(error) => log::debug!("{}: {error}", file.display()),
        Ok(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// LIB-59 A file that is there keeps its content, and what a link names is neither changed nor made.
    #[test]
    fn no_file_is_cut_short() {
        let folder = tempfile::tempdir().expect("a folder");
        let in_folder = |name: &str| folder.path().join(name);
        make(&in_folder("new"));
        assert_eq!(fs::read(in_folder("new")).expect("it was made"), b"");
        fs::write(in_folder("kept"), "kept").expect("a file");
        make(&in_folder("kept"));
        assert_eq!(fs::read(in_folder("kept")).expect("it is there"), b"kept");
        #[cfg(unix)]
        for (to, link) in [("kept", "to_kept"), ("nothing", "to_nothing")] {
            std::os::unix::fs::symlink(in_folder(to), in_folder(link)).expect("a symbolic link");
            make(&in_folder(link));
            assert_eq!(fs::read(in_folder("kept")).expect("it is there"), b"kept");
            assert!(!in_folder("nothing").exists());
        }
        make(&in_folder("no folder").join("file"));
    }
}
