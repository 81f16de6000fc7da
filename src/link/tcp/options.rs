//! What the URI of a `tcp:` link says.

use std::path::PathBuf;
use std::time::Duration;

use super::wire::Role;
use crate::link::keys::{Scheme, WHERE_TO_LOOK};
use crate::link::options::millis;
use crate::link::uri::{LinkUri, UriError};

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
            allowed: "tcp://HOST:PORT, e.g. tcp://localhost:4711 or tcp://[::1]:4711",
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

/// Host and port of `//host:port`; an IPv6 address stands in brackets.
fn address(path: &str) -> Option<(String, u16)> {
    let (host, port) = path.strip_prefix("//")?.trim_end_matches('/').rsplit_once(':')?;
    let host = match host.strip_prefix('[') {
        Some(host) => host.strip_suffix(']')?,
        None if host.contains(':') => return None,
        None => host,
    };
    let digits = !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit());
    let port = port.parse().ok().filter(|port| digits && *port != 0)?;
    (!host.is_empty()).then(|| (host.to_owned(), port))
}
