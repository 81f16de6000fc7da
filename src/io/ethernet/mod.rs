//! Ethernet frames from and to a network interface of this machine, without a word of what is in them (Linux, packet(7)).
//!
//! - `claim.rs`: an interface belongs to one program of ours at a time
//! - `interface.rs`: the network interfaces, and whether one is fit for frames that are not of a network of people
//! - `ethtool.rs`: how a network card is set up
//! - `socket.rs`: the frames of one EtherType from and to an interface

mod claim;
mod ethtool;
mod interface;
mod socket;

pub use claim::Claim;
pub use ethtool::{CardSettings, settings};
pub use interface::{DefaultRoute, Interface, InterfaceError, MacAddress, check, interfaces};
pub use socket::{LinkState, Socket, SocketError};
