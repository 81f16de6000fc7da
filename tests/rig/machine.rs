//! `ecmsk list` and `ecmsk doctor` on a real kernel.

use std::process::Command;

use ecmsk::link::{self, Share};
use ecmsk::machine::findings::FindingVerdict;
use ecmsk::machine::{Access, Machine};
use serde_json::Value;

use support::served::{Board, Served, TOOL, attach, detach_all, until};

/// The tool's output, one object per line. It runs as root here.
#[track_caller]
fn objects(arguments: &[&str]) -> Vec<Value> {
    let output = Command::new(TOOL).args(arguments).output().expect("the tool starts");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

/// A board's data in sysfs agree with the kernel's other interfaces, and the link in the list opens it.
#[test]
fn a_board_is_found_by_sysfs() {
    let _served = Served::start(&["sim:?name=a", "sim:?name=b"], &["--serial", "XYZ"]);
    let (first, second) = (attach("1-1"), attach("1-2"));
    let devices = Machine::here().usb_devices();
    let mut serials: Vec<_> = devices.iter().map(|device| device.serial.clone().unwrap_or_default()).collect();
    serials.sort();
    assert_eq!(serials, ["1-2", "XYZ"]);
    for board in [&first, &second] {
        let path = board.usb.file_name().and_then(|name| name.to_str()).expect("a name");
        let device = devices.iter().find(|device| device.path == path).expect("it is found");
        assert_eq!(
            (device.interface.map(|interface| (interface.input, interface.output)), device.is_high_speed()),
            (Ok((0x81, 0x02)), true)
        );
        assert_eq!((device.configured, device.authorized, device.over_current), (true, true, 0));
        assert_eq!(device.hidraw, [board.node.display().to_string()]);
        let [driver] = &device.drivers[..] else { panic!("{:?}", device.drivers) };
        assert_eq!(driver.name, "usbhid");
        let node = device.node.as_ref().expect("it has one");
        assert_eq!(Machine::here().access(node), Access::Granted, "{node}");
        let opened =
            link::open(&device.link(), Share::ByName).unwrap_or_else(|error| panic!("{}: {error}", device.path));
        opened.close();
    }
    detach_all();
    // A device is taken down in steps, which sysfs shows.
    until("none is left", || Machine::here().usb_devices().is_empty().then_some(()));
}

/// A board that a program has open, by libusb or by hidraw, is reported with that program.
#[test]
fn who_has_a_board_is_named() {
    let _served = Served::start(&["sim:"], &[]);
    attach("1-1");
    let row = || objects(&["list", "--json"]).into_iter().find(|row| row["scheme"] == "usb").expect("it is listed");
    let free = row();
    assert_eq!((&free["can_open"], &free["also_wrong"]), (&true.into(), &Value::Array(Vec::new())), "{free}");
    let us = format!("PID {}", std::process::id());
    let held = |row: &Value| row["reason"].as_str().is_some_and(|why| why.contains(&us)) && row["can_open"] == false;
    let opened = link::open("usb:", Share::ByName).expect("it opens");
    let by_us = row();
    assert!(held(&by_us), "{by_us}");
    opened.close();
    drop(opened);
    // The kernel's driver has it again.
    let board = until("it has hidraw again", || Board::all().pop());
    let hidraw = std::fs::File::options().read(true).write(true).open(&board.node).expect("it opens");
    let by_us = row();
    assert!(held(&by_us), "{by_us}");
    drop(hidraw);
    assert_eq!(row()["can_open"], true);
    detach_all();
}

/// On a machine with a board no problem of USB is reported, and limits and timers are known.
#[test]
fn the_guest_is_checked() {
    let _served = Served::start(&["sim:"], &[]);
    attach("1-1");
    let findings = Machine::here().findings(None);
    let state = |check: &str| {
        let found = findings.iter().find(|finding| finding.check == check);
        found.map(|finding| finding.verdict).unwrap_or_else(|| panic!("{check}: {findings:?}"))
    };
    for check in
        ["usb", "usb-configuration", "usb-permission", "usb-holder", "usb-speed", "usb-autosuspend", "usb-power"]
    {
        assert_eq!(state(check), FindingVerdict::Fine, "{check}: {findings:?}");
    }
    assert_eq!(
        (state("realtime-priority"), state("locked-memory")),
        (FindingVerdict::Fine, FindingVerdict::Fine),
        "root"
    );
    let said = objects(&["doctor", "--json"]);
    assert!(said.iter().any(|finding| finding["check"] == "wake-up"), "{said:?}");
    detach_all();
}
