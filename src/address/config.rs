//! Which link is opened when a program does not name one, as the C functions and the tool without `--link` do.
//!
//! The first of these places that names a link decides: the environment variable `ECMSK_LINK`; then a file `ecmsk.toml` in
//! the folder of the program, in the folder of the library, in the user's configuration folder, in the system's
//! configuration folder. The tool searches its working directory first ([`Environment::working_dir`]), because a developer
//! keeps the `ecmsk.toml` of a program there. If no place names a link, the link is `usb:`, a real board: a program gets a
//! simulated board only if somebody has asked for one.
//!
//! ```toml
//! # ecmsk.toml
//! link = "sim:?slaves=drive*2"
//! ```
//!
//! If a program has more rights than the user who starts it, that user must not choose its link: see [`is_privileged`].

mod privilege;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::{env, fmt, fs, io};

pub use privilege::{is_privileged, variable, writable_by_others};
use serde::Deserialize;

use super::keys::WHERE_TO_LOOK;
use super::text::line_at;
use crate::files::{FileError, read_small};

/// The environment variable that names the link to open.
pub const LINK_VARIABLE: &str = "ECMSK_LINK";
/// The environment variable that names a marker file. The library creates this file when a program opens a board, whether
/// the opening succeeds or not. From the file, `ecmsk exec` can tell whether the program has called the library at all. An
/// existing file is left unchanged.
pub const OPENED_VARIABLE: &str = "ECMSK_OPENED";
/// The name of the file that names the link to open.
pub const FILE_NAME: &str = "ecmsk.toml";
/// The link that is opened if neither the variable nor a file names one.
pub const DEFAULT_LINK: &str = "usb:";

/// The maximum size of `ecmsk.toml` \[OURS].
const FILE_SIZE_MAX_BYTES: u64 = 1 << 16;

/// What an `ecmsk.toml` may contain, for error messages: one line, the link.
const ALLOWED: &str = "allowed: one line, link = \"sim:?slaves=drive*2\"";

/// The environment variables and folders that the search uses. A folder that is `None` is skipped.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Environment {
    /// The value of `ECMSK_LINK`.
    pub link: Option<OsString>,
    /// The working directory, which only the tool searches. Programs do not search it, because they may be started
    /// anywhere, and an `ecmsk.toml` that happens to be there is not meant for them.
    pub working_dir: Option<PathBuf>,
    /// The folder of the executable.
    pub program_dir: Option<PathBuf>,
    /// The folder of the shared library that the program has loaded.
    pub library_dir: Option<PathBuf>,
    /// The configuration folders of the user and of the system.
    pub platform: Platform,
    /// Whether to accept only files that nobody but root can have written: see [`writable_by_others`].
    pub privileged: bool,
}

/// The configuration folders of the user and of the system, which depend on the operating system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Platform {
    /// Linux and other Unix systems: `$XDG_CONFIG_HOME/ecmsk/ecmsk.toml`, or else `~/.config/ecmsk/ecmsk.toml`; then
    /// `/etc/ecmsk.toml`.
    Unix {
        /// The environment variable `XDG_CONFIG_HOME`; a relative path is ignored (XDG Base Directory Specification).
        xdg_config_home: Option<PathBuf>,
        /// The environment variable `HOME`.
        home: Option<PathBuf>,
        /// The configuration folder of the system, `/etc`.
        etc: PathBuf,
    },
    /// Windows: `%APPDATA%\ecmsk\ecmsk.toml`, `%ProgramData%\ecmsk\ecmsk.toml`.
    Windows {
        /// The environment variable `APPDATA`.
        app_data: Option<PathBuf>,
        /// The environment variable `ProgramData`.
        program_data: Option<PathBuf>,
    },
}

impl Default for Platform {
    /// The configuration folders of a Unix system on which `XDG_CONFIG_HOME` and `HOME` are not set.
    fn default() -> Self {
        Self::Unix { xdg_config_home: None, home: None, etc: PathBuf::from("/etc") }
    }
}

/// The URI of the link to open, and where it was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Configured {
    /// The URI as the variable or the file has it, not in normal form.
    pub link: String,
    /// Where the URI comes from.
    pub source: Source,
}

/// Where the URI of the link was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The environment variable `ECMSK_LINK`.
    Variable,
    /// The file with this path.
    File(PathBuf),
    /// Neither a variable nor a file names a link: [`DEFAULT_LINK`].
    Default,
}

/// Writes the source for a message: `from /etc/ecmsk.toml`.
impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variable => write!(f, "from {LINK_VARIABLE}"),
            Self::File(path) => write!(f, "from {}", path.display()),
            Self::Default => f.write_str("by default"),
        }
    }
}

