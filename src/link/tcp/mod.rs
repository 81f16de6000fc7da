//! The link `tcp://host:port`: a board that another process or machine serves (`ecmsk serve tcp`, [`crate::port::tcp`]).
//!
//! Every client gets every report, with the board's time, its number and how many were dropped. One of them, the writer,
//! sends commands; a write is done when the board behind the server has taken the frame, so it takes a round trip. No
//! frame is ever sent twice: a connection that ends in the middle of a write gives [`LinkError::Unsure`], and
//! [`LinkError::Lost`] where it is known that the frame was not taken.
//!
//! Whoever waits in a call receives for all calls; a thread in the background does so only while nobody waits, and says
//! that the client is there. So a report wakes the thread that wants it and no other one, and nothing is allocated once
//! the link is open (in a TLS session rustls allocates for each message).

mod channel;
mod client;
mod connect;
mod counts;
mod exchange;
mod failure;
mod fields;
mod hang;
mod inbox;
mod message;
mod options;
mod proof;
mod reconnect;
mod tls;
mod traffic;
#[cfg(test)]
mod vectors;
mod waker;
pub(crate) mod wire;

use std::sync::Arc;

#[cfg(all(test, feature = "sim"))]
pub(crate) use channel::first_message;
pub(crate) use channel::{Came, Channel, Out};
pub use client::TcpLink;
pub(crate) use exchange::each_message;
#[doc(hidden)]
pub use exchange::{messages, replay};
pub(crate) use inbox::Inbox;
pub use options::{DEFAULT_PORT, TcpOptions};
pub(crate) use proof::{Material, PROOF_LEN, Side};
pub use proof::{SECRET, Secret};
pub(crate) use tls::ServerTls;
#[cfg(all(test, feature = "sim"))]
pub(crate) use tls::connect as client_session;
pub(crate) use waker::Waker;

use super::options::CommonOptions;
use super::uri::LinkUri;
use super::{Link, LinkError};

/// A connection is dead after as many keep-alive times without a word. \[OURS]
pub(crate) const DEAD_AFTER: u32 = 4;

/// Connects to the server that the URI names.
pub(super) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<Arc<dyn Link>, LinkError> {
    let options = TcpOptions::from_uri(uri)?;
    let link = TcpLink::connect(uri, &options, common)?;
    if options.reconnect.is_zero() {
        return Ok(Arc::new(link));
    }
    Ok(Arc::new(reconnect::Reconnecting::new(link, uri.clone(), options, common.clone())))
}
