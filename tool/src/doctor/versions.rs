//! Shows the versions of the tool, its library and the system.

use ecmsk::link::keys::Scheme;
use ecmsk::machine::findings::Finding;

/// The finding with the versions of the tool, its library and the system.
pub fn finding(system: Option<String>) -> Finding {
    let links: Vec<&str> = Scheme::ALL.into_iter().filter(|scheme| scheme.in_build()).map(Scheme::name).collect();
    let mut parts = vec![format!("ecmsk {} (links {})", env!("CARGO_PKG_VERSION"), links.join(", "))];
    parts.push(match crate::exec::find_library(None, None) {
        Ok(file) => format!("NEXTWUSBLib {}", file.display()),
        Err(_) => "NEXTWUSBLib not beside this tool".to_owned(),
    });
    parts.extend(system);
    Finding::fine("versions", parts.join("; "))
}
