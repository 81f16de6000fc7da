//! `ecmsk bus` on simulated slaves in virtual time, one command line at a time; the output is kept in
//! `tests/snapshots/`.

use ecmsk::ethercat::sii::checksum;

use crate::common::board::{file, text, transcript, transcript_entry};
use crate::common::{json_lines, run};

/// The link of the tests: two drives, a stepper and an IO slave.
const NETWORK: &str = "sim:?slaves=drive*2,dp3cl,io";

/// A file without an end.
const ENDLESS: &str = "/dev/zero";

/// `bus scan` and `bus dc` print the slaves and their clocks, as text and as JSON.
#[test]
fn scan_and_dc_show_slaves_and_clocks() {
    support::snapshot(
        "tool_bus",
        &transcript(&[
            &["bus", "scan", "--link", NETWORK],
            &["bus", "scan", "--link", "sim:?slaves=drive,io", "--json"],
            &["bus", "dc", "--link", NETWORK],
            &["bus", "dc", "--seconds", "1", "--link", "sim:?slaves=drive*2", "--json"],
            &["bus", "dc", "--link", "sim:?slaves=io"],
            &["bus", "scan", "--link", "xf-sim:?slaves=drive,io"],
        ]),
    );
}

/// BUS-3.1, BUS-5.1, BUS-8.2 `bus sdo` and `bus foe` read and write objects and files of a slave.
#[test]
fn sdo_and_foe_show_and_write() {
    let missing = file("bus_none").display().to_string();
    let written = text("bus_table.csv", "1;2;3\n");
    let out = file("bus_read.csv").display().to_string();
    let lines = transcript(&[
        &["bus", "sdo", "list", "4", "--link", NETWORK],
        &["bus", "sdo", "list", "4", "--entries", "--link", NETWORK, "--json"],
        &["bus", "sdo", "dump", "4", "--link", NETWORK],
        &["bus", "sdo", "dump", "4", "--link", NETWORK, "--json"],
        &["bus", "sdo", "read", "1", "statusword", "--link", NETWORK],
        &["bus", "sdo", "read", "1", "0x1018", "--complete", "--link", NETWORK, "--json"],
        &["bus", "sdo", "read", "4", "0x1000", "--type", "u8", "--link", NETWORK],
        &["bus", "sdo", "write", "1", "0x6099:1", "50000", "--link", NETWORK],
        &["bus", "sdo", "write", "1", "statusword", "1", "--link", NETWORK],
        &["bus", "sdo", "read", "1", "0x5555", "--link", NETWORK],
        &["bus", "sdo", "read", "5", "statusword", "--link", NETWORK],
        &["bus", "foe", "write", "1", &written, "--name", "table.csv", "--link", NETWORK, "--json"],
        &["bus", "foe", "read", "1", "firmware", "--link", NETWORK],
        &["bus", "foe", "read", "2", "firmware", "--output", &out, "--link", NETWORK],
        &["bus", "foe", "read", "1", "none", "--link", NETWORK],
        &["bus", "foe", "write", "1", &written, "--name", "firmware", "--link", NETWORK],
        &["bus", "foe", "read", "3", "firmware", "--link", NETWORK],
        &["bus", "foe", "write", "1", &missing, "--link", NETWORK],
        &["bus", "foe", "write", "1", ENDLESS, "--link", NETWORK],
        &["bus", "sii", "write", "1", ENDLESS, "--link", NETWORK],
        &["bus", "sdo", "list", "2", "--link", "xf-sim:?slaves=drive,io"],
        &["bus", "foe", "write", "1", &written, "--name", "table.csv", "--link", "xf-sim:?slaves=drive,io"],
        &["bus", "foe", "read", "2", "firmware", "--link", "xf-sim:?slaves=drive,io"],
    ]);
    let lines = lines.replace(&written, "TABLE").replace(&out, "OUT").replace(&missing, "NONE");
    support::snapshot("tool_bus_sdo", &lines);
    assert_eq!(std::fs::read(file("bus_read.csv")).expect("it is written"), b"firmware of a simulated drive\n");
}

/// BUS-4.1 `bus sii` reads and writes EEPROMs. A file that does not fit the slave is refused before the network is opened or
/// anything is written.
#[test]
fn sii_reads_checks_and_writes() {
    let good = file("bus_good.bin");
    let path = |file: &std::path::Path| file.display().to_string();
    let reading = ["bus", "sii", "read", "4", "--output", &path(&good), "--link", NETWORK];
    let read = run(reading);
    assert_eq!(read.code, Some(0), "{read:?}");
    let content = std::fs::read(&good).expect("it is written");
    let write = |name: &str, content: &[u8]| {
        let file = file(name);
        std::fs::write(&file, content).expect("it is written");
        file
    };
    let short = write("bus_short.bin", &content[..100]);
    let mut wrong = content.clone();
    wrong[0] ^= 1;
    let wrong = write("bus_wrong.bin", &wrong);
    let cut = write("bus_cut.bin", &content[..140]);
    let mut other = content.clone();
    other[8] = 42;
    other[14] = checksum(other.first_chunk().expect("14 bytes"));
    let alias = write("bus_alias.bin", &other);
    let mut all = transcript_entry(&reading, &read);
    all += &transcript(&[
        &["bus", "sii", "read", "4", "--link", NETWORK, "--json"],
        &["bus", "sii", "write", "4", &path(&good), "--link", NETWORK],
        &["bus", "sii", "write", "4", &path(&alias), "--link", NETWORK],
        &["bus", "sii", "write", "4", &path(&alias), "--yes", "--link", NETWORK],
        &["bus", "sii", "write", "4", &path(&alias), "--yes", "--link", NETWORK, "--json"],
        &["bus", "sii", "write", "3", &path(&good), "--yes", "--link", NETWORK],
        &["bus", "sii", "write", "4", &path(&short), "--yes", "--link", "nic:none"],
        &["bus", "sii", "write", "4", &path(&wrong), "--yes", "--link", "nic:none"],
        &["bus", "sii", "write", "4", &path(&cut), "--yes", "--link", "nic:none"],
        &["bus", "sii", "write", "4", &path(&file("bus_none.bin")), "--link", NETWORK],
    ]);
    let folder = path(good.parent().expect("a folder"));
    let all = all.replace(&folder, "FOLDER").replace(&format!("tool-{}-", std::process::id()), "");
    support::snapshot("tool_bus_sii", &all);
    // With --other-device the slave gets the other device's EEPROM.
    let insisted = run(["bus", "sii", "write", "3", &path(&good), "--yes", "--other-device", "--link", NETWORK]);
    assert!(insisted.code == Some(0) && insisted.out.contains("words written and read back"), "{insisted:?}");
}

