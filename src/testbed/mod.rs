//! A simulated machine as a link or a command line describes it: its slaves, their manufacturer-specific objects, and a
//! script of events. `sim:`, `xf-sim:`, `ecmsk bus` and `ecmsk serve ethercat` use it.
//!
//! - `options.rs`, `chip_options.rs`, `shared_options.rs`: the keys of `sim:` and `xf-sim:` as Rust types
//! - `build.rs`: builds the slaves of a list; `manufacturer_objects.rs`: reads their manufacturer-specific objects
//! - `script.rs`: events of a script (`script=`)
//! - `control/`: events that come while a board runs (`control=`)
//! - `sim.rs`, `boards.rs`: the links `sim:` and `xf-sim:` to a board, and the boards that outlive their links
//! - `chip.rs`: `xf-sim:` opened as a chip
//! - `simulated_slaves.rs`: slaves and scripts for a network without a board

mod boards;
mod build;
pub mod chip;
pub mod chip_options;
pub mod control;
pub mod manufacturer_objects;
pub mod options;
pub mod script;
mod shared_options;
pub(crate) mod sim;
pub mod simulated_slaves;

pub use boards::{forget_parked, use_program_clock};
