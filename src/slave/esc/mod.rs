//! Slave controllers (ESC) around simulated slaves, as the network sees them: frames pass a [`Chain`] of them and come back.
//!
//! Everything here is plain data and pure steps: time is an argument, in nanoseconds of one clock for the whole network,
//! and a frame allocates nothing.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `settings.rs` | what kind of controller it is: [`EscSettings`] |
//! | `controller.rs`, `controller/ports.rs` | the [`Controller`]: its parts, its events; its ports |
//! | `controller/accesses.rs` | what the network reads and writes, and what that causes |
//! | `controller/protection.rs` | its write protection |
//! | `memory.rs` | its memory, and which bytes the network may write |
//! | `datagrams.rs`, `fmmus.rs` | the 15 commands, and logical addressing to the bit |
//! | `managers.rs`, `managers/manager.rs` | sync managers: mailboxes, and three buffers; one of them |
//! | `eeprom.rs` | the interface to the EEPROM |
//! | `clock.rs`, `sync_unit.rs`, `latch_unit.rs` | distributed clocks: local and system time, SYNC0 and SYNC1, latch inputs |
//! | `watchdog.rs` | the watchdog of process data |
//! | `slave.rs`, `slave/frames.rs`, `slave/cycle.rs` | a controller with its device: [`EscSlave`], what it does with a frame, and how its device works |
//! | `application.rs`, `checks.rs` | the AL state machine, and what it checks |
//! | `mailbox.rs`, `sdo_server.rs`, `information.rs`, `file_server.rs` | the mailbox with its repeat, SDO, SDO information, emergencies, files |
//! | `predecessor.rs` | what another master has left in a slave: [`Predecessor`] |
//! | `description.rs` | the EEPROM of a device |
//! | `esi.rs` | its ESI file |
//! | `chain.rs` | slaves on a cable: [`Chain`] |
//! | `cabled.rs`, `scripted.rs` | a line of them to which happens what scripts and tests want: [`CabledChain`] |
//! | `route.rs`, `passing.rs` | the way of a frame through them, and its datagrams on that way |
//!
//! Rules: ECAT-8 and on.

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
