//! The wire format, and hosts on a microcontroller, without std: a firmware is built for real, and run.

#[path = "../../examples/firmware/src/exchange.rs"]
mod exchange;

use std::path::Path;
use std::process::Output;

use ecmsk::sk::{Frame, RawSlot, SlotSize};
use exchange::{Refusal, Screen};
use serde_json::Value;

fn messages(output: &Output) -> Vec<Value> {
    String::from_utf8_lossy(&output.stdout).lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// The output of the compiler and Cargo, for messages.
fn said(output: &Output) -> String {
    let compiler = messages(output).into_iter().filter_map(|m| m["message"]["rendered"].as_str().map(str::to_owned));
    compiler.chain([String::from_utf8_lossy(&output.stderr).into_owned()]).collect()
}

/// A crate with a panic handler of its own builds over ecmsk: nothing in it links std. It uses no feature of ecmsk but `embedded`, and
/// the same crate with std linked does not build, so this test can fail.
#[test]
fn wire_format_builds_without_std() {
    let output = support::build_firmware(&[]);
    assert!(
        output.status.success(),
        "the build failed; if it is the lock file: cargo update --manifest-path examples/firmware/Cargo.toml\n{}",
        said(&output)
    );
    let messages = messages(&output);
    let artifact = |name: &str| {
        let made = |m: &&Value| m["reason"] == "compiler-artifact" && m["target"]["name"] == name;
        messages.iter().find(made).unwrap_or_else(|| panic!("{name} was not built: {}", said(&output)))
    };
    assert_eq!(artifact("ecmsk")["features"], serde_json::json!(["embedded"]));
    let library = artifact("controller")["filenames"][0].as_str().expect("a file name").to_owned();
    assert!(Path::new(&library).metadata().expect("the library was written").len() > 0);

    let with_std = support::build_firmware(&["--features", "link-std"]);
    assert!(!with_std.status.success(), "std was linked and nothing clashed: the build proves nothing");
    assert!(said(&with_std).contains("duplicate lang item `panic_impl`"), "{}", said(&with_std));
}

/// SK-4.25 The firmware sends the golden frame.
#[test]
fn firmware_sends_the_golden_frame() {
    let vector = vectors::vector_named("csp-index-7");
    let frame = exchange::command(-1_234_567, 7);
    assert_eq!(frame.wire(SlotSize::Bytes12), vector.bytes);
    assert_eq!(
        String::from_utf8_lossy(Screen::<160>::showing(&frame).text()),
        "ECM      GET_STATUS, CRC 0xFA ok\nslave 1  CSP #7 target -1234567"
    );
    assert_eq!(Screen::<10>::showing(&frame).text(), b"ECM      G");
}

/// SK-3.12 The firmware reads the golden frame; SK-1.21 it always checks the CRC.
#[test]
fn firmware_reads_the_golden_response() {
    let golden = vectors::vector_named("resp-op-fw17").frame();
    assert_eq!(exchange::position(golden.bytes()), Ok(-1_234_560));

    let size = SlotSize::Bytes12;
    let changed = |i: usize, slot: RawSlot| {
        let mut frame: Frame = golden.clone();
        frame.put(size, i, &slot);
        frame.fill_crc(size);
        exchange::position(frame.bytes())
    };
    let slot = golden.slot(size, 1);
    assert_eq!(changed(0, RawSlot { parm: 0x02, ..RawSlot::ZERO }), Err(Refusal::NotInOp));
    assert_eq!(changed(1, RawSlot { parm: 0x0250, ..slot }), Err(Refusal::NotEnabled));
    assert_eq!(changed(1, RawSlot { id: 0x11, ..slot }), Err(Refusal::OtherCommand));
    let mut unsigned = golden.clone();
    unsigned.bytes_mut()[3] = 0;
    assert_eq!(exchange::position(unsigned.bytes()), Err(Refusal::Crc));
}
