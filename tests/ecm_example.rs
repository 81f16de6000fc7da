//! The examples of the native API run and print what they promise.

use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("it lies in the target folder");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["run", "--quiet", "--example", "two_axes", "--target-dir"]).arg(target);
    if !cfg!(debug_assertions) {
        cargo.arg("--release");
    }
    cargo.arg("--").args(arguments).current_dir(env!("CARGO_MANIFEST_DIR"));
    cargo.output().expect("cargo runs")
}

/// API-32 SK-5.11 Two axes go where they are sent, with the same result every time on virtual time.
#[test]
fn two_axes() {
    for arguments in [&[][..], &["sim:?slaves=drive*2&clock=virtual&fw=1.5&slot=16"]] {
        let ran = run(arguments);
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{said}");
        let expected = "on\naxis 1: 90.0 degrees\naxis 2: -45.0 degrees\n2000 frames, 0 underruns, 0 losses\n";
        assert_eq!(String::from_utf8_lossy(&ran.stdout), expected);
    }
}

/// API-32 SK-4.10 What goes wrong is said with the next step to do.
#[test]
fn two_axes_on_a_board_of_three() {
    let ran = run(&["sim:?slaves=drive*3&clock=virtual"]);
    assert_eq!(ran.status.code(), Some(1));
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(said.ends_with("correct `slaves`, or check cables and power\n"), "{said}");
}
