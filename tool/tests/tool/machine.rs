//! Files of a machine that `ecmsk list` and `ecmsk doctor` read, even if they are broken, and the file that doctor
//! writes: the udev rule.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::PermissionsExt;

use crate::common::machine::FakeMachine;
use crate::common::{Ran, json_lines, run};

/// `doctor --write-udev-rule` writes the rule to udev's folder if there is none; an existing file is not changed.
#[test]
fn the_udev_rule_is_written_once_where_udev_looks() {
    let kept = fs::read_to_string(support::root().join("share/udev/60-ecmsk.rules")).expect("the rule");
    let tree = FakeMachine::bare();
    fs::set_permissions(tree.path("/etc/udev/rules.d"), fs::Permissions::from_mode(0o777)).expect("our own folder");
    let written = tree.path("/etc/udev/rules.d/60-ecmsk.rules");
    let first = tree.run(&["doctor", "--write-udev-rule"]).expect_quiet();
    assert_eq!(fs::read_to_string(&written).expect("it is written"), kept);
    assert!(first.starts_with(&kept), "it is shown: {first}");
    assert!(first.contains("\nsudo udevadm control --reload\nsudo udevadm trigger "), "{first}");
    let again = tree.run(&["doctor", "--write-udev-rule"]).expect_quiet();
    assert!(again.starts_with("/etc/udev/rules.d/60-ecmsk.rules is there already"), "{again}");
    tree.file("/etc/udev/rules.d/60-ecmsk.rules", "# mine\n");
    let ran = tree.run(&["doctor", "--write-udev-rule"]);
    ran.expect_failure(1, &["exists with another content and was not changed", "sudo rm "], "check it");
    assert_eq!(fs::read_to_string(&written).expect("it is there"), "# mine\n");
    tree.remove("/etc/udev");
    let ran = tree.run(&["doctor", "--write-udev-rule"]);
    ran.expect_failure(1, &["was not written"], "does this machine have udev");
    run(["doctor", "--write-udev-rule", "--json"]).expect_misuse(&["--json"]);
}

/// A user without the right to write the udev rule gets commands from the tool that write it.
#[test]
fn a_user_who_may_not_write_the_rule_gets_working_commands() {
    let kept = fs::read_to_string(support::root().join("share/udev/60-ecmsk.rules")).expect("the rule");
    let tree = FakeMachine::bare();
    fs::set_permissions(tree.path("/etc/udev/rules.d"), fs::Permissions::from_mode(0o555)).expect("our own folder");
    let ran = tree.run(&["doctor", "--write-udev-rule"]);
    ran.expect_failure(1, &["was not written: Permission denied"], "type the lines above");
    assert!(!tree.path("/etc/udev/rules.d/60-ecmsk.rules").exists());
    // The printed commands are executed as root would do it, but on this machine of files.
    let typed = tree.path("/typed");
    let script = ran.out.replace("/etc/udev/rules.d/60-ecmsk.rules", typed.to_str().expect("UTF-8"));
    let script = format!("sudo() {{ case $1 in tee) \"$@\";; *) echo \"$@\";; esac; }}\n{script}");
    let bash = std::process::Command::new("bash").args(["-c", &script]).output().expect("bash starts");
    let said = Ran::from(bash).expect_quiet();
    assert_eq!(fs::read_to_string(typed).expect("it is written"), kept);
    assert!(said.starts_with("udevadm control --reload\nudevadm trigger --subsystem-match=usb"), "{said}");
}

/// The udev rule has a line for the USB device and one for hidraw, each with the board's ids and the tag uaccess, and lines
/// that give spidev and GPIO devices to groups. By its number the file comes before the file that acts on uaccess.
#[test]
fn the_rule_matches_the_board_by_its_ids_before_uaccess_is_acted_on() {
    let rule = fs::read_to_string(support::root().join("share/udev/60-ecmsk.rules")).expect("the rule");
    let lines: Vec<&str> = rule.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).collect();
    for subsystem in ["usb", "hidraw"] {
        let start = format!("SUBSYSTEM==\"{subsystem}\", ");
        let of = |line: &&&str| line.starts_with(&start) && line.contains("TAG+=\"uaccess\"");
        let line = lines.iter().find(of).unwrap_or_else(|| panic!("no line for {subsystem}"));
        assert!(line.contains("{idVendor}==\"16c0\", ") && line.contains("{idProduct}==\"05df\", "), "{line}");
    }
    for (subsystem, group) in [("spidev", "spi"), ("gpio", "gpio")] {
        let start = format!("SUBSYSTEM==\"{subsystem}\", ");
        assert!(lines.iter().any(|line| line.starts_with(&start) && line.contains(&format!("GROUP=\"{group}\""))));
    }
}

/// Whether files of the machine are missing, empty, nonsense, endless, without rights or no files: `list` and `doctor` give a
/// report, and never panic.
#[test]
fn files_of_any_kind_in_sysfs_never_cause_a_panic() {
    type Spoil = fn(&FakeMachine, &str);
    let spoils: [(&str, Spoil); 6] = [
        ("missing", |_, _| {}),
        ("empty", |tree, file| tree.file(file, "")),
        ("nonsense", |tree, file| {
            tree.file(file, [&b"\xff\x1b[2J-99999999999999999999\0\n"[..], &[0x07; 300]].concat())
        }),
        ("endless", |tree, file| tree.file(file, vec![b'1'; (1 << 20) + 1])),
        ("not for this user", |tree, file| {
            tree.file(file, "1\n");
            tree.deny(file);
        }),
        ("a folder", |tree, file| tree.dir(file)),
    ];
    let tree = FakeMachine::good();
    tree.process(9, "demo", "/dev/bus/usb/001/004");
    let files = tree.files();
    assert!(files.len() > 25, "{files:?}");
    for (name, spoil) in spoils {
        let tree = FakeMachine::good();
        tree.process(9, "demo", "/dev/bus/usb/001/004");
        for file in &files {
            tree.remove(file);
            spoil(&tree, file);
        }
        reads(&tree, &format!("all files are {name}"));
    }
    for file in &files {
        let tree = FakeMachine::good();
        tree.process(9, "demo", "/dev/bus/usb/001/004");
        tree.remove(file);
        tree.file(file, b"\xff\x1b[2J-99999999999999999999\0\n");
        reads(&tree, &format!("nonsense in {file}"));
    }
}

/// The tool does not wait for a pipe without a writer.
#[test]
fn a_pipe_in_place_of_a_file_is_not_waited_for() {
    let tree = FakeMachine::good();
    tree.remove("/sys/bus/usb/devices/1-1/speed");
    let pipe = tree.path("/sys/bus/usb/devices/1-1/speed");
    let made = std::process::Command::new("mkfifo").arg(pipe).status().expect("it starts");
    assert!(made.success());
    assert_eq!(tree.finding("usb:", "usb-speed")["state"], "wrong");
}

fn reads(tree: &FakeMachine, how: &str) {
    for words in [&["doctor", "--quick"][..], &["doctor", "--quick", "--json"], &["list"], &["list", "--json"]] {
        let ran = tree.run(words);
        assert!(matches!(ran.code, Some(0 | 1)), "{how}: {words:?}: {ran:?}");
        assert!(!ran.out.contains('\x1b') && !ran.err.contains("panicked"), "{how}: {words:?}: {ran:?}");
        if words.contains(&"--json") {
            json_lines(&ran.out);
        }
    }
}
