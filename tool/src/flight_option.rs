//! The options `--flight` and `--flight-bytes`: they add the keys `flight=` and `flight_bytes=` to a link.

use std::io;
use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::link::keys::{Key, Scheme};
use ecmsk::link::record::flight;
use ecmsk::link::uri::{LinkUri, UriError};

use super::link_option::with_key;

/// The options of verbs whose board may have a flight recorder.
#[derive(clap::Args)]
pub struct FlightArgs {
    /// Keep the frames of the last hours in this folder, and what surrounds an alarm, a lost slave or a mark for longer, see
    /// `ecmsk flight`; the folder above has to be there
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    flight: Option<PathBuf>,

    /// The most bytes of the last hours, e.g. 500M or 4G; the oldest are deleted [default: 1G]
    #[arg(long, value_name = "N", requires = "flight", value_parser = byte_count)]
    flight_bytes: Option<String>,
}

/// Why a board gets no flight recorder.
#[derive(Debug, thiserror::Error)]
pub enum FlightOptionError {
    /// The folder cannot be used.
    #[error("cannot record to the folder {}: {source}; name another folder with --flight", .folder.display())]
    Folder {
        /// The path of the folder.
        folder: PathBuf,
        /// Why the folder cannot be used.
        source: io::Error,
    },
    /// Several boards cannot record to one folder.
    #[error("a folder takes the frames of one board; give each --link its own, with flight=DIR in it")]
    SeveralBoards,
    /// The link with `flight=` is invalid.
    #[error(transparent)]
    Uri(#[from] UriError),
}

impl FlightOptionError {
    /// Whether the command line is wrong.
    pub const fn is_wrong_command_line(&self) -> bool {
        matches!(self, Self::Uri(_) | Self::SeveralBoards)
    }
}

impl FlightArgs {
    /// Whether the user wants a flight recorder.
    pub const fn is_given(&self) -> bool {
        self.flight.is_some()
    }

    /// The link with the keys of the options. If the resulting link has a flight recorder, by these keys or by its own,
    /// the folder is prepared.
    ///
    /// # Errors
    /// The folder cannot be used, another process is recording to it, or the link has a flight recorder already.
    pub fn added_to(&self, link: &LinkUri) -> Result<LinkUri, FlightOptionError> {
        let mut link = link.clone();
        if let Some(folder) = &self.flight {
            // The path is made absolute, because a program may change its working directory before it opens the board.
            let absolute = std::path::absolute(folder);
            let text = absolute.and_then(|path| {
                path.into_os_string().into_string().map_err(|_| io::Error::other("its name is not UTF-8"))
            });
            let text = text.map_err(|source| FlightOptionError::Folder { folder: folder.clone(), source })?;
            link = with_key(&link, "flight", &text)?;
        }
        if let Some(bytes) = &self.flight_bytes {
            link = with_key(&link, "flight_bytes", bytes)?;
        }
        if let Some(folder) = link.value("flight").map(PathBuf::from) {
            flight::prepare(&folder).map_err(|source| FlightOptionError::Folder { folder, source })?;
        }
        Ok(link)
    }

    /// As [`Self::added_to`], for several boards.
    ///
    /// # Errors
    /// The errors of [`Self::added_to`]; [`FlightOptionError::SeveralBoards`].
    pub fn added_to_all(&self, links: &[LinkUri]) -> Result<Vec<LinkUri>, FlightOptionError> {
        if self.is_given() && links.len() > 1 {
            return Err(FlightOptionError::SeveralBoards);
        }
        links.iter().map(|link| self.added_to(link)).collect()
    }
}

/// Checks a number of bytes as the key `flight_bytes=` has it.
fn byte_count(text: &str) -> Result<String, String> {
    match Key::find(Scheme::Sim, "flight_bytes") {
        Some(key) => key.syntax.normal(text),
        None => Ok(text.to_owned()),
    }
}
