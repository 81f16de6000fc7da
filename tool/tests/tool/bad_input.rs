//! Errors of verbs that talk to a board: wrong options, and faults of the network, the axes or the board.
#![cfg(target_os = "linux")]

use crate::common::board::{BOARD, script, text};
use crate::common::run;

/// A verb with a wrong option ends as with any wrong command line, with exit code 2, and says why.
#[test]
fn a_wrong_option_is_a_wrong_command_line() {
    for (words, why) in [
        (&["info", "--link", "simm:"][..], "unknown scheme `simm`"),
        (&["info", "--slaves", "motor"], "kind `motor` is unknown; allowed: drive"),
        (&["info", "--slot", "14"], "allowed: 12, 16"),
        (&["info", "--close", "drop"], "allowed: hold, servo-off, leave"),
        (&["info", "--timeout", "soon"], "allowed: a time up to a day"),
        (&["info", "--guard", "0"], "allowed: counts, 1 or more, or off"),
        (&["info", "--counts-per-unit", "0"], "allowed: a number that is not 0"),
        (&["state", "operational"], "allowed: init, preop, safeop, op"),
        (&["servo", "on"], "<AXES>"),
        (&["servo", "on", "0"], "allowed: slaves from 1 to 40"),
        (&["servo", "on", "41"], "allowed: slaves from 1 to 40"),
        (&["home", "1", "--method", "200"], "200 is not in -128..=127"),
        (&["home", "1", "--offset", "3000000000"], "3000000000 is not in"),
        (&["move"], "<AXIS=TARGET>"),
        (&["move", "1=nan"], "allowed: AXIS=TARGET"),
        (&["move", "1=5", "--velocity", "inf"], "allowed: a number above 0"),
        (&["move", "1=5", "--jerk", "-3"], "allowed: a number above 0, or off"),
        (&["sdo", "read", "0", "statusword"], "allowed: 1 to 40, or the name of an axis"),
        (&["sdo", "read", "1", "0x1000", "--type", "f32"], "allowed: u8, i8"),
        (&["sdo", "write", "1", "0x1000", "x"], "allowed: a whole number"),
        (&["io", "41"], "allowed: a slave from 1 to 40, local, or names"),
        (&["io", "lamp=half"], "allowed: lamp=on or lamp=off"),
        (&["io", "3", "--set", "0x10000"], "allowed: 0 to 0xFFFF"),
    ] {
        let ran = run(words);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{words:?}: {ran:?}");
        assert!(ran.err.contains(why), "{words:?}: {}", ran.err);
    }
}

/// A network that differs from `--slaves` and `--cycle-us` is refused: with too many slaves, too few, a slave of another kind,
/// no slave at all, or another cycle time.
#[test]
fn a_network_other_than_described_is_refused() {
    let state = |link: &str, slaves: &str| run(["state", "op", "--link", link, "--slaves", slaves]);
    state(BOARD, "drive*2").expect_failure(
        1,
        &["2 slaves are configured and the board found 3"],
        "check cables and power",
    );
    let ran = state(BOARD, "drive*2,drive");
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("OP was not reached") && ran.err.contains("slave 3 is no DRIVE"), "{}", ran.err);
    let empty = "sim:?slaves=none&clock=virtual";
    run(["state", "op", "--link", empty]).expect_failure(
        1,
        &["no board", "it finds no slave"],
        "give it some with `slaves=`",
    );
    let ran = run(["move", "1=5", "--up", "--link", BOARD, "--slaves", "none*3"]);
    ran.expect_failure(1, &["slave 1 is none"], "or correct --slaves");
    let ran = run(["state", "op", "--link", BOARD, "--cycle-us", "300"]);
    ran.expect_failure(1, &["cycle_us is 300"], "set 250, 500, 1000, 2000 or 4000");
    run(["state", "--link", BOARD, "--slaves", "step:csv*3"]).expect_failure(
        1,
        &["slave 1 is a STEP in CSV"],
        "set its mode to CSP",
    );
    run(["state", "--slot-size", "16", "--link", BOARD]).expect_failure(
        1,
        &["slots of 16 bytes"],
        "leave out --slot-size, or give 12",
    );
    let ran = run(["servo", "on", "all", "--up", "--link", "sim:?slaves=io&clock=virtual"]);
    ran.expect_failure(1, &["the network has no axis"], "correct --slaves");
}

