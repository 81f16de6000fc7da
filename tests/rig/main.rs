//! Wire tests: the tool, Debian's `usbip`, and between them the USB, HID, SPI and GPIO code of a real kernel. They run in a guest
//! system, as root, one at a time: `cargo xtask test --rig`.
//!
//! Files:
//!
//! - `usb.rs`, `trouble.rs`, `silence.rs`, `sleep.rs`, `left_over.rs`, `links.rs`: the link `usb:`: in normal operation, with
//!   boards that misbehave or do not answer, after a suspend, what it leaves behind, how waits end
//! - `frames.rs`, `detach.rs`, `here.rs`, `shown.rs`: `ecmsk serve usbip`: frames, boards that are attached and detached,
//!   `--attach`, the board as the kernel sees it
//! - `gadget.rs`: `ecmsk serve gadget` on a controller whose host is the same machine
//! - `captured.rs`, `machine.rs`: captures of usbmon; what `list` and `doctor` read of a real kernel
//! - `program.rs`, `unchanged.rs`: unchanged programs
//! - `hidraw.rs`, `usbfs.rs`, `rogue.rs`: a board through hidraw and usbfs, and a device that misbehaves
//! - `spi/`: the link `spi:` and the board's end of the wires
#![cfg(target_os = "linux")]

mod captured;
mod detach;
mod frames;
mod gadget;
mod here;
mod hidraw;
mod left_over;
mod links;
mod machine;
mod program;
mod rogue;
mod shown;
mod silence;
mod sleep;
mod spi;
mod trouble;
mod unchanged;
mod usb;
mod usbfs;
