//! Hosts without an operating system: a microcontroller that has an ECM-SK or an ECM-XF on its SPI. Written over the traits of
//! [`embedded-hal`](embedded_hal) 1.0, so for every microcontroller whose crate implements them. Nothing here allocates.
//!
//! - [`Board`]: an ECM-SK, one frame of [`sk`](crate::sk) each way in every exchange
//! - [`ChipWires`]: the wires of the [driver](crate::xf::host::Host) of an ECM-XF
//!
//! Both were tried with the models of the board and of the chip, and not on a microcontroller yet.

mod board;
mod chip;

pub use board::{Board, BoardError, RESET_LOW_NS};
pub use chip::ChipWires;
