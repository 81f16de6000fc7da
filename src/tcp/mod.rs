//! The link `tcp://host:port`: a board that another process or machine serves (`ecmsk serve tcp`,
//! [`crate::port::tcp`]).
//!
//! Every client gets every report, with the board's time, its sequence number and the number of dropped reports. One
//! client, the writer, may also send commands. A write has succeeded when the board behind the server has taken the
//! frame, so it takes a round trip. No frame is ever sent twice: if the connection ends during a write, the call fails
//! with [`LinkError::Unsure`], or with [`LinkError::Lost`] where it is certain that the board has not taken the frame.
//!
//! If several threads wait in calls, one of them receives for all. A background thread receives only while no call
//! waits, and sends the keep-alive messages. So a report wakes only the thread that waits for it. Programs may end
//! their threads by force: a waiting thread holds no lock. Only a thread that ends while it takes received bytes, or
//! while it sends, costs the connection. Once the link is open nothing is allocated, except in a TLS session, where
//! rustls allocates for each message.
//!
//! Files, in the order in which to read them:
//!
//! - `options.rs`: the keys of `tcp:` as Rust types
//! - `message.rs`, `wire.rs`, `wire_error.rs`, `fields.rs`, `counts.rs`, `failure.rs`: the messages of the protocol and their
//!   bytes, shared by client and server; `vectors.rs` tests the bytes
//! - `channel.rs`, `inbox.rs`, `waker.rs`, `tls.rs`, `proof.rs`: a connection with or without TLS, and the shared
//!   secret, for both ends
//! - `connect.rs`: how a client connects
//! - `exchange.rs`: the client's side of the protocol, without I/O
//! - `connection.rs`: how the program's threads and the background thread share the connection
//! - `client.rs`: [`TcpLink`], the link itself
//! - `hang.rs`: a program that has stopped calling (`hang_ms=`)
//! - `reconnect.rs`: a reader that connects again (`reconnect_ms=`)
//! - `stop.rs`: a client that has the axes of another one stopped; `machine.rs`: one that asks for the machine file of the
//!   server

mod channel;
mod client;
mod connect;
mod connection;
mod counts;
mod exchange;
mod failure;
mod fields;
mod hang;
mod inbox;
mod machine;
mod message;
mod options;
mod proof;
mod reconnect;
mod stop;
mod tls;
#[cfg(test)]
mod vectors;
mod waker;
pub(crate) mod wire;
mod wire_error;

use std::sync::Arc;
use std::time::Duration;

#[cfg(all(test, feature = "sim"))]
pub(crate) use channel::first_message;
pub(crate) use channel::{Came, Channel, Out};
pub use client::TcpLink;
pub(crate) use exchange::each_message;
#[doc(hidden)]
pub use exchange::{messages, replay};
pub(crate) use inbox::Inbox;
pub use machine::machine;
pub use options::{DEFAULT_PORT, TcpOptions};
pub(crate) use proof::{Material, PROOF_LEN, Side};
pub use proof::{SECRET, Secret};
pub use stop::{StopError, Stopped, served_board, stop};
pub(crate) use tls::ServerTls;
#[cfg(all(test, feature = "sim"))]
pub(crate) use tls::connect as client_session;
pub(crate) use waker::Waker;

use crate::address::uri::LinkUri;
use crate::link::common_options::CommonOptions;
use crate::link::{Link, LinkError};

/// After how many keep-alive times without any message a connection counts as dead. \[OURS]
const DEAD_AFTER: u32 = 4;

/// How long the other end of a connection may send nothing before the connection counts as dead.
pub(crate) const fn patience(keepalive: Duration) -> Duration {
    keepalive.saturating_mul(DEAD_AFTER)
}

/// Opens a `tcp:` link: connects to the server that the URI names.
pub(crate) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<Arc<dyn Link>, LinkError> {
    let options = TcpOptions::from_uri(uri)?;
    let link = TcpLink::connect(uri, &options, common)?;
    if options.reconnect.is_zero() {
        return Ok(Arc::new(link));
    }
    Ok(Arc::new(reconnect::Reconnecting::new(link, uri.clone(), options, common.clone())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TCP-5 docs/SAFETY.md: a connection counts as dead after four keep-alive times, 2 s by default.
    #[test]
    fn a_connection_is_dead_after_four_keep_alive_times() {
        let options = TcpOptions::from_uri(&"tcp://board".parse().expect("a link")).expect("its defaults");
        assert_eq!(patience(options.keepalive), Duration::from_secs(2));
        assert_eq!(patience(Duration::from_millis(100)), Duration::from_millis(400));
    }
}
