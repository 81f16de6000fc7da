//! The keys in the URI of a `tcp:` link, as Rust types.

use std::path::PathBuf;
use std::time::Duration;

use super::wire::Role;
use crate::address::keys::{Scheme, WHERE_TO_LOOK, millis};
use crate::address::text::decimal;
use crate::address::uri::{LinkUri, UriError};

/// The TCP port if the URI names none. \[OURS]
pub const DEFAULT_PORT: u16 = 4711;

/// Options of `tcp:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TcpOptions {
    /// The server's name or address.
    pub host: String,
    /// The server's TCP port.
    pub port: u16,
    /// Whether the client is the writer, which may send commands, or a reader.
    pub(crate) role: Role,
    /// The file with the shared secret.
    pub secret_file: Option<PathBuf>,
    /// The longest time between two messages to the server. If the program's calls send none for that long, the background
    /// thread sends a keep-alive message.
    pub keepalive: Duration,
    /// How long the program of a writer may make no call while a velocity or a torque that it has commanded is in force. Then
    /// the link ends, and the server stops the axes. Zero: without limit.
    pub hang: Duration,
    /// How long connecting to the server may take.
    pub connect_limit: Duration,
    /// How long a reader tries to connect again after the connection is lost; zero: not at all.
    pub reconnect: Duration,
}

impl TcpOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not a `tcp:` link; [`UriError::BadPath`] for an invalid host or port;
    /// [`UriError::BadValue`] for a writer with `reconnect_ms=`.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        uri.expect_scheme(Scheme::Tcp)?;
        let (host, port) = address(uri.path()).ok_or_else(|| UriError::BadPath {
            scheme: Scheme::Tcp,
            path: uri.path().to_owned(),
            allowed: "tcp://HOST:PORT, or tcp://HOST for port 4711, e.g. tcp://localhost:4711 or tcp://[::1]",
        })?;
        let options = Self {
            host,
            port,
            role: uri.choice("role", [("writer", Role::Writer), ("reader", Role::Reader)])?,
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

/// Host and port of `//host:port`, or of `//host` with the default port. An IPv6 address is written in brackets.
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
        // An IPv6 address without brackets is refused: after its first colon it continues with text that is no number.
        Some(port) => decimal(port).and_then(|port| u16::try_from(port).ok()).filter(|port| *port != 0)?,
    };
    (!host.is_empty()).then(|| (host.to_owned(), port))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A URI without a port means the default port, which is also the default of servers.
    #[test]
    fn a_uri_without_a_port_means_the_default_port() {
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
