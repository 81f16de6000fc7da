//! A board on the network: the server, its links, and what strangers and bad lines do to them.
//!
//! Files:
//!
//! - `link.rs`: what the link moves, who may write, how calls end
//! - `peers.rs`: servers and clients that misbehave
//! - `strangers.rs`: connections that are not clients
//! - `secret.rs`: TLS and the shared secret
//! - `bounded.rs`: long virtual times
//! - `vanish.rs`: moving axes whose writer is gone

mod bounded;
mod link;
mod peers;
mod secret;
mod strangers;
mod vanish;
