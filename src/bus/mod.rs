//! Inspects a network that no program uses: its slaves, their ports and cables, objects, EEPROMs, files and clocks. Nothing
//! moves, because no slave is brought above PreOP.
//!
//! A [`Network`] gives access to the slaves; [`open()`] makes one from a link. Behind `nic:` (a network card) and
//! `sim:` (simulated slaves in virtual time) it is [this crate's own master](crate::master); an ECM-XF is a master
//! itself. Everything else uses the trait alone:
//!
//! | file | what it contains |
//! | --- | --- |
//! | `network.rs` | [`Network`], [`FoundSlave`] |
//! | `open.rs` | [`open()`]: the network of a link; [`over`]: a network behind any wires |
//! | `chip.rs`, `chip_wire.rs` | the network of an ECM-XF by its commands; frames of the crate's master as datagrams |
//! | `mailboxes.rs` | the mailbox services that this crate's own master handles, also where a chip runs the network |
//! | `software.rs`, `simulated.rs` | the network of the crate's own master, on a card or on simulated slaves; these slaves |
//! | `dictionary.rs` | [`dictionary`]: the objects of a slave as it describes them, with their values |
//! | `port_errors.rs` | [`port_errors`]: the error counters of all ports, and which cable is bad |
//! | `clocks.rs` | [`clocks`]: how well the distributed clocks are synchronized |
//! | `eeprom.rs`, `content_error.rs` | [`eeprom`]: whether new content fits a slave, what it changes, writing it |
//! | `round_trips.rs` | the round-trip times of frames on a network card |
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
mod mailboxes;
mod network;
mod open;
pub mod port_errors;
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
