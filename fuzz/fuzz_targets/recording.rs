//! Any bytes as a recording: frames, or an error that says where; never a panic, never without end.

#![no_main]

use ecmsk::recording::Recording;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match Recording::new(bytes, "fuzz") {
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
});