/// BUS-7.1, BUS-7.2 `bus errors` names the bad cable, with and without `--watch`; without errors the exit code is 0.
#[test]
fn errors_name_the_bad_cable() {
    let noise = text("bus_noise", "noise 3 40\n");
    let bad = format!("{NETWORK}&script={noise}");
    let cut = text("bus_cut", "at 1500ms cut 3 for 800ms\n");
    let loose = format!("{NETWORK}&script={cut}");
    let all = transcript(&[
        &["bus", "errors", "--link", NETWORK],
        &["bus", "errors", "--link", &bad],
        &["bus", "errors", "--clear", "--link", &bad, "--json"],
        &["bus", "errors", "--watch", "3", "--link", &loose],
        &["bus", "errors", "--watch", "1", "--link", NETWORK],
    ]);
    support::snapshot("tool_bus_errors", &all.replace(&noise, "NOISE").replace(&cut, "CUT"));
    let watched = run(["bus", "errors", "--watch", "2", "--link", &bad, "--json"]);
    assert_eq!(watched.code, Some(1), "{watched:?}");
    let lines = json_lines(&watched.out);
    assert_eq!(lines.iter().filter(|line| line["second"] == 2 && line["slave"] == 3).count(), 1);
    let trouble = lines.last().expect("a line");
    assert_eq!((&trouble["bad"], &trouble["far"]["slave"]), (&"cable".into(), &3.into()), "{trouble}");
}

/// Without a link the error shows an example of one, and no network is simulated. The link of a board, a wrong link and a
/// missing card are errors.
#[test]
fn a_network_is_named_or_there_is_none() {
    for verb in [&["scan"][..], &["dc"], &["errors"], &["sdo", "list", "1"], &["sii", "read", "1"]] {
        let words = [&["bus"], verb].concat();
        run(&words).expect_failure(2, &["no network was named", "--link nic:eth1"], "sim:?slaves=drive*2");
        let board = run([&words[..], &["--link", "usb:"]].concat());
        board.expect_failure(1, &["is a board", "`ecmsk info`"], "nic:eth1");
    }
    run(["bus", "scan", "--link", "sim:?slave=drive"]).expect_misuse(&["slave"]);
    run(["bus", "scan", "--link", "sim:?slaves=none"]).expect_failure(1, &["no slave answers"], "power");
    #[cfg(target_os = "linux")]
    {
        let card = run(["bus", "scan", "--link", "nic:no_card"]);
        assert!(card.code == Some(1) && card.err.contains("no network interface no_card; there are"), "{card:?}");
        let none = run(["bus", "scan", "--link", "nic:"]);
        assert!(none.code == Some(2) && none.err.contains("nic:INTERFACE, e.g. nic:eth1"), "{none:?}");
    }
}

/// A wrong value on the command line is reported before the network is opened.
#[test]
fn a_wrong_value_opens_no_network() {
    for (words, why) in [
        (&["sdo", "write", "1", "0x5555", "1"][..], "the type of 0x5555:0 is not known"),
        (&["sdo", "write", "1", "homing_method", "128"], "128 does not fit"),
        (&["sdo", "write", "1", "0x1018", "1", "--complete"], "all sub-indices at once are bytes"),
        (&["sdo", "read", "0", "0x1000"], "allowed: 1 to 40, or the name of an axis"),
        (&["sdo", "read", "1", "6041"], "did you mean `0x6041`?"),
        (&["errors", "--watch", "1", "--clear"], "--clear"),
        (&["dc", "--seconds", "0"], "0 is not in 1..=86400"),
    ] {
        let ran = run([&["bus"], words, &["--link", "nic:no_card"]].concat());
        ran.expect_misuse(&[why]);
    }
}

/// A cable that is cut in the middle of a dump ends it with the slave's error, after the values that were read.
#[test]
fn a_cut_cable_ends_a_dump() {
    let cut = text("bus_cut_dump", "at 42ms cut 2\n");
    let ran = run(["bus", "sdo", "dump", "2", "--link", &format!("sim:?slaves=io,drive&script={cut}")]);
    ran.expect_failure(1, &["slave 2 does not answer any more"], "check its cable and its power");
    assert!(ran.out.starts_with("0x1000:0 "), "{}", ran.out);
}
