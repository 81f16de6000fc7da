//! Any text as the URI of a link: a clear error or a link whose normal form reads back as the same.

#![no_main]

use ecmsk::link::options::{CommonOptions, SimOptions};
use ecmsk::link::uri::LinkUri;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| match LinkUri::parse(text) {
    Ok(uri) => {
        let normal = uri.to_string();
        assert_eq!(LinkUri::parse(&normal).as_ref(), Ok(&uri), "{normal}");
        let _ = (CommonOptions::from_uri(&uri), SimOptions::from_uri(&uri));
    }
    Err(error) => assert!(!error.to_string().is_empty()),
});
