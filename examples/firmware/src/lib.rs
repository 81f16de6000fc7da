//! A controller without an operating system: C code of a firmware calls functions that fill the frame that goes out over
//! SPI, read the frame that came in, show a frame on a small screen, and count the slaves of a chip ECM-XF.
//!
//! A program has one panic handler and std brings its own. That this crate builds with its own handler proves that
//! nothing in it, including ecmsk and its dependencies, links std.
#![no_std]

#[cfg(feature = "link-std")]
extern crate std;

mod chip;
mod exchange;

use core::panic::PanicInfo;

use ecmsk::sk::FRAME_LEN;

/// Fills `frame` with the commands of one cycle: slave 1 moves to `target`, in counts.
// SAFETY: nothing else that a firmware links has this name.
#[unsafe(no_mangle)]
pub extern "C" fn controller_command(frame: &mut [u8; FRAME_LEN], target: i32, index: u8) {
    frame.copy_from_slice(exchange::command(target, index).bytes());
}

/// Reads slave 1's position, counts, out of `frame` into `position`; returns 0, or a number for the reason of a
/// failure.
// SAFETY: nothing else that a firmware links has this name.
#[unsafe(no_mangle)]
pub extern "C" fn controller_response(frame: &[u8; FRAME_LEN], position: &mut i32) -> i32 {
    match exchange::position(frame) {
        Ok(found) => {
            *position = found;
            0
        }
        Err(refusal) => refusal as i32,
    }
}

/// Writes the dump of `frame` into `screen`, as far as it fits, and returns its length in bytes.
// SAFETY: nothing else that a firmware links has this name.
#[unsafe(no_mangle)]
pub extern "C" fn controller_show(frame: &[u8; FRAME_LEN], screen: &mut [u8; 160]) -> usize {
    let shown = exchange::Screen::<160>::showing(&ecmsk::sk::Frame::from_bytes(*frame));
    screen[..shown.text().len()].copy_from_slice(shown.text());
    shown.text().len()
}

/// The state byte of the board at the SPI of the firmware, or -1 if it is busy or does not answer.
// SAFETY: nothing else that a firmware links has this name.
#[unsafe(no_mangle)]
pub extern "C" fn controller_state(firmware: &chip::Firmware) -> i32 {
    chip::state(*firmware).map_or(-1, i32::from)
}

/// Starts the chip at the SPI of the firmware, and its network; returns the number of slaves, or -1 if the chip does not
/// answer.
// SAFETY: nothing else that a firmware links has this name.
#[unsafe(no_mangle)]
pub extern "C" fn controller_slaves(firmware: &chip::Firmware) -> i32 {
    chip::slaves(*firmware).map_or(-1, i32::from)
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
