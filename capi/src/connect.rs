//! Where a link comes from: the user's configuration, or a URI of the program's.

use std::sync::Arc;

use ecmsk::link::config::{self, Environment};
use ecmsk::link::{self, Link, LinkError, Share};

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
    link::open(&configured.link, Share::ByUri)
        .map_err(|error| CallError::Configured { from: configured.source, error: error.into() }.into())
}

/// The link of that URI. Boards are shared by their `name=` only.
///
/// # Errors
/// [`CallError::Link`].
pub fn named(uri: &str) -> Result<Arc<dyn Link>, Box<CallError>> {
    say_opened();
    Ok(link::open(uri, Share::ByName)?)
}

/// Tells `ecmsk exec`, if that started the program.
fn say_opened() {
    if let Some(file) = std::env::var_os(config::OPENED)
        && let Err(error) = std::fs::File::create(&file)
    {
        // Nobody but the tool asks for it, and its folder may be gone by now.
        log::debug!("{}: {error}", file.display());
    }
}
