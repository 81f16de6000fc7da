//! Any bytes as a recording: frames, or an error that says where; never a panic, never without end.

#![no_main]

use ecmsk::recording::Recording;
use ecmsk::recording::exchanges::{Exchanges, is_of_chip};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    frames(bytes);
    exchanges(bytes);
});

fn frames(bytes: &[u8]) {
    match Recording::new(bytes, "fuzz") {
        Ok(mut recording) => {
            for frame in recording.by_ref() {
                if let Err(error) = frame {
                    assert!(!error.to_string().is_empty());
                    break;
                }
            }
            let _ = recording.missing();
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// The same bytes as the recording of a chip.
fn exchanges(bytes: &[u8]) {
    let of_chip = is_of_chip(bytes);
    match Exchanges::new(bytes, "fuzz") {
        Ok(mut exchanges) => {
            for recorded in exchanges.by_ref() {
                if let Err(error) = recorded {
                    assert!(!error.to_string().is_empty());
                    break;
                }
            }
            let _ = exchanges.lacks();
        }
        Err(error) => assert!(!of_chip && !error.to_string().is_empty()),
    }
}
