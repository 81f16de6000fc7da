//! The usual look at a network, by whoever has it before him and no program runs: which slaves there are, what their ports and
//! cables are like, their objects, EEPROMs, files and clocks. Nothing is moved: no slave is brought above PreOP.
//!
//! A [`Network`] is a way to the slaves; [`open`] makes one of a link: a network card (`nic:`) or simulated slaves (`sim:`,
//! in virtual time) with [our own master](crate::master), or the chip ECM-XF, which is a master itself. Everything else is
//! written over the trait:
//!
//! | file | what it answers |
//! | --- | --- |
//! | `network.rs` | [`Network`], [`FoundSlave`] |
//! | `open.rs` | [`open`]: which network a link is; [`over`]: one at the end of any wires |
//! | `chip.rs`, `chip_wire.rs` | an ECM-XF by its own commands; our master's frames by its datagrams |
//! | `mailboxes.rs` | what goes through the slaves' mailboxes by our own master, whoever runs the network |
//! | `software.rs`, `simulated.rs` | our own master on a card or on simulated slaves; those |
//! | `dictionary.rs` | [`dictionary`]: the objects of a slave by its own word, with their values |
//! | `errors.rs` | [`errors`]: the error counters of all ports, and which cable is bad |
//! | `clocks.rs` | [`clocks`]: how well the distributed clocks keep together |
//! | `eeprom.rs`, `content_error.rs` | [`eeprom`]: whether a content is fit for a slave, what it changes, writing it |
//! | `round_trips.rs` | how long frames take to the slaves of a card and back |
//! | `error.rs` | [`BusError`] |
//!
//! ```
//! # #[cfg(feature = "sim")] {
//! use ecmsk::bus;
//!
//! let mut network = bus::open("sim:?slaves=drive*2,io").expect("a network");
//! let slaves = network.scan().expect("three slaves");
//! assert_eq!(slaves.iter().map(|slave| &*slave.name).collect::<Vec<_>>(), ["drive", "drive", "io"]);
//! # }
//! ```

mod chip;
mod chip_wire;
pub mod clocks;
mod content_error;
pub mod dictionary;
pub mod eeprom;
mod error;
pub mod errors;
mod mailboxes;
mod network;
mod open;
#[cfg(all(feature = "nic", target_os = "linux"))]
mod round_trips;
#[cfg(feature = "sim")]
mod simulated;
#[cfg(any(feature = "sim", all(feature = "nic", target_os = "linux")))]
mod software;

pub use error::BusError;
pub use network::{FoundSlave, Network, SlaveState};
pub use open::open;
#[cfg(any(feature = "sim", all(feature = "nic", target_os = "linux")))]
pub use open::over;
#[cfg(all(feature = "nic", target_os = "linux"))]
pub use round_trips::{RoundTrips, round_trips};
