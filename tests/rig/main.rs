//! Wire tests: the tool, Debian's `usbip`, and between them the USB, HID, SPI and GPIO code of a real kernel. They run in a guest
//! system, as root, one at a time: `cargo xtask test --rig`.
#![cfg(target_os = "linux")]

mod captured;
mod detach;
mod frames;
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
