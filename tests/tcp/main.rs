//! A board on the network: the server, its links, and the effects of strangers and bad connections.
//!
//! Files:
//!
//! - `link.rs`: frames and reports, the one writer, results of calls
//! - `peers.rs`: servers and clients that misbehave
//! - `in_a_signal_handler.rs`: calls in a signal handler that has interrupted a call
//! - `strangers.rs`: connections that are not clients
//! - `secret.rs`: TLS and the shared secret
//! - `bounded.rs`: long virtual times
//! - `vanish.rs`: moving axes whose writer has vanished
//! - `outputs.rs`: the digital outputs of a pulse module whose writer has vanished
//! - `stop.rs`: axes that another client has stopped
//! - `back.rs`: boards whose link was lost and is back
//! - `slot_size.rs`: boards whose link does not know how wide slots are
//! - `machine.rs`: the machine file of a server

mod back;
mod bounded;
#[cfg(target_os = "linux")]
mod in_a_signal_handler;
mod link;
mod machine;
mod outputs;
mod peers;
mod secret;
mod slot_size;
mod stop;
mod strangers;
mod vanish;
