//! Any bytes from a client: the server answers or lets it go; it never panics, and what it says can be read.

#![no_main]

use ecmsk::link::tcp::messages;
use ecmsk::link::{self, Share};
use ecmsk::port::tcp::answer;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let slot = if kind & 1 == 0 { 12 } else { 16 };
    let board = link::open(&format!("sim:?slaves=drive,io&slot={slot}&clock=virtual&host_us=0"), Share::ByName);
    let said = answer(board.expect("the simulated board"), bytes);
    assert!(messages(&said).is_ok());
});
