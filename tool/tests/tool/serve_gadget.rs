//! `ecmsk serve gadget`: what it refuses. What it does on a controller is in tests/rig.
#![cfg(target_os = "linux")]

use std::fs;

use crate::common::{Ran, ecmsk};

fn run(arguments: &[&str]) -> Ran {
    ecmsk([&["serve", "gadget"][..], arguments].concat()).output().expect("the tool starts").into()
}

/// What cannot be is said with the next step, and nothing is made.
#[test]
fn a_board_that_cannot_be_shown_is_an_error_with_the_next_step() {
    run(&[]).expect_misuse(&["--link"]);
    run(&["--link", "sim:?slaves=whale"]).expect_misuse(&["slaves"]);
    run(&["--link", "sim:", "--vendor", "12345"]).expect_misuse(&["allowed: 0000 to ffff"]);
    run(&["--link", "sim:", "--interval", "17"]).expect_misuse(&["17"]);
    run(&["--link", "sim:", "--on-vanish", "jump"]).expect_misuse(&["servo-off"]);
    let long = "x".repeat(127);
    run(&["--link", "sim:", "--serial", &long]).expect_failure(1, &[&long], "126 characters");
    let there = fs::read_dir("/sys/class/udc").is_ok_and(|mut entries| entries.next().is_some());
    if there {
        run(&["--link", "sim:", "--udc", "no_such_udc"]).expect_failure(1, &["no_such_udc"], "--udc");
    } else {
        run(&["--link", "sim:"]).expect_failure(1, &["no USB device controller"], "modprobe dummy_hcd");
    }
}
