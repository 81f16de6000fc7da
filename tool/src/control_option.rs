//! The option `--control`: adds the key `control=` to the link of a simulated board, so that `ecmsk fault` reaches it.

use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::{LinkUri, UriError};

use super::link_option::with_key;

/// The help text of `--control`.
pub const HELP: &str =
    "Let `ecmsk fault NAME` make events happen on the simulated board while it runs, as control= of its link does";

/// Why a board gets no control socket.
#[derive(Debug, thiserror::Error)]
pub enum ControlOptionError {
    /// The board is not simulated in the process that opens the link.
    #[error("--control is for simulated boards, sim: and xf-sim:, and the board is `{link}`; {next}")]
    NotSimulated {
        /// The link of the board.
        link: LinkUri,
        /// What the user can do.
        next: &'static str,
    },
    /// More names than boards are given.
    #[error("--control is given {names} times for {boards} board(s); give it once for each --link")]
    TooMany {
        /// How often the option is given.
        names: usize,
        /// The number of boards.
        boards: usize,
    },
    /// The name is invalid.
    #[cfg(unix)]
    #[error("--control: {0}")]
    Name(#[from] ecmsk::link::control::ControlError),
    /// There are no Unix sockets.
    #[error("--control needs Unix sockets, which this system does not have; use script= in the link")]
    NoSockets,
    /// The link has a control socket already, or is invalid with it.
    #[error(transparent)]
    Uri(#[from] UriError),
}

/// Adds the key `control=` to a link.
///
/// # Errors
/// [`ControlOptionError`]: the board is not simulated, the name is invalid, or the link has a control socket already.
pub fn with_control(link: &LinkUri, name: &str) -> Result<LinkUri, ControlOptionError> {
    if !link.scheme().is_model() {
        let next = match link.scheme() {
            Scheme::Tcp => "give --control to its server, `ecmsk serve tcp`",
            _ => "name a simulated board, e.g. --link 'sim:?slaves=drive*2'",
        };
        return Err(ControlOptionError::NotSimulated { link: link.clone(), next });
    }
    #[cfg(unix)]
    ecmsk::link::control::place(name)?;
    if cfg!(not(unix)) {
        return Err(ControlOptionError::NoSockets);
    }
    Ok(with_key(link, "control", name)?)
}

/// The link, with the key `control=` if the option is given.
///
/// # Errors
/// The errors of [`with_control`].
pub fn controlled(link: LinkUri, name: Option<&str>) -> Result<LinkUri, ControlOptionError> {
    name.map_or(Ok(link.clone()), |name| with_control(&link, name))
}
