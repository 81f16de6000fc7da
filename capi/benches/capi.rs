//! `capi_call`: a write and a read through the C functions against the same through the Rust link, on virtual time.

#[path = "../../benches/common/mod.rs"]
mod common;

use std::hint::black_box;

use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{FRAME_LEN, Frame, SlotSize};
// Brings the C functions in, which the linker finds by their names.
use NEXTWUSBLib as _;

const LINK: &str = "sim:?slaves=drive*2&clock=virtual";

unsafe extern "system" {
    safe fn OpenECMUSB() -> u32;
    fn ECMUSBWrite(data: *const u8, length: std::ffi::c_ulong) -> u32;
    fn ECMUSBRead(data: *mut u8, length: std::ffi::c_ulong) -> u32;
    safe fn CloseECMUSB();
}

fn main() {
    // SAFETY: no other thread has been started.
    unsafe { std::env::set_var("ECMSK_LINK", LINK) };
    assert_eq!(OpenECMUSB(), 1, "the board opens");
    let native = link::open(LINK, Share::ByName).expect("the board opens");

    let length = SlotSize::Bytes12.frame_len();
    let command = Frame::new();
    let mut buffer = [0u8; FRAME_LEN];
    let mut report = Frame::new();
    common::pair(
        "capi_call",
        1.1,
        || {
            // SAFETY: both buffers have 512 bytes, of which `length` are used.
            let done = unsafe {
                ECMUSBWrite(black_box(command.bytes()).as_ptr(), length as _)
                    & ECMUSBRead(buffer.as_mut_ptr(), length as _)
            };
            assert_eq!(done, 1);
            black_box(&buffer);
        },
        || {
            native.write(black_box(&command), Wait::Forever).expect("the board takes it");
            native.read(&mut report, Wait::Forever).expect("a report comes");
            black_box(&report);
        },
    );
    CloseECMUSB();
}
