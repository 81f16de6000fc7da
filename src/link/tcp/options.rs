//! What the URI of a `tcp:` link says.

use std::path::PathBuf;
use std::time::Duration;

use super::wire::Role;
use crate::link::keys::{Scheme, WHERE_TO_LOOK};
use crate::link::options::millis;
use crate::link::uri::{LinkUri, UriError};

/// The port where nothing else is said. \[OURS]
pub const DEFAULT_PORT: u16 = 4711;

/// Options of `tcp:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TcpOptions {
    /// The server's name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Whether it may write.
    pub(crate) role: Role,
    /// The file with the shared secret.
    pub secret_file: Option<PathBuf>,
    /// It says something at least this often.
    pub keepalive: Duration,
    /// How long a writer's program may make no call while a velocity or a torque is in force; zero: without limit.
    pub hang: Duration,
    /// How long connecting may take.
    pub connect_limit: Duration,
    /// How long a reader tries to connect again; zero: it does not.
    pub reconnect: Duration,
}

impl TcpOptions {
    /// The options of that link, defaults filled in.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is no `tcp:` link, [`UriError::BadValue`] for host and port, and for a writer that
    /// wants to connect again.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        if uri.scheme() != Scheme::Tcp {
            return Err(UriError::OtherScheme { uri: uri.to_string(), expected: Scheme::Tcp });
        }
        let (host, port) = address(uri.path()).ok_or_else(|| UriError::BadPath {
            scheme: Scheme::Tcp,
            path: uri.path().to_owned(),
            allowed: "tcp://HOST:PORT, or tcp://HOST for port 4711, e.g. tcp://localhost:4711 or tcp://[::1]",
        })?;
        let options = Self {
            host,
            port,
            role: uri.required("role", |value| match value {
                "writer" => Some(Role::Writer),
                "reader" => Some(Role::Reader),
                _ => None,
            })?,
            secret_file: uri.typed("secret_file", |value| Some(PathBuf::from(value)))?,
            keepalive: uri.required("keepalive_ms", millis)?,
            hang: uri.required("hang_ms", millis)?,
            connect_limit: uri.required("connect_timeout_ms", millis)?,
            reconnect: uri.required("reconnect_ms", millis)?,
        };
        if options.role == Role::Writer && !options.reconnect.is_zero() {
            return Err(UriError::BadValue {
                key: "reconnect_ms".to_owned(),
                value: options.reconnect.as_millis().to_string(),
                why: format!(
                    "a writer does not connect again by itself, its program has to look at the board first; \
                     allowed: reconnect_ms= with role=reader; {WHERE_TO_LOOK}"
                ),
            });
        }
        Ok(options)
    }
}

/// Host and port of `//host:port`, or of `//host` with the default one; an IPv6 address stands in brackets.
fn address(path: &str) -> Option<(String, u16)> {
    let place = path.strip_prefix("//")?.trim_end_matches('/');
    let (host, port) = match place.strip_prefix('[') {
        Some(rest) => {
            let (host, rest) = rest.split_once(']')?;
            (host, if rest.is_empty() { None } else { Some(rest.strip_prefix(':')?) })
        }
        None => place.split_once(':').map_or((place, None), |(host, port)| (host, Some(port))),
    };
    let port = match port {
        None => DEFAULT_PORT,
        // A second colon is that of an IPv6 address without brackets: no digit.
        Some(port) if port.is_empty() || !port.bytes().all(|byte| byte.is_ascii_digit()) => return None,
        Some(port) => port.parse().ok().filter(|port| *port != 0)?,
    };
    (!host.is_empty()).then(|| (host.to_owned(), port))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TCP-28 A place without a port is that of the port where servers listen that are told no other.
    #[test]
    fn a_port_that_is_not_said() {
        for (uri, host, port) in [
            ("tcp://localhost", "localhost", DEFAULT_PORT),
            ("tcp://localhost/?role=reader", "localhost", DEFAULT_PORT),
            ("tcp://10.0.0.1", "10.0.0.1", DEFAULT_PORT),
            ("tcp://[::1]", "::1", DEFAULT_PORT),
            ("tcp://[::1]:5", "::1", 5),
            ("tcp://localhost:80", "localhost", 80),
        ] {
            let options = TcpOptions::from_uri(&LinkUri::parse(uri).unwrap()).unwrap();
            assert_eq!((options.host.as_str(), options.port), (host, port), "{uri}");
        }
    }
}
