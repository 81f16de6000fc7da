//! A chip ECM-XF served as a stream of bytes, and a host at the other end that knows the page docs/XF-PORT.md alone.
//!
//! Files:
//!
//! - `client.rs`: that host, and a link to a chip made of it
//! - `messages.rs`: exchanges, lines and waits; what is no request
//! - `hosts.rs`: one host at a time, hosts that stop to read or to write, links that fail
//! - `vanish.rs`: axes whose host has vanished
//! - `listening.rs`: where a chip is served
//! - `recording.rs`: recordings of a chip, `record=`
//! - `script.rs`: what happens to the slaves, `script=`
#![cfg(unix)]

mod client;
mod hosts;
mod listening;
mod messages;
mod recording;
mod script;
mod vanish;