/// Missing slaves, and slaves of another kind, are reported before any frame is sent.
#[test]
fn a_slave_that_is_not_there_or_of_another_kind_is_refused_before_anything_is_sent() {
    for (words, why) in [
        (&["home", "4", "--up"][..], "there is no slave 4; the network is 1 drive, 2 drive, 3 io"),
        (&["servo", "off", "1,3", "--up"], "slave 3 is io; name a drive, step or hsp"),
        (&["move", "4=5", "--up"], "there is no slave 4"),
        (&["io", "1", "--up"], "slave 1 is drive; name an io slave"),
        (
            &["move", "1=5", "--slaves", "drive:csv*2,io", "--up"],
            "axis 1 runs in CSV, not in CSP; leave its mode out of --slaves",
        ),
    ] {
        let ran = run(words.iter().copied().chain(["--link", BOARD]));
        assert_eq!((ran.code, ran.err.lines().count()), (Some(1), 1), "{words:?}: {ran:?}");
        assert!(ran.err.contains(why), "{words:?}: {}", ran.err);
    }
}

/// An SDO may go to slaves that are not described. A missing slave does not answer, and the error says so, as far as
/// the network is known; an abort of a present slave is reported with its code.
#[test]
fn an_sdo_of_a_slave_that_is_not_there_says_so() {
    for words in [&["sdo", "read", "9", "statusword"][..], &["sdo", "write", "9", "0x6099:1", "5"]] {
        let ran = run(words.iter().copied().chain(["--link", BOARD]));
        let network = "there is no slave 9; the network is 1 drive, 2 drive, 3 io, correct the number or --slaves\n";
        assert_eq!((ran.code, ran.err.lines().count()), (Some(1), 1), "{ran:?}");
        assert!(ran.err.ends_with(network) && ran.err.contains(&words[..2].join(" ")), "{}", ran.err);
    }
    let ran = run(["sdo", "read", "3", "0x1000", "--slaves", "drive", "--link", BOARD]);
    assert_eq!(ran.code, Some(0), "whatever --slaves says: {ran:?}");
    let ran = run(["sdo", "read", "1", "0x5555", "--link", BOARD]);
    assert!(ran.err.contains("was aborted with 0x06020000"), "{}", ran.err);
}

/// If no link was named, the error says where one was sought, and why the default does not open.
#[test]
fn without_a_named_link_the_error_says_where_one_was_looked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let tool = |words: &[&str], link: &str| {
        let mut command = crate::common::ecmsk(words);
        command.env("HOME", folder.path()).env_remove("XDG_CONFIG_HOME").env("ECMSK_LINK", link);
        crate::common::Ran::from(command.output().expect("the tool starts"))
    };
    for words in [&["info"][..], &["monitor", "--once"]] {
        let ran = tool(words, "");
        assert_eq!((ran.code, ran.err.lines().count()), (Some(1), 1), "{ran:?}");
        let user = folder.path().join(".config/ecmsk/ecmsk.toml");
        let looked = format!("ecmsk.toml, {}, /etc/ecmsk.toml; and the default does not open: ", user.display());
        let start = "error: no link was given: no --link, ECMSK_LINK is not set, there is no /";
        assert!(ran.err.starts_with(start) && ran.err.contains(&looked), "{}", ran.err);
        let named = tool(words, "usb:?path=77-1");
        assert!(named.code == Some(1) && !named.err.contains("no link was given"), "{}", named.err);
    }
}