/// The cases in which the configuration names no usable link: `ECMSK_LINK` or an `ecmsk.toml` is unreadable, invalid or
/// not to be trusted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ConfigError {
    /// `ECMSK_LINK` is not UTF-8.
    #[error(
        "{LINK_VARIABLE} is `{found}`, which is not UTF-8; allowed: a link such as sim:?slaves=drive*2; {WHERE_TO_LOOK}"
    )]
    NotUtf8 {
        /// The value of the variable, with a replacement character for each invalid part.
        found: String,
    },
    /// The file exists but cannot be read.
    #[error("{}: {message}; make it readable or remove it", .path.display())]
    Unreadable { path: PathBuf, message: String },
    /// The program has more rights than the user who started it, and somebody other than root, such as that user, may
    /// have written the file.
    #[error(
        "{}: not read, since this program runs with more rights than the user who started it and {reason}; make root \
         the owner of the file and its folder, writable by nobody else, or remove the file",
        .path.display()
    )]
    WritableByOthers {
        path: PathBuf,
        /// The reason why the file is not trusted: who else can have written it.
        reason: String,
    },
    /// The content of the file is invalid.
    #[error("{}, line {line}: {message}; {ALLOWED}; {WHERE_TO_LOOK}", .path.display())]
    Content {
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        message: String,
    },
}

impl Environment {
    /// The environment of this process. `library_dir` is the folder of the shared library, if a shared library is the
    /// caller. A process with more rights than the user who started it ([`is_privileged`]) ignores environment variables,
    /// and therefore the user's configuration folder too.
    pub fn from_process(library_dir: Option<PathBuf>) -> Self {
        let dir = |name: &str| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let platform = if cfg!(windows) {
            Platform::Windows { app_data: dir("APPDATA"), program_data: dir("ProgramData") }
        } else {
            Platform::Unix { xdg_config_home: dir("XDG_CONFIG_HOME"), home: dir("HOME"), etc: PathBuf::from("/etc") }
        };
        let program_dir = env::current_exe().ok().and_then(|program| program.parent().map(Path::to_path_buf));
        Self {
            link: variable(LINK_VARIABLE),
            working_dir: None,
            program_dir,
            library_dir,
            platform,
            privileged: is_privileged(),
        }
    }

    /// The link of `ECMSK_LINK`; `None` if the variable is not set, or empty.
    ///
    /// # Errors
    /// [`ConfigError::NotUtf8`].
    pub fn link_of_variable(&self) -> Result<Option<&str>, ConfigError> {
        let not_utf8 = |value: &OsString| ConfigError::NotUtf8 { found: value.to_string_lossy().into_owned() };
        let value = self.link.as_ref().filter(|value| !value.is_empty());
        value.map(|value| value.to_str().ok_or_else(|| not_utf8(value))).transpose()
    }

    /// The files that may name a link, in the order of the search.
    pub fn files(&self) -> Vec<PathBuf> {
        let beside = [&self.working_dir, &self.program_dir, &self.library_dir]
            .into_iter()
            .flatten()
            .map(|dir| dir.join(FILE_NAME));
        let in_folder = |dir: &PathBuf| dir.join("ecmsk").join(FILE_NAME);
        let (user, system) = match &self.platform {
            Platform::Unix { xdg_config_home, home, etc } => {
                let xdg = xdg_config_home.clone().filter(|dir| dir.is_absolute());
                let user = xdg.or_else(|| home.as_ref().map(|home| home.join(".config")));
                (user.as_ref().map(in_folder), Some(etc.join(FILE_NAME)))
            }
            Platform::Windows { app_data, program_data } => {
                (app_data.as_ref().map(in_folder), program_data.as_ref().map(in_folder))
            }
        };
        beside.chain(user).chain(system).collect()
    }
}

/// Finds the link to open.
///
/// \[OURS] An empty `ECMSK_LINK` counts as not set. A file that exists but is invalid is an error and is never skipped;
/// otherwise the program would open another board than the one that the file names.
///
/// # Errors
/// [`ConfigError`], which names the file and the line.
pub fn find(environment: &Environment) -> Result<Configured, ConfigError> {
    if let Some(link) = environment.link_of_variable()? {
        return Ok(Configured { link: link.to_owned(), source: Source::Variable });
    }
    for path in environment.files() {
        if environment.privileged
            && fs::symlink_metadata(&path).is_ok()
            && let Some(reason) = writable_by_others(&path)
        {
            return Err(ConfigError::WritableByOthers { path, reason });
        }
        let message = match read_small(&path, FILE_SIZE_MAX_BYTES) {
            Ok(file) => match String::from_utf8(file.bytes) {
                Ok(text) => return Ok(Configured { link: read_link(&path, &text)?, source: Source::File(path) }),
                Err(_) => io::Error::from(ErrorKind::InvalidData).to_string(),
            },
            Err(FileError::Io(error)) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                continue;
            }
            Err(error) => error.to_string(),
        };
        return Err(ConfigError::Unreadable { path, message });
    }
    Ok(Configured { link: DEFAULT_LINK.to_owned(), source: Source::Default })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    link: toml::Spanned<toml::Value>,
}

fn read_link(path: &Path, text: &str) -> Result<String, ConfigError> {
    let wrong = |at: usize, message: String| ConfigError::Content {
        path: path.to_path_buf(),
        line: line_at(text, at),
        message,
    };
    let content: Content = toml::from_str(text).map_err(|error: toml::de::Error| {
        wrong(error.span().map_or(0, |span| span.start), error.message().trim_end().to_owned())
    })?;
    let at = content.link.span().start;
    match content.link.into_inner() {
        toml::Value::String(link) => Ok(link),
        other => Err(wrong(at, format!("`link` is of type {}, not a string in quotes", other.type_str()))),
    }
}
