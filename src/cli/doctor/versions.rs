//! What this build consists of.

use ecmsk::link::keys::Scheme;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

/// Versions of the tool, its libraries and the kernel.
pub fn finding(machine: &Machine) -> Finding {
    let links: Vec<&str> = Scheme::ALL.into_iter().filter(|scheme| scheme.in_build()).map(Scheme::name).collect();
    let mut parts = vec![format!("ecmsk {} (links {})", env!("CARGO_PKG_VERSION"), links.join(", "))];
    parts.push(match crate::cli::exec::find_library(None) {
        Ok(file) => format!("NEXTWUSBLib {}", file.display()),
        Err(_) => "NEXTWUSBLib not beside this tool".to_owned(),
    });
    parts.extend(machine.kernel().map(|release| format!("Linux {release}")));
    Finding::fine("versions", parts.join("; "))
}