/// In Init slaves answer no SDO, and the error says so; `--up` brings the network to PreOP for it and no further.
#[test]
fn in_init_there_are_no_sdos_and_up_goes_to_preop() {
    let ran = script(BOARD, "state init\nsdo read 1 0x1000\n");
    assert!(
        ran.err
            .contains(":2: sdo read needs PreOP, SafeOP or OP, the network is in Init; write `state preop` before it"),
        "{ran:?}"
    );
    let ran = crate::common::run_with_input(
        &["run", "-", "--up", "--link", BOARD],
        "state init\nsdo read 1 0x1000\nexpect state preop\n",
    );
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "Init\n131474 (0x00020192)\n"), "{ran:?}");
}

/// An axis with an alarm is not switched on, homed or moved, also not with `--up`; the error says how to go on, and
/// that works.
#[test]
fn an_axis_with_an_alarm_is_not_switched_on_homed_or_moved() {
    let events = text("fault.ecmscript", "at 10ms alarm 1 0x7500\n");
    let board = format!("{BOARD}&script={events}");
    for verb in ["servo on 1", "home 1", "move 1=5"] {
        let ran = script(&board, &format!("state op\nwait 100ms\n{verb}\n"));
        assert_eq!(ran.code, Some(1));
        let error = ":3: axis 1 has alarm 0x7500: communication; remove the cause (drive's manual), then `servo clear 1` and `servo on 1`\n";
        assert!(ran.err.ends_with(error), "{}", ran.err);
    }
    let ran = script(&board, "state op\nwait 100ms\nservo clear 1\nservo on 1\nmove 1=5\n");
    assert_eq!((ran.code, ran.out.lines().last()), (Some(0), Some("axis 1: at 5")), "{ran:?}");
    let ran = script(&board, "state op\nwait 100ms\nsdo read 1 error_code\n");
    assert_eq!((ran.code, ran.out.lines().last()), (Some(0), Some("29952 (0x7500): communication")), "{ran:?}");
    let stays = text("stays.ecmscript", "at 10ms alarm 1 0x7500 stays\n");
    let ran = script(&format!("{BOARD}&script={stays}"), "state op\nwait 100ms\nservo clear 1\n");
    assert!(ran.err.contains(":3: axis 1 has alarm 0x7500"), "{ran:?}");
}

/// A homing that fails says why, and the axis takes targets again.
#[test]
fn a_homing_that_fails_says_why_and_the_axis_takes_targets_again() {
    let ran = script(BOARD, "state op\nservo on 1\nhome 1 --method 50\n");
    assert!(ran.code == Some(1) && ran.err.contains(":3: "), "{ran:?}");
    let ran = crate::common::run_with_input(
        &["run", "-", "--timeout", "0.5s", "--link", BOARD],
        "state op\nservo on 1\nhome 1 --method 1\n",
    );
    assert!(ran.code == Some(1) && ran.err.contains(":3: homing: not done after 500"), "{ran:?}");
    let nowhere = "sim:?slaves=drive:limits@none:search@5000&clock=virtual";
    let ran = script(nowhere, "state op\nservo on 1\nhome 1 --method 1\n");
    assert!(ran.err.contains(":3: homing of slave 1 failed: the drive reports a homing error"), "{ran:?}");
}

/// A change of state that fails says where it ended; SDOs still work to find the reason, and the state does not change.
#[test]
fn a_change_of_state_that_fails_says_where_it_ended() {
    let events = text("refuse.ecmscript", "refuse 1 op 0x001B\n");
    let board = format!("{BOARD}&script={events}&state_timeout_ms=500");
    let ran = crate::common::run_with_input(
        &["shell", "--keep-going", "--link", &board],
        "state op\nstate\nsdo read 1 0x1000\nmove 1=5\n",
    );
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("error: standard input:1: OP was not reached, the board is in"), "{}", ran.err);
    assert!(ran.err.contains("error: standard input:4: move needs OP, the network is in"), "{}", ran.err);
    let mut lines = ran.out.lines();
    assert!(lines.next().is_some_and(|state| state.contains("SafeOP")), "{}", ran.out);
    assert_eq!((lines.next(), lines.next()), (Some("131474 (0x00020192)"), None));
}
