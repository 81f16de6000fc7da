//! The links `usb:` and `spi:` with a real kernel's USB, SPI and GPIO code below them, against the smallest loops that do
//! the same: `usb_pairs`, `usb_latency_p50`, `usb_latency_p99` against one on libusb's synchronous functions, which begins its
//! read after the write; `usb_pairs_queued`, `usb_latency_queued_p50`, `usb_latency_queued_p99` against one on its asynchronous
//! functions with eight reads under way, as the link has; `spi_exchange`, `spi_busy_to_start`. Also: how many reports are missed
//! of a board that sends one each millisecond or each 250 us, and how often a report makes the link allocate.
//!
//! Runs in a guest system alone: `cargo xtask bench --rig`. The boards are other processes of this program.

#[path = "../common/mod.rs"]
#[cfg(target_os = "linux")]
mod common;
#[cfg(target_os = "linux")]
mod counted;
#[cfg(target_os = "linux")]
mod libusb;
#[cfg(target_os = "linux")]
mod other;
#[cfg(target_os = "linux")]
mod spi;
#[cfg(target_os = "linux")]
mod spi_board;
#[cfg(target_os = "linux")]
mod usb;
#[cfg(target_os = "linux")]
mod usb_board;
/// The board's end of the wires.
#[path = "../../tests/rig/spi/wires.rs"]
#[cfg(target_os = "linux")]
mod wires;

/// What only the guest has.
const WIRES: &str = "/dev/ecm-board";

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    if !std::path::Path::new(WIRES).exists() {
        eprintln!("rig: measures in a guest system alone: cargo xtask bench --rig");
        return;
    }
    #[cfg(target_os = "linux")]
    match words[..] {
        ["usb-board", ref how @ ..] => usb_board::run(how),
        ["spi-board", ref how @ ..] => spi_board::run(how),
        ["usb"] => usb::measure(),
        ["spi"] => spi::measure(),
        _ => {
            usb::measure();
            spi::measure();
        }
    }
}
