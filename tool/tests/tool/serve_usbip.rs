//! `ecmsk serve usbip`: its output, its errors, its end.
#![cfg(target_os = "linux")]

use crate::common::serving::Serving;
use crate::common::{Ran, ecmsk, without_times};
use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use rustix::process::Signal;
use support::usbip_client::{Client, Reply};

/// A client of the first board.
fn attached(serving: &Serving) -> Client {
    Client::attached(serving.address().parse().expect("an address"))
}

fn run(arguments: &[&str]) -> Ran {
    ecmsk([&["serve", "usbip"][..], arguments].concat()).output().expect("the tool starts").into()
}

/// The output has the address, what is served, and the clients that come and go; a signal ends the server in an orderly way. A
/// link without `queue=` gets a queue of one report.
#[test]
fn serve_usbip_says_what_it_serves_and_who_attaches() {
    for (signal, name) in [(Signal::INT, "SIGINT"), (Signal::TERM, "SIGTERM")] {
        let mut serving = Serving::start("usbip", &["--link", "sim:?slaves=io", "--link", "sim:?name=b&queue=7"]);
        assert_eq!(serving.next_line(), "1-1 sim:?slaves=io&queue=1\n");
        assert_eq!(serving.next_line(), "1-2 sim:?name=b&queue=7\n");
        let mut client = attached(&serving);
        let given = client.give(&[0; 512]);
        assert_eq!(client.reply(), Reply::done(given, 512));
        let host = client.stream.local_addr().expect("it is connected");
        let said = without_times(&serving.end_by(signal));
        let expected = format!(
            "serve: 1-1: attached by {host}\nserve: stopped by {name}\nserve: 1-1: the server stops; 1 frames out, 0 \
             reports in\n"
        );
        assert_eq!(said, expected);
        assert!(client.is_cut());
    }
}

/// The USB device descriptors have the serial number and the names that the options set.
#[test]
fn the_device_has_the_serial_number_and_names_that_were_set() {
    let options = "--vendor 1234 --product 0xabcd --release 0203 --serial S1 --name N --interval 4";
    let mut arguments = vec!["--link", "sim:"];
    arguments.extend(options.split(' '));
    let serving = Serving::start("usbip", &arguments);
    let mut client = attached(&serving);
    let (_, device) = client.control([0x80, 6, 0, 1, 0, 0, 18, 0], &[]);
    assert_eq!(device[8..14], [0x34, 0x12, 0xCD, 0xAB, 0x03, 0x02]);
    let (_, configuration) = client.control([0x80, 6, 0, 2, 0, 0, 41, 0], &[]);
    assert_eq!(configuration[40], 4);
    let (_, serial) = client.control([0x80, 6, 3, 3, 9, 4, 255, 0], &[]);
    assert_eq!(serial, [6, 3, b'S', 0, b'1', 0]);
    serving.end();
}

/// A recording by the served link's `record=` has the frames that the USB host sends.
#[test]
fn what_a_host_sends_is_recorded() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let serving = Serving::start("usbip", &["--link", &format!("sim:?slaves=io&record={}", file.display())]);
    let mut client = attached(&serving);
    for _ in 0..20 {
        let given = client.give(&[0; 512]);
        assert_eq!(client.reply(), Reply::done(given, 512));
    }
    serving.end_by(Signal::INT);
    let recording = Recording::new(std::fs::File::open(&file).expect("it is there"), "run").expect("it is one");
    let frames = recording.filter(|frame| frame.as_ref().expect("it is whole").dir == Dir::Write);
    assert_eq!(frames.count(), 20);
}

/// Any client that reaches the server can use the boards. So an address that other machines reach is refused without
/// `--insecure-anyone`, with the next step, and nothing listens.
#[test]
fn listening_to_others_is_refused() {
    for listen in ["0.0.0.0:0", "192.0.2.1:3240", "[::]:0"] {
        let ran = run(&["--link", "sim:", "--listen", listen]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{ran:?}");
        for part in ["no password", "127.0.0.1", "ssh -N -L", "docs/VIRTUAL-BOARD.md", "--insecure-anyone"] {
            assert!(ran.err.contains(part), "{listen}: no {part}: {ran:?}");
        }
    }
    run(&["--link", "sim:", "--listen", "127.0.0.2:0", "--link", "sim:"]).expect_failure(1, &["in use"], "name=");
}

/// Any client that reaches the server can use the boards. With `--insecure-anyone` a note says so.
#[test]
fn listening_to_others_is_warned_of() {
    let mut serving =
        Serving::by(ecmsk(["serve", "usbip", "--link", "sim:", "--listen", "0.0.0.0:0", "--insecure-anyone"]));
    let line = without_times(&serving.wait_for(""));
    assert!(line.starts_with("note: ") && line.contains("no password"), "{line}");
}

/// Boards that cannot be served are errors with the next step.
#[test]
fn a_board_that_cannot_be_served_is_an_error_with_the_next_step() {
    let listen = ["--listen", "127.0.0.1:0"];
    // No machine has this address (RFC 5737), so listening fails. Of the two lines of standard error the first is the note that
    // other machines reach the address.
    let elsewhere = run(&["--listen", "192.0.2.1:3240", "--insecure-anyone", "--link", "sim:"]);
    assert_eq!((elsewhere.code, elsewhere.err.lines().count()), (Some(1), 2), "{elsewhere:?}");
    assert!(elsewhere.err.contains("cannot listen on 192.0.2.1:3240: "), "{elsewhere:?}");
    assert!(elsewhere.err.contains("; name an address of this machine with `--listen`"), "{elsewhere:?}");
    run(&[&listen[..], &["--link", "sim:?clock=virtual"]].concat()).expect_failure(
        1,
        &["virtual clock"],
        "clock=virtual",
    );
    run(&[&listen[..], &["--link", "sim:", "--link", "sim:"]].concat()).expect_failure(1, &["in use"], "name=");
    run(&["--link", "sim:?slaves=whale"]).expect_misuse(&["slaves"]);
    run(&["--link", "sim:", "--vendor", "12345"]).expect_misuse(&["allowed: 0000 to ffff"]);
    run(&["--link", "sim:", "--interval", "17"]).expect_misuse(&["17"]);
    run(&[]).expect_misuse(&["--link"]);
    if !std::path::Path::new(ecmsk::port::usbip::VHCI).exists() {
        run(&[&listen[..], &["--link", "sim:", "--attach"]].concat()).expect_failure(
            1,
            &["vhci_hcd"],
            "modprobe vhci-hcd",
        );
    }
}
