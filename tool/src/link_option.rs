//! Chooses the link of a verb: that of `--link`, otherwise the one that the library would open.

use std::path::{Path, PathBuf};

use ecmsk::link::LinkError;
use ecmsk::link::config::{ConfigError, Environment, LINK_VARIABLE, Source, find};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::{LinkUri, UriError};
use ecmsk::machine_file::{MachineFile, MachineFileError};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};

use super::board::AxisWord;
use super::machine_option;
use super::stderr::say;

/// The link that a verb opens, and whether the user has named it.
pub struct ChosenLink {
    /// The link to the board.
    pub uri: LinkUri,
    /// The configuration files that were searched, as text for the error, if no link was found and `uri` is the
    /// default; `None` if the user has named a link.
    looked: Option<String>,
}

/// Whether opening the link makes a new simulated board in this process.
pub const fn is_simulated(uri: &LinkUri) -> bool {
    matches!(uri.scheme(), Scheme::Sim | Scheme::XfSim)
}

/// Why the link of a verb cannot be chosen.
#[derive(Debug, thiserror::Error)]
pub enum ChoiceError {
    /// `ECMSK_LINK` is not UTF-8, or a configuration file with the link cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The link of `ECMSK_LINK` or of a configuration file is invalid.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The machine file, which may name the link or the axis, cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineFileError),
}

/// No link is named, and the default link does not open.
#[derive(Debug, thiserror::Error)]
#[error(
    "no link was given: no --link, {LINK_VARIABLE} is not set, there is no {looked}; and the default does not open: {error}; to \
     run without a board use `--link 'sim:?slaves=drive*2'`, see `ecmsk link help`"
)]
pub struct Unnamed {
    looked: String,
    // Boxed, because every error of a verb is as large as its largest variant.
    error: Box<LinkError>,
}

impl Unnamed {
    /// Why the default link does not open.
    pub const fn error(&self) -> &LinkError {
        &self.error
    }
}

impl ChosenLink {
    /// Finds the link of a verb that uses only the link of a machine file: that of the option `link`, otherwise that of
    /// the environment, of the machine file in the working directory or of a configuration file.
    ///
    /// # Errors
    /// `ECMSK_LINK`, `ecmsk.toml` or the machine file is invalid.
    pub fn find(link: Option<&LinkUri>) -> Result<Self, ChoiceError> {
        Ok(Self::find_for(link, None, None)?.0)
    }

    /// Like [`find`](Self::find), for a verb about the slave `word`; also returns the machine file. The file is read
    /// only if the option `machine` names it, or if only the file can give the link or the axis. All other command
    /// lines mean the same without the file. \[OURS]
    ///
    /// # Errors
    /// The errors of [`find`](Self::find).
    pub fn find_for(
        link: Option<&LinkUri>,
        machine: Option<&Path>,
        word: Option<&AxisWord>,
    ) -> Result<(Self, Option<MachineFile>), ChoiceError> {
        let is_link_named = link.is_some() || is_variable_set();
        let is_needed = machine.is_some() || !is_link_named || word.is_some_and(AxisWord::is_name);
        let machine = if is_needed { machine_option::of_link(machine, link)? } else { None };
        Ok((Self::find_with(link, machine.as_ref())?, machine))
    }

    /// Like [`find`](Self::find), for a verb with a machine file. The link of the file takes precedence over a
    /// configuration file, and `ECMSK_LINK` over both. A simulated board without a list of slaves gets those of the
    /// file.
    ///
    /// # Errors
    /// `ECMSK_LINK` or `ecmsk.toml` is invalid.
    pub fn find_with(link: Option<&LinkUri>, machine: Option<&MachineFile>) -> Result<Self, ChoiceError> {
        let of_machine = |uri: LinkUri| machine.and_then(|machine| machine.link(Some(&uri))).unwrap_or(uri);
        if let Some(uri) = link {
            return Ok(Self { uri: of_machine(uri.clone()), looked: None });
        }
        let environment = environment();
        if let Some(uri) = machine.filter(|_| !is_variable_set()).and_then(|machine| machine.link(None)) {
            return Ok(Self { uri, looked: None });
        }
        let configured = find(&environment)?;
        if let Source::File(_) = &configured.source {
            say("note", &format_args!("link {}: {}", configured.source, configured.link));
        }
        let uri = LinkUri::parse(&configured.link).map_err(LinkError::from)?;
        let files = || environment.files().iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
        let uri = of_machine(uri);
        Ok(Self { uri, looked: (configured.source == Source::Default).then(files) })
    }

    /// Whether the user has named a link; otherwise [`Self::uri`] is the default.
    pub const fn is_named(&self) -> bool {
        self.looked.is_none()
    }

    /// The error if the default link does not open, which says where a link can be configured. `None` if the user has named a
    /// link: then `error` alone is enough.
    pub fn if_unnamed(&self, error: &LinkError) -> Option<Unnamed> {
        self.looked.clone().map(|looked| Unnamed { looked, error: Box::new(error.clone()) })
    }
}

/// Whether `ECMSK_LINK` names a link.
pub fn is_variable_set() -> bool {
    std::env::var_os(LINK_VARIABLE).is_some_and(|value| !value.is_empty())
}

/// The places where the tool searches for its link: those of the library, and its working directory.
pub fn environment() -> Environment {
    Environment { working_dir: working_dir(), ..Environment::from_process(None) }
}

/// The working directory, but only if its `ecmsk.toml` belongs to this user or to root. Anyone can write that file in a folder
/// such as `/tmp`, and its link may create and read files with the rights of this user. \[OURS]
fn working_dir() -> Option<PathBuf> {
    let folder = std::env::current_dir().ok()?;
    let file = folder.join(ecmsk::link::config::FILE_NAME);
    belongs_to_user(&file, "name the link with --link").then_some(folder)
}

/// Whether a file does not exist, or belongs to this user or to root. Otherwise prints a note that the file is ignored,
/// and `next`: what the user can do instead.
pub fn belongs_to_user(file: &Path, next: &str) -> bool {
    let is_of_another_user = is_of_another_user(file);
    if is_of_another_user {
        say("note", &format_args!("{} is another user's and is passed over; {next}", file.display()));
    }
    !is_of_another_user
}

/// Whether a file exists, and belongs neither to this user nor to root. Under `sudo` that holds for the caller's own
/// files, too: a user who may run one command as root must not thereby choose the files that it creates. \[OURS]
#[cfg(unix)]
pub fn is_of_another_user(file: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let own = rustix::process::geteuid().as_raw();
    std::fs::symlink_metadata(file).is_ok_and(|file| file.uid() != own && file.uid() != 0)
}

#[cfg(not(unix))]
pub const fn is_of_another_user(_file: &Path) -> bool {
    false
}

/// The link for a verb that only reads. On `tcp:` it asks for the role of a reader, so that another program can be the
/// writer.
pub fn as_reader(uri: &LinkUri) -> LinkUri {
    if uri.value("role") != Some("writer") {
        return uri.clone();
    }
    // The normal form does not contain `role=writer`, which is the default.
    with_key(uri, "role", "reader").unwrap_or_else(|_| uri.clone())
}

/// The link with one more key.
///
/// # Errors
/// The link has the key already, its scheme does not have it, or the value is not allowed.
pub fn with_key(uri: &LinkUri, key: &str, value: &str) -> Result<LinkUri, UriError> {
    let text = uri.to_string();
    let sign = if text.contains('?') { '&' } else { '?' };
    LinkUri::parse(&format!("{text}{sign}{key}={}", utf8_percent_encode(value, NON_ALPHANUMERIC)))
}
