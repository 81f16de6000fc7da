//! `include/ecmsk.h` is what cbindgen makes of the sources.

use std::fs;
use std::path::Path;

/// The header in the repository is fresh. With `ECMSK_BLESS` set it is written instead.
#[test]
fn the_checked_in_header_is_fresh() {
    let capi = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = capi.join("../include/ecmsk.h");
    let config = cbindgen::Config::from_file(capi.join("cbindgen.toml")).expect("cbindgen.toml");
    let bindings = cbindgen::generate_with_config(capi, config).expect("cbindgen reads the sources");
    let mut made = Vec::new();
    bindings.write(&mut made);
    if std::env::var_os("ECMSK_BLESS").is_some() {
        fs::write(&path, &made).expect("include/ecmsk.h can be written");
    }
    let kept = fs::read(&path).expect("include/ecmsk.h");
    assert!(
        kept == made,
        "include/ecmsk.h is not what the sources say; run `ECMSK_BLESS=1 cargo test -p NEXTWUSBLib --test ecmsk_header`"
    );
}
