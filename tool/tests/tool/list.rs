//! `ecmsk list` on machines of files: which boards there are, and why some cannot be opened.
#![cfg(target_os = "linux")]

use crate::common::machine::{BOARD, FakeMachine, RELAY, page_block};
use crate::common::{Ran, json_lines};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use serde_json::Value;

/// Standard error, without the notes on links that this build cannot open.
fn notes(ran: &Ran) -> String {
    ran.err
        .lines()
        .filter(|line| !line.starts_with("note: this build has no "))
        .map(|line| format!("{line}\n"))
        .collect()
}

/// Checks the exit code of `list`: 0 if this build can open links of the scheme, otherwise 1, with a note that says so.
fn opens(ran: &Ran, scheme: Scheme) {
    let missing = ran.err.contains(&format!("note: this build has no {scheme}: links; {}", scheme.instead()));
    assert_eq!((ran.code, missing), (Some(i32::from(!scheme.in_build())), !scheme.in_build()), "{ran:?}");
}

fn row(tree: &FakeMachine, path: &str) -> Value {
    let rows = json_lines(&tree.run(&["list", "--json"]).out);
    rows.into_iter().find(|row| row["path"] == path).unwrap_or_else(|| panic!("{path} is not in the list"))
}

/// A machine with boards of every kind: one that can be opened, one without rights, a slow one, one that sleeps; also another
/// device with the same USB ids, and SPI devices.
fn several() -> FakeMachine {
    let tree = FakeMachine::good();
    tree.hub("1-2", "e0");
    tree.board("1-2.3", 5, "8");
    tree.deny("/dev/bus/usb/001/005");
    tree.remove("/etc/udev/rules.d/60-ecmsk.rules");
    tree.board("1-3", 6, "9");
    tree.usb("1-3", "speed", "12");
    tree.usb("1-3", "power/control", "auto");
    tree.device("1-4", 7, &RELAY);
    tree.usb("1-4", "product", "Relay");
    tree.device("2-1", 8, &BOARD);
    tree.process(812, "old_program", "/dev/bus/usb/001/008");
    tree.spi("spidev0.1");
    tree.deny("/dev/spidev0.1");
    tree
}

/// `list` shows every board with its link, the reason why it cannot be opened, and what to do; it shows other devices with the
/// reason why they are no boards. It does so as text and as JSON.
#[test]
fn boards_of_every_kind() {
    let tree = several();
    let text = tree.run(&["list"]);
    let json = tree.run(&["list", "--json"]);
    for ran in [&text, &json] {
        assert_eq!((ran.code, notes(ran).as_str()), (Some(1), ""), "{ran:?}");
    }
    let json = json.out.replace("\"in_build\":true", "\"in_build\":false");
    support::snapshot("tool_list", &format!("{}\n{json}", text.out));
}

/// `list` prints what docs/TOOL-NETWORK.md shows.
#[test]
fn list_prints_what_tool_md_shows() {
    let printed = several().run(&["list"]).out;
    let shown = page_block("usb:?path=1-1 ");
    assert!(shown.len() >= 5, "{shown:?}");
    for line in shown {
        assert!(printed.lines().any(|printed| printed == line), "`{line}` is not in\n{printed}");
    }
}

/// Every link that `list` prints is valid.
#[test]
fn every_link_that_is_listed_can_be_parsed() {
    let links: Vec<String> = json_lines(&several().run(&["list", "--json"]).out)
        .iter()
        .filter_map(|row| row["link"].as_str().map(str::to_owned))
        .collect();
    let expected = [
        "usb:?path=1-1",
        "usb:?path=1-2.3",
        "usb:?path=1-3",
        "usb:?path=2-1",
        "spi:/dev/spidev0.0",
        "spi:/dev/spidev0.1",
    ];
    assert_eq!(links, expected);
    for link in links {
        assert_eq!(LinkUri::parse(&link).expect("a link").to_string().split('&').next(), Some(link.as_str()));
    }
}

