//! A chip ECM-XF served as a stream of bytes, and a host at the other end, written only from the page docs/XF-PORT.md.
//!
//! Files:
//!
//! - `client.rs`: that host, and a link to a chip based on it
//! - `messages.rs`: exchanges, lines and waits; invalid requests
//! - `hosts.rs`: one host at a time, hosts that stop reading or writing, links that fail
//! - `vanish.rs`: axes whose host has vanished
//! - `listening.rs`: the addresses at which a chip is served
//! - `recording.rs`: recordings of a chip, `record=`
//! - `script.rs`: events of the slaves, `script=`
#![cfg(unix)]

mod client;
mod hosts;
mod listening;
mod messages;
mod recording;
mod script;
mod vanish;
