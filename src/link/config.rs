//! Which link to open when the program does not say: the C functions and the tool without `--link`.
//!
//! The first of these that names one: the variable `ECMSK_LINK`; then `ecmsk.toml`, looked for beside the program,
//! beside the library, in the user's configuration folder and in the system's. The tool looks in the folder that it is
//! started in first ([`Environment::working_dir`]): there a program and its `ecmsk.toml` stand side by side. Nothing names one: `usb:`, a real board;
//! a program never gets a simulated one unless somebody asked for it.
//!
//! ```toml
//! # ecmsk.toml
//! link = "sim:?slaves=drive*2"
//! ```
//!
//! A program with more rights than the user who starts it is not told by that user: see [`is_privileged`].

mod privilege;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::{env, fmt, fs, io};

pub use privilege::{is_privileged, made_by_others, variable};
use serde::Deserialize;

use super::keys::WHERE_TO_LOOK;
use crate::files::{FileError, read_small};

/// The variable that names a link.
pub const VARIABLE: &str = "ECMSK_LINK";
/// The variable that names a file which the library makes when a program opens a board, whether that succeeds or not:
/// `ecmsk exec` sees by it whether the program came to the library at all. A file that is there stays as it is.
pub const OPENED: &str = "ECMSK_OPENED";
/// The file that names a link.
pub const FILE: &str = "ecmsk.toml";
/// The link when nothing names one.
pub const DEFAULT_LINK: &str = "usb:";

/// The longest file that is read \[OURS].
const LONGEST_BYTES: u64 = 1 << 16;

/// What the file may hold, for an error.
const ALLOWED: &str = "allowed: one line, link = \"sim:?slaves=drive*2\"";

/// What the search looks at: variables and folders of a process. A folder that is not known is passed over.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Environment {
    /// `ECMSK_LINK`.
    pub link: Option<OsString>,
    /// The folder that somebody works in, for the tool: a program is none's who happens to stand there.
    pub working_dir: Option<PathBuf>,
    /// The folder of the program.
    pub program_dir: Option<PathBuf>,
    /// The folder of the library that the program has loaded.
    pub library_dir: Option<PathBuf>,
    /// The user's and the system's folders.
    pub platform: Platform,
    /// Whether a file counts only if nobody but root can have written it: see [`made_by_others`].
    pub privileged: bool,
}

/// Folders for configuration, by the customs of the operating system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Platform {
    /// Linux and its like: `$XDG_CONFIG_HOME/ecmsk/ecmsk.toml`, else `~/.config/ecmsk/ecmsk.toml`; `/etc/ecmsk.toml`.
    Unix {
        /// `XDG_CONFIG_HOME`; a relative path does not count (XDG Base Directory Specification).
        xdg_config_home: Option<PathBuf>,
        /// `HOME`.
        home: Option<PathBuf>,
        /// `/etc`.
        etc: PathBuf,
    },
    /// Windows: `%APPDATA%\ecmsk\ecmsk.toml`, `%ProgramData%\ecmsk\ecmsk.toml`.
    Windows {
        /// `APPDATA`.
        app_data: Option<PathBuf>,
        /// `ProgramData`.
        program_data: Option<PathBuf>,
    },
}

impl Default for Platform {
    /// Linux with no variable set.
    fn default() -> Self {
        Self::Unix { xdg_config_home: None, home: None, etc: PathBuf::from("/etc") }
    }
}

/// The link to open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Configured {
    /// Its URI, as it was written.
    pub link: String,
    /// Who named it.
    pub source: Source,
}

/// Who named the link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The variable `ECMSK_LINK`.
    Variable,
    /// This file.
    File(PathBuf),
    /// Nobody.
    Default,
}

/// For messages: `from /etc/ecmsk.toml`.
impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variable => write!(f, "from {VARIABLE}"),
            Self::File(path) => write!(f, "from {}", path.display()),
            Self::Default => f.write_str("by default"),
        }
    }
}

