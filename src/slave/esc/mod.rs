//! Slave controllers (ESC) of simulated slaves, as the network sees them: frames pass a [`Chain`] of them and return.
//!
//! Nothing here reads a clock or does I/O: time is an argument, in nanoseconds of one clock for the whole network, and a frame
//! allocates nothing.
//!
//! | file | content |
//! | --- | --- |
//! | `settings.rs` | the properties of a slave controller: [`EscSettings`] |
//! | `controller.rs`, `controller/ports.rs` | the [`Controller`]: its parts, its events; its ports |
//! | `controller/accesses.rs` | reads and writes of the network, and their effects |
//! | `controller/protection.rs` | write protection |
//! | `memory.rs` | registers and RAM, and which bytes the network can write |
//! | `datagrams.rs`, `fmmus.rs` | the 15 commands; logical addressing to the bit |
//! | `managers.rs`, `managers/manager.rs` | sync managers in mailbox mode and in buffered mode; a single one |
//! | `eeprom.rs` | the EEPROM and its interface |
//! | `clock.rs`, `sync_unit.rs`, `latch_unit.rs` | distributed clocks: local and system time, SYNC0 and SYNC1, latch inputs |
//! | `watchdog.rs` | the process data watchdog |
//! | `slave.rs`, `slave/frames.rs`, `slave/cycle.rs` | a controller with its device: [`EscSlave`]; its frames; its cycles |
//! | `application.rs`, `checks.rs` | the AL state machine, and its checks |
//! | `mailbox.rs`, `sdo_server.rs`, `information.rs`, `file_server.rs` | the mailbox; SDO; SDO information; FoE |
//! | `predecessor.rs` | the state in which another master leaves a slave: [`Predecessor`] |
//! | `description.rs` | generates the EEPROM of a device |
//! | `esi.rs` | generates the ESI file of a device |
//! | `chain.rs` | slaves on a cable: [`Chain`] |
//! | `cabled.rs`, `scripted.rs` | a line of slaves with faults for scripts and tests: [`CabledChain`] |
//! | `route.rs`, `passing.rs` | the route of a frame through the slaves, and its datagrams on that route |
//!
//! Rules: ECAT-8 and following.

mod application;
mod cabled;
mod chain;
mod checks;
mod clock;
mod controller;
mod datagrams;
mod description;
mod eeprom;
mod esi;
mod file_server;
mod fmmus;
mod information;
mod latch_unit;
mod mailbox;
mod managers;
mod memory;
mod passing;
mod place;
mod predecessor;
mod route;
mod scripted;
mod sdo_server;
mod settings;
mod slave;
mod sync_unit;
mod watchdog;

pub use application::OP_WAIT_NS;
pub use cabled::{CabledChain, UndescribedError};
pub use chain::{Chain, FrameFate, HOP_NS};
pub use checks::{MAILBOX_BYTES_MAX, SYNC0_CYCLE_MIN_NS};
pub use clock::SLEW_MAX_NS;
pub use controller::Controller;
pub use description::{DescriptionError, eeprom_of};
pub use esi::esi_of;
pub use mailbox::EMERGENCIES_MAX;
pub use predecessor::Predecessor;
pub use sdo_server::VALUE_BYTES_MAX;
pub use settings::{EscSettings, MAILBOX_BYTES_MIN};
pub use slave::{DRIVEN_NS, ERROR_CYCLE_NS, EscSlave, FREE_RUN_CYCLE_NS};
pub use sync_unit::SyncPulse;
