//! `ecmsk doctor --gadget` on machines of files: whether one can be the board at a USB device port.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::PermissionsExt;

use crate::common::machine::FakeMachine;
use crate::common::{Ran, json_lines};
use serde_json::Value;

const CONTROLLER: &str = "/sys/class/udc/fe980000.usb";
const GADGETS: &str = "/sys/kernel/config/usb_gadget";
const SYSTEMS: &str = "/proc/filesystems";
const MODULES: &str = "/lib/modules/6.1.0-test/modules.order";

/// A machine with a USB device port, where the user of the test may make a gadget.
fn good() -> FakeMachine {
    let tree = FakeMachine::good();
    tree.file(&format!("{CONTROLLER}/maximum_speed"), "high-speed\n");
    tree.file(&format!("{CONTROLLER}/state"), "not attached\n");
    tree.file(&format!("{CONTROLLER}/function"), "");
    tree.dir(GADGETS);
    tree.file("/proc/self/mounts", "none /sys/kernel/config configfs rw 0 0\n");
    tree.file(SYSTEMS, "nodev\tsysfs\n\text4\nnodev\tfunctionfs\n");
    tree
}

/// The findings about the device port.
fn findings(tree: &FakeMachine) -> Vec<Value> {
    // The tool runs as the user of the test, because the last check is whether this user may make a gadget in the kernel's
    // folder for gadgets.
    let mut command = tree.tool_of_us(&["doctor", "--quick", "--json", "--gadget"]);
    let ran = Ran::from(command.env("ECMSK_LINK", "sim:").output().expect("the tool starts"));
    assert!(matches!(ran.code, Some(0 | 1)) && ran.err.is_empty(), "{ran:?}");
    let mut findings = json_lines(&ran.out);
    findings.retain(|finding| finding["check"].as_str().is_some_and(|check| check.starts_with("gadget-")));
    findings
}

/// For each fault: one change to a machine without faults makes one finding that reports it, with its text and what to do. All
/// other findings stay `ok`.
#[test]
fn each_thing_that_is_wrong_has_its_finding_with_the_next_step() {
    type Change = fn(&FakeMachine);
    let cases: &[(Change, &str, &str, &str, &str)] = &[
        (|t| t.remove(CONTROLLER), "gadget-controller", "wrong", "no USB port", "dr_mode=peripheral"),
        (
            |t| t.dir("/sys/class/udc/second"),
            "gadget-controller",
            "advice",
            "fe980000.usb, second",
            "--udc fe980000.usb",
        ),
        (
            |t| t.file(&format!("{CONTROLLER}/maximum_speed"), "full-speed\n"),
            "gadget-speed",
            "wrong",
            "the board needs high speed",
            "another port",
        ),
        (
            |t| t.file(&format!("{CONTROLLER}/function"), "g_ether\n"),
            "gadget-holder",
            "wrong",
            "another gadget has it (g_ether): not attached",
            "modprobe -r g_ether",
        ),
        (
            |t| t.file(&format!("{GADGETS}/other/UDC"), "fe980000.usb\n"),
            "gadget-holder",
            "wrong",
            "(other)",
            "a service",
        ),
        (|t| t.remove(GADGETS), "gadget-configfs", "wrong", "libcomposite is not loaded", "modprobe libcomposite"),
        (
            |t| {
                t.remove(GADGETS);
                t.file("/proc/self/mounts", "proc /proc proc rw 0 0\n");
            },
            "gadget-configfs",
            "wrong",
            "not mounted",
            "mount -t configfs",
        ),
        (|t| t.file(SYSTEMS, "nodev\tsysfs\n"), "gadget-functionfs", "wrong", "no FunctionFS", "modprobe usb_f_fs"),
    ];
    for (change, check, state, found, next) in cases {
        let tree = good();
        change(&tree);
        let all = findings(&tree);
        let finding =
            all.iter().find(|finding| finding["check"] == *check).unwrap_or_else(|| panic!("{check}: {all:?}"));
        let has = |key: &str, text: &str| finding[key].as_str().is_some_and(|said| said.contains(text));
        assert!(finding["state"] == *state && has("found", found) && has("next", next), "{check}: {finding}");
        let others = all.iter().filter(|other| other["check"] != *check && other["state"] != "ok").count();
        assert_eq!(others, 0, "{check}: {all:?}");
    }
}

/// A free device port, one that serves a board, and a kernel module that is loaded later are right. Without `--gadget` there is
/// no finding about device ports.
#[test]
fn a_machine_that_can_be_a_board_is_right() {
    let tree = good();
    let said = |check: &str| {
        let found = findings(&tree).into_iter().find(|finding| finding["check"] == check).expect("it is checked");
        assert_eq!(found["state"], "ok", "{found}");
        found["found"].as_str().expect("a text").to_owned()
    };
    for (check, found) in [
        ("gadget-controller", "fe980000.usb"),
        ("gadget-speed", "high-speed"),
        ("gadget-holder", "free"),
        ("gadget-configfs", "there"),
        ("gadget-permission", "this user may make a gadget"),
        ("gadget-functionfs", "loaded"),
    ] {
        assert_eq!(said(check), found, "{check}");
    }
    tree.file(&format!("{GADGETS}/ecmsk-fe980000.usb/UDC"), "fe980000.usb\n");
    tree.file(&format!("{CONTROLLER}/state"), "configured\n");
    assert_eq!(said("gadget-holder"), "ecmsk serve gadget has it: configured");
    tree.file(SYSTEMS, "nodev\tsysfs\n");
    tree.dir("/sys/module/usb_f_fs");
    assert_eq!(said("gadget-functionfs"), "loaded", "before the first function");
    tree.remove("/sys/module/usb_f_fs");
    tree.file(MODULES, "kernel/drivers/usb/gadget/function/usb_f_fs.ko\n");
    assert_eq!(said("gadget-functionfs"), "the kernel loads it when it is needed");
    tree.file(&format!("{CONTROLLER}/maximum_speed"), "UNKNOWN\n");
    assert_eq!(said("gadget-speed"), "not known");
    let without = tree.doctor("sim:");
    assert!(!without.iter().any(|finding| finding["check"].as_str().is_some_and(|check| check.contains("gadget"))));
}

/// A user who is not root is told to start the server as root; that is no fault of the machine.
#[test]
fn a_user_is_told_that_root_makes_gadgets() {
    let tree = good();
    tree.deny(GADGETS);
    let mut command = tree.tool(&["doctor", "--quick", "--gadget"]);
    let ran = Ran::from(command.env("ECMSK_LINK", "sim:").output().expect("the tool starts"));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.out.contains("root alone may make a gadget") && ran.out.contains("with sudo"), "{ran:?}");
    fs::set_permissions(tree.path(GADGETS), fs::Permissions::from_mode(0o755)).expect("our own folder");
}