/// Why it cannot be told which link to open.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// `ECMSK_LINK` is no text.
    #[error(
        "{VARIABLE} is `{found}`, which is not UTF-8; allowed: a link such as sim:?slaves=drive*2; {WHERE_TO_LOOK}"
    )]
    NotUtf8 {
        /// Its value, as far as it can be shown.
        found: String,
    },
    /// The file is there and cannot be read.
    #[error("{}: {message}; make it readable or take it away", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's words.
        message: String,
    },
    /// The program has more rights than the user who started it, and the file may be that user's.
    #[error(
        "{}: not read, since this program runs with more rights than the user who started it and {reason}; \
         have the file and its folder belong to root and be writable by nobody else, or take the file away",
        .path.display()
    )]
    MadeByOthers {
        /// The file.
        path: PathBuf,
        /// Who else can have written it.
        reason: String,
    },
    /// The file holds something else.
    #[error("{}, line {line}: {message}; {ALLOWED}; {WHERE_TO_LOOK}", .path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Where, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
}

impl Environment {
    /// That of this process; `library_dir` is the folder of the library, if the caller is one. In a process with more
    /// rights than the user who started it ([`is_privileged`]) no variable counts, and so no folder of a user.
    pub fn from_process(library_dir: Option<PathBuf>) -> Self {
        let dir = |name: &str| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let platform = if cfg!(windows) {
            Platform::Windows { app_data: dir("APPDATA"), program_data: dir("ProgramData") }
        } else {
            Platform::Unix { xdg_config_home: dir("XDG_CONFIG_HOME"), home: dir("HOME"), etc: PathBuf::from("/etc") }
        };
        let program_dir = env::current_exe().ok().and_then(|program| program.parent().map(Path::to_path_buf));
        Self {
            link: variable(VARIABLE),
            working_dir: None,
            program_dir,
            library_dir,
            platform,
            privileged: is_privileged(),
        }
    }

    /// The files that may name a link, in the order they are looked at.
    pub fn files(&self) -> Vec<PathBuf> {
        let beside =
            [&self.working_dir, &self.program_dir, &self.library_dir].into_iter().flatten().map(|dir| dir.join(FILE));
        let in_folder = |dir: &PathBuf| dir.join("ecmsk").join(FILE);
        let (user, system) = match &self.platform {
            Platform::Unix { xdg_config_home, home, etc } => {
                let xdg = xdg_config_home.clone().filter(|dir| dir.is_absolute());
                let user = xdg.or_else(|| home.as_ref().map(|home| home.join(".config")));
                (user.as_ref().map(in_folder), Some(etc.join(FILE)))
            }
            Platform::Windows { app_data, program_data } => {
                (app_data.as_ref().map(in_folder), program_data.as_ref().map(in_folder))
            }
        };
        beside.chain(user).chain(system).collect()
    }
}

/// Which link to open.
///
/// \[OURS] An `ECMSK_LINK` that is empty counts as not set. A file that is there and wrong is an error, never passed
/// over: the program would get another board than the one somebody has named.
///
/// # Errors
/// [`ConfigError`], which names the file and the line.
pub fn find(environment: &Environment) -> Result<Configured, ConfigError> {
    if let Some(value) = environment.link.as_ref().filter(|value| !value.is_empty()) {
        let link =
            value.to_str().ok_or_else(|| ConfigError::NotUtf8 { found: value.to_string_lossy().into_owned() })?;
        return Ok(Configured { link: link.to_owned(), source: Source::Variable });
    }
    for path in environment.files() {
        if environment.privileged
            && fs::symlink_metadata(&path).is_ok()
            && let Some(reason) = made_by_others(&path)
        {
            return Err(ConfigError::MadeByOthers { path, reason });
        }
        let message = match read_small(&path, LONGEST_BYTES) {
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
    let wrong = |at: usize, message: String| {
        let before = text.as_bytes().get(..at).unwrap_or(text.as_bytes());
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        ConfigError::Content { path: path.to_path_buf(), line, message }
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
