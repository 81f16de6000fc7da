//! A simulated machine, as a link or a command line describes it: its slaves, the objects of their makers, and what happens to
//! them and when. `sim:`, `xf-sim:`, `ecmsk bus` and `ecmsk serve ethercat` have it from here.
//!
//! - `options.rs`, `chip_options.rs`: the keys of `sim:` and `xf-sim:` as Rust types
//! - `build.rs`: slaves of a list; `manufacturer_objects.rs`: the objects of their makers
//! - `script.rs`: events of a script (`script=`)
//! - `sim.rs`, `boards.rs`: the links `sim:` and `xf-sim:` to a board, and the boards that outlive their links
//! - `chip.rs`: `xf-sim:` as the chip that it is
//! - `simulated_slaves.rs`: slaves and scripts for a network without a board

#[cfg(feature = "sim")]
mod boards;
#[cfg(feature = "sim")]
mod build;
#[cfg(feature = "sim")]
pub mod chip;
pub mod chip_options;
#[cfg(feature = "sim")]
pub mod manufacturer_objects;
pub mod options;
#[cfg(feature = "sim")]
pub mod script;
#[cfg(feature = "sim")]
pub(crate) mod sim;
#[cfg(feature = "sim")]
pub mod simulated_slaves;

#[cfg(feature = "sim")]
pub use boards::forget_parked;
