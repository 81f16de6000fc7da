//! `ecmsk serve gadget`: what it refuses, and the service that runs it. What it does on a controller is in tests/rig.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::Command;

use ecmsk::link::uri::LinkUri;

use crate::common::{Ran, ecmsk};

fn run(arguments: &[&str]) -> Ran {
    ecmsk([&["serve", "gadget"][..], arguments].concat()).output().expect("the tool starts").into()
}

/// A board that cannot be served at a device port is an error with the next step, and no gadget is made.
#[test]
fn a_board_that_cannot_be_shown_is_an_error_with_the_next_step() {
    run(&[]).expect_misuse(&["--link"]);
    run(&["--link", "sim:?slaves=whale"]).expect_misuse(&["slaves"]);
    run(&["--link", "sim:", "--vendor", "12345"]).expect_misuse(&["allowed: 0000 to ffff"]);
    run(&["--link", "sim:", "--interval", "17"]).expect_misuse(&["17"]);
    run(&["--link", "sim:", "--on-vanish", "jump"]).expect_misuse(&["servo-off"]);
    run(&["--link", "sim:", "--priority", "100"]).expect_misuse(&["100"]);
    let long = "x".repeat(127);
    run(&["--link", "sim:", "--serial", &long]).expect_failure(1, &[&long], "126 characters");
    let there = fs::read_dir("/sys/class/udc").is_ok_and(|mut entries| entries.next().is_some());
    if there {
        run(&["--link", "sim:", "--udc", "no_such_udc"]).expect_failure(1, &["no_such_udc"], "--udc");
    } else {
        run(&["--link", "sim:"]).expect_failure(1, &["no USB device controller"], "modprobe dummy_hcd");
    }
}

/// The service of docs/BOARD.md: systemd, where it is installed, accepts its unit. The tool accepts the command line of the
/// unit, with the settings of the template for its configuration file. The service is restarted only after failures.
#[test]
fn the_service_starts_the_tool_with_its_one_configuration_file() {
    let folder = support::root().join("share/systemd");
    let read = |file: &str| fs::read_to_string(folder.join(file)).expect("it is there");
    let (unit, template) = (read("ecmsk-board.service"), read("ecmsk-board.conf"));
    let says = |key: &str| unit.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_else(|| panic!("{key}"));
    assert_eq!((says("EnvironmentFile="), says("Restart=")), ("/etc/ecmsk-board.conf", "on-failure"));
    let lines = template.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
    let settings: Vec<(&str, &str)> = lines.map(|line| line.split_once('=').expect("NAME=VALUE")).collect();
    let value = |name: &str| settings.iter().find(|setting| setting.0 == name).unwrap_or_else(|| panic!("{name}")).1;
    let link = LinkUri::parse(value("ECMSK_LINK")).expect("a link");
    assert_eq!(link.path(), value("BOARD_CARD"));

    // The words of the command line. A word `$NAME` without braces becomes all words of the variable, as systemd does it.
    let words: Vec<&str> = says("ExecStart=")
        .split(' ')
        .flat_map(|word| word.strip_prefix('$').map_or(vec![word], |name| value(name).split(' ').collect()))
        .collect();
    assert_eq!(words[..3], ["ecmsk", "serve", "gadget"]);
    let mut command = ecmsk(words[1..].to_vec());
    // The options are accepted if the tool goes on and refuses the link.
    let ran = Ran::from(command.env("ECMSK_LINK", "sim:?slaves=whale").output().expect("the tool starts"));
    assert!(ran.code != Some(0) && ran.err.contains("whale"), "{ran:?}");

    let copy = tempfile::tempdir().expect("a folder");
    let file = copy.path().join("ecmsk-board.service");
    // `systemd-analyze verify` checks that the programs of a unit exist on this machine, so a program that exists replaces
    // them.
    let there =
        unit.replace("ExecStart=ecmsk", "ExecStart=/bin/true").replace("ExecStartPre=-ip", "ExecStartPre=-/bin/true");
    fs::write(&file, there).expect("a file");
    match Command::new("systemd-analyze").arg("verify").arg(&file).output() {
        Ok(output) => assert!(output.status.success(), "{output:?}"),
        Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::NotFound, "systemd is not installed: {error}"),
    }
}