/// The exit code is 0 if each present board can be opened; an SPI device counts if there is no board on USB.
#[test]
fn the_exit_code_is_0_if_every_board_can_be_opened() {
    let tree = FakeMachine::bare();
    let ran = tree.run(&["list"]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""));
    assert!(ran.err.starts_with("note: no board on USB and no SPI device; plug it in, set CONFIG0 to USB"), "{ran:?}");
    assert_eq!(tree.run(&["list", "--json"]).out, "");

    tree.device("1-4", 7, &RELAY);
    let ran = tree.run(&["list"]);
    assert_eq!(ran.code, Some(1));
    assert!(
        ran.out.starts_with("-  a device at 1-4: no board: its HID interface has no interrupt endpoints"),
        "{ran:?}"
    );
    assert!(ran.err.starts_with("note: no board on USB"), "{ran:?}");

    tree.spi("spidev0.0");
    opens(&tree.run(&["list"]), Scheme::Spi);
    tree.board("1-1", 4, "7");
    opens(&tree.run(&["list"]), Scheme::Usb);
    tree.deny("/dev/spidev0.0");
    opens(&tree.run(&["list"]), Scheme::Usb);
    tree.deny("/dev/bus/usb/001/004");
    assert_eq!(tree.run(&["list"]).code, Some(1));
}

/// `list` names each reason why a board cannot be opened, with what to do.
#[test]
fn each_thing_that_keeps_a_board_from_being_opened_is_named() {
    type Change = fn(&FakeMachine);
    const CHANGES: [(Change, &str, &str); 8] = [
        (|tree| tree.deny("/dev/bus/usb/001/004"), "may not open /dev/bus/usb/001/004", "plug the board in again"),
        (|tree| tree.remove("/dev/bus/usb/001/004"), "there is no /dev/bus/usb/001/004", "/dev/bus/usb"),
        (|tree| tree.remove("/sys/bus/usb/devices/1-1/devnum"), "does not say where it is", "plug it in again"),
        (|tree| tree.usb("1-1", "authorized", "0"), "does not allow the device", "devices/1-1/authorized"),
        (
            |tree| tree.usb("1-1", "bConfigurationValue", ""),
            "does not give the power (it asks for 100mA)",
            "power supply",
        ),
        (|tree| tree.driver("1-1", "usbfs"), "a program that this user cannot see has it", "sudo ecmsk doctor"),
        (|tree| tree.process(7, "demo", "/dev/hidraw4"), "another program has it: PID 7 (demo)", "ecmsk serve tcp"),
        (
            |tree| {
                tree.remove("/sys/bus/usb/devices/1-1/driver");
                tree.link("/sys/bus/usb/devices/1-1/driver", "../../drivers/usbip-host");
            },
            "given to another machine by usbip",
            "sudo usbip unbind -b 1-1",
        ),
    ];
    for (change, reason, next) in CHANGES {
        let tree = FakeMachine::good();
        let fine = row(&tree, "1-1");
        assert_eq!(
            (&fine["can_open"], &fine["reason"], &fine["next"]),
            (&true.into(), &Value::Null, &Value::Array(vec![]))
        );
        change(&tree);
        let found = row(&tree, "1-1");
        assert_eq!((&found["can_open"], &found["board"]), (&false.into(), &true.into()), "{reason}: {found}");
        assert!(found["reason"].as_str().is_some_and(|text| text.contains(reason)), "{reason}: {found}");
        assert!(found["next"][0].as_str().is_some_and(|text| text.contains(next)), "{next}: {found}");
        let text = tree.run(&["list"]).out;
        assert!(text.contains("cannot be opened: ") && text.contains("\n") && text.contains("  do: "), "{text}");
    }
}

/// A device whose files are missing or nonsense is shown with its known data; its texts do not control the terminal.
#[test]
fn a_device_with_nonsense_in_its_files_is_shown_as_far_as_it_is_known() {
    let tree = FakeMachine::bare();
    tree.board("1-1", 4, "\x1b[2J7");
    assert_eq!(row(&tree, "1-1")["serial"], "\u{FFFD}[2J7");
    assert!(!tree.run(&["list"]).out.contains('\x1b'));
    tree.file("/sys/bus/usb/devices/1-1/descriptors", &BOARD[..40]);
    assert_eq!(row(&tree, "1-1")["board"], false);
    tree.file("/sys/bus/usb/devices/1-1/descriptors", [0xFF; 4000]);
    assert_eq!(row(&tree, "1-1")["reason"], "its descriptors cannot be read");
    tree.usb("1-1", "idVendor", "nonsense");
    assert_eq!(tree.run(&["list", "--json"]).out, "");
}

/// `list` works on the machine of the test, too, whatever devices it has.
#[test]
fn list_works_on_the_machine_it_runs_on() {
    let ran = crate::common::run(["list", "--json"]);
    assert!(matches!(ran.code, Some(0 | 1)), "{ran:?}");
    for row in json_lines(&ran.out) {
        assert_eq!(row["verb"], "list", "{row}");
    }
}
