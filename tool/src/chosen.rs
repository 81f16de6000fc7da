//! Which board is meant: `--link`, else the one that the library would find.

use std::path::PathBuf;

use ecmsk::link::LinkError;
use ecmsk::link::config::{ConfigError, Environment, LINK_VARIABLE, Source, find};
use ecmsk::link::uri::LinkUri;

use super::error::say;

/// The board that is meant.
pub struct Chosen {
    /// The link to it.
    pub uri: LinkUri,
    /// Where a name was looked for, if nobody gave one.
    looked: Option<String>,
}

/// Why it cannot be told which board is meant.
#[derive(Debug, thiserror::Error)]
pub enum ChoiceError {
    /// The link's file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// What is named is no link.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// Nobody has named a board, and the default does not open.
#[derive(Debug, thiserror::Error)]
#[error(
    "no link was given: no --link, {LINK_VARIABLE} is not set, there is no {looked}; and the default does not open: {error}; to \
     run without a board use `--link 'sim:?slaves=drive*2'`, see `ecmsk link help`"
)]
pub struct Unnamed {
    looked: String,
    // Boxed: errors of all verbs have its size.
    error: Box<LinkError>,
}

impl Chosen {
    /// `link`: the option.
    ///
    /// # Errors
    /// What is wrong with `ECMSK_LINK` or `ecmsk.toml`.
    pub fn find(link: Option<&LinkUri>) -> Result<Self, ChoiceError> {
        if let Some(uri) = link {
            return Ok(Self { uri: uri.clone(), looked: None });
        }
        let environment = environment();
        let configured = find(&environment)?;
        if let Source::File(_) = &configured.source {
            say("note", &format_args!("link {}: {}", configured.source, configured.link));
        }
        let uri = LinkUri::parse(&configured.link).map_err(LinkError::from)?;
        let files = || environment.files().iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
        Ok(Self { uri, looked: (configured.source == Source::Default).then(files) })
    }

    /// Whether somebody has named it.
    pub const fn is_named(&self) -> bool {
        self.looked.is_none()
    }

    /// Why it did not open; `None`: somebody named it, and `error` says all.
    pub fn unnamed(&self, error: &LinkError) -> Option<Unnamed> {
        self.looked.clone().map(|looked| Unnamed { looked, error: Box::new(error.clone()) })
    }
}

/// Where the tool looks for its link.
pub fn environment() -> Environment {
    Environment { working_dir: working_dir(), ..Environment::from_process(None) }
}

/// The folder that the tool was started in, if its `ecmsk.toml` is this user's or root's: a link may have files made and read,
/// and whoever may write to a folder such as `/tmp` could name one. \[OURS]
fn working_dir() -> Option<PathBuf> {
    let folder = std::env::current_dir().ok()?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let file = folder.join(ecmsk::link::config::FILE_NAME);
        let owner = std::fs::symlink_metadata(&file).map(|file| file.uid());
        let own = rustix::process::geteuid().as_raw();
        if owner.is_ok_and(|owner| owner != own && owner != 0) {
            say(
                "note",
                &format_args!("{} is another user's and is passed over; name the link with --link", file.display()),
            );
            return None;
        }
    }
    Some(folder)
}
