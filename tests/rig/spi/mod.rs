//! SPI: spidev and the GPIO lines of a real kernel, and a board on the wires behind them.
//!
//! Files:
//!
//! - `kernel.rs`: the wires of the rig without a board
//! - `wires.rs`, `played.rs`, `model.rs`: the board's end: the device of the kernel module, a thread that answers,
//!   and the model behind it
//! - `answers.rs`: a host other than the link
//! - `link.rs`, `lies.rs`: the link, and faulty wires
//! - `chip.rs`, `chip_board.rs`: the link `xf-spi:`, as a chip and as a board, with the model of an ECM-XF

mod answers;
mod chip;
mod chip_board;
mod kernel;
mod lies;
mod link;
mod model;
mod played;
mod wires;

pub use self::model::Model;

use std::os::unix::process::CommandExt;
use std::process::{Command, Output};

/// The device that the module of `tests/rig/board` makes.
const SPIDEV: &str = "/dev/spidev0.0";
const CHIP: &str = "/dev/gpiochip0";
/// Lines of the chip.
const BUSY: u32 = 0;
const RESET: u32 = 1;
/// The same for a link.
pub const LINK: &str = "spi:/dev/spidev0.0?busy=gpiochip0/BUSY";
const LINK_WITHOUT_BUSY: &str = "spi:/dev/spidev0.0";
const RESET_KEY: &str = "gpiochip0/1";

/// Runs the tool, as that user or as root.
fn tool(arguments: &[&str], user: Option<u32>) -> Output {
    let mut command = Command::new("/rig/ecmsk");
    command.args(arguments).current_dir("/");
    if let Some(user) = user {
        command.uid(user).gid(user);
    }
    command.output().expect("the tool starts")
}
