//! Advice for users if a server cannot listen on its address.

use std::io::{Error, ErrorKind};
use std::net::SocketAddr;

/// The lowest TCP port on which every user may listen, unless the machine is configured otherwise.
const FIRST_FREE: u16 = 1024;

/// What the user can do about an error of listening on `address`.
pub(super) fn advice(address: SocketAddr, error: &Error) -> &'static str {
    match error.kind() {
        ErrorKind::PermissionDenied if address.port() < FIRST_FREE => {
            "a port below 1024 needs root or CAP_NET_BIND_SERVICE, name one from 1024 on with `--listen`"
        }
        ErrorKind::PermissionDenied => {
            "this machine does not let this user listen there, name another place with `--listen`"
        }
        ErrorKind::AddrNotAvailable => {
            "name an address of this machine with `--listen`: 127.0.0.1, one of its own, or 0.0.0.0"
        }
        _ => "stop what listens there, or name another place with `--listen`",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each error has its own advice; for missing rights it does not speak of another program on the port.
    #[test]
    fn each_reason_has_its_own_step() {
        let advice = |address: &str, kind: ErrorKind| advice(address.parse().expect("an address"), &kind.into());
        let low = advice("127.0.0.1:80", ErrorKind::PermissionDenied);
        assert!(low.contains("below 1024 needs root or CAP_NET_BIND_SERVICE"), "{low}");
        let high = advice("127.0.0.1:4711", ErrorKind::PermissionDenied);
        assert!(!high.contains("1024") && high.contains("does not let this user"), "{high}");
        assert!(advice("127.0.0.1:80", ErrorKind::AddrInUse).starts_with("stop what listens there"));
        assert!(advice("192.0.2.1:4711", ErrorKind::AddrNotAvailable).starts_with("name an address of this machine"));
    }
}
