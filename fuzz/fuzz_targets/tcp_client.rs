//! Any bytes from a server: reports, answers, or an error that says what is wrong; never a panic.

#![no_main]

use ecmsk::link::tcp::replay;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (_, error) = replay(bytes);
    assert!(error.is_none_or(|error| !error.to_string().is_empty()));
});
