//! Sends and receives Ethernet frames at a network interface of this machine, without interpreting them (Linux,
//! packet(7)).
//!
//! - `claim.rs`: reserves an interface for one program at a time
//! - `interface.rs`: the network interfaces, and whether one may be used for EtherCAT frames
//! - `ethtool.rs`: the settings of a network card
//! - `socket.rs`: frames of one EtherType at an interface

mod claim;
mod ethtool;
mod interface;
mod socket;

pub use claim::Claim;
pub use ethtool::{CardSettings, settings};
pub use interface::{DefaultRoute, Interface, InterfaceError, MacAddress, check, interfaces};
pub use socket::{EthernetSocket, LinkState, SocketError};
