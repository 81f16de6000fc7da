//! `ecmsk xf`: the verbs that talk to a chip, one command line at a time, in virtual time; their output is kept in
//! `tests/snapshots/`. Each gets a new simulated chip; `tool/src/xf/tests.rs` tests verbs on a chip that keeps running.

use std::collections::BTreeSet;

use crate::common::board::transcript;
use crate::common::{ecmsk, json_lines, run};

/// The link of the tests: a chip with two drives and an IO slave on virtual time.
const CHIP: &str = "xf-sim:?slaves=drive*2,io&clock=virtual";

/// XF-18.3, XF-18.5, XF-18.6 `scan`, `info` and `state` show the chip and its slaves, as text and as JSON.
#[test]
fn scan_info_and_state_show_chip_and_slaves() {
    support::snapshot(
        "tool_xf",
        &transcript(&[
            &["xf", "scan", "--link", CHIP],
            &["xf", "scan", "--link", "xf-sim:?slaves=drive&clock=virtual&chip_fw=old", "--json"],
            &["xf", "scan", "--link", "xf-sim:?slaves=none&clock=virtual"],
            &["xf", "info", "--link", CHIP],
            &["xf", "info", "--link", "xf-sim:?slaves=none&clock=virtual&chip_fw=old&int0=yes", "--json"],
            &["xf", "state", "--link", CHIP],
            &["xf", "state", "safeop", "--link", CHIP, "--json"],
            &["xf", "state", "preop", "--slave", "1", "--link", CHIP],
            &["xf", "state", "op", "--slave", "1", "--link", CHIP],
            &["xf", "state", "--slave", "3", "--link", CHIP],
        ]),
    );
}

/// XF-18.1 Without a link the error shows an example of one, and no chip is simulated. The link of a board and a wrong link are
/// errors.
#[test]
fn a_chip_is_named_or_there_is_none() {
    for verb in ["scan", "info", "state"] {
        let none = run(["xf", verb]);
        none.expect_failure(2, &["no chip was named", "xf-sim:?slaves=drive*2"], "xf-sim:");
        run(["xf", verb, "--link", "sim:?slaves=drive"]).expect_failure(
            1,
            &["is a board and not an ECM-XF"],
            "link help",
        );
        run(["xf", verb, "--link", "xf-sim:?slave=drive"]).expect_misuse(&["slave"]);
    }
    let mut by_variable = ecmsk(["xf", "scan", "--json"]);
    let ran = crate::common::Ran::from(by_variable.env("ECMSK_LINK", CHIP).output().expect("the tool starts"));
    assert_eq!((ran.code, json_lines(&ran.out).len()), (Some(0), 3), "{ran:?}");
}

/// XF-11.75 The key `script=` has an effect with `xf` and `serve xf`, or the link is refused; `use_n=` of an ECM-XFU is
/// refused, too.
#[test]
fn what_a_link_says_happens_or_it_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("refuse.ecmscript");
    std::fs::write(&script, "refuse 2 safeop\n").expect("it is written");
    let link = format!("{CHIP}&script={}", script.display());
    let ran = run(["xf", "state", "safeop", "--link", &link]);
    assert!(ran.code == Some(1) && ran.err.contains("slave 1"), "{ran:?}");
    for verb in [&["xf", "scan"][..], &["serve", "xf", "--listen", "127.0.0.1:0"]] {
        let link = format!("{CHIP}&script=/nowhere/at/all");
        let ran = run([verb, &["--link", &link]].concat());
        ran.expect_failure(1, &["cannot read the script /nowhere/at/all"], "name another file");
        let ran = run([verb, &["--link", "xf-sim:?clock=virtual&chip_fw=xfu&use_n=112"]].concat());
        assert!(ran.code.is_some_and(|code| code > 0) && ran.err.contains("an ECM-XFU has 992"), "{ran:?}");
    }
}

/// XF-18.7, XF-18.9 An unknown verb is answered with the list of verbs, a slave that is no number with the allowed
/// values.
#[test]
fn what_there_is_is_named() {
    for (words, verbs) in [
        (&["xf", "sdo", "1", "0x6041"][..], "`ecmsk xf sdo` has the verbs read, write"),
        (&["xf", "gpio", "3"], "`ecmsk xf gpio` has the verbs mode, set"),
        (
            &["xf", "slaves"],
            "`ecmsk xf` has the verbs commands, scan, info, sdo, pdo, state, gpio, adc, dac, encoder, raw",
        ),
    ] {
        run(words).expect_misuse(&[verbs]);
        run([words, &["--json"]].concat()).expect_misuse(&[verbs]);
    }
    for words in [&["xf", "state", "--slave", "x"][..], &["xf", "sdo", "read", "128", "0x6041"], &["xf", "pdo", "-1"]] {
        let ran = run(words);
        assert!(ran.code == Some(2) && (ran.err.contains("allowed: 0 to 127") || words.contains(&"-1")), "{ran:?}");
    }
}

/// XF-18.2 `xf commands` lists the 91 functions of the chip, as text and as JSON. It needs no chip.
#[test]
fn commands_are_listed() {
    let text = run(["xf", "commands"]).expect_quiet();
    assert_eq!(text.lines().count(), 91);
    let line = |code: &str| text.lines().find(|line| line.split(' ').next() == Some(code)).expect("a line");
    let words = line("12").split_whitespace().collect::<Vec<_>>();
    assert_eq!(words[..5], ["12", "ECM_CMD_ECAT_STATE_SET", "StateSet", "takes", "time"]);
    assert!(
        line("31:6").contains("ECM_GpioIntClear") && line("31:6").contains("from firmware 9 on"),
        "{}",
        line("31:6")
    );
    assert!(line("143").contains("by parameter") && line("0").contains("at once"));

    let lines = json_lines(&run(["xf", "commands", "--json"]).expect_quiet());
    let types: BTreeSet<_> = lines.iter().map(|line| line["type"].as_str().expect("a name")).collect();
    assert_eq!((lines.len(), types.len()), (91, 91));
    let set = lines.iter().find(|line| line["type"] == "StateSet").expect("a line");
    assert_eq!((&set["code"], &set["immediate"]), (&12.into(), &false.into()));
    assert_eq!(set["fields"], serde_json::json!(["slaves", "state"]));
    assert_eq!((&set["parameter"], &set["since_firmware"]), (&serde_json::Value::Null, &serde_json::Value::Null));
    let clear = lines.iter().find(|line| line["type"] == "GpioIntClearExt").expect("a line");
    assert_eq!((&clear["parameter"], &clear["since_firmware"]), (&6.into(), &9.into()));
}

/// XF-18.7 Objects are read and written by number or name, with the types of the tool's other verbs; all sub-indices at
/// once; abort codes are shown in words. A network that is not up is started, with a note.
#[test]
fn sdo_reads_and_writes_objects() {
    support::snapshot(
        "tool_xf_sdo",
        &transcript(&[
            &["xf", "sdo", "read", "0", "statusword", "--link", CHIP],
            &["xf", "sdo", "read", "1", "0x1018", "--complete", "--link", CHIP],
            &["xf", "sdo", "read", "1", "0x1018:1", "--link", CHIP, "--json"],
            &["xf", "sdo", "read", "2", "0x1008", "--link", CHIP],
            &["xf", "sdo", "read", "0", "0x60C2:1", "--link", CHIP],
            &["xf", "sdo", "read", "0", "0x1000", "--type", "u8", "--link", CHIP],
            &["xf", "sdo", "write", "0", "0x6099:1", "50000", "--link", CHIP],
            &["xf", "sdo", "write", "0", "homing_method", "-1", "--link", CHIP, "--json"],
            &["xf", "sdo", "write", "0", "0x6099:1", "hex:50C30000", "--link", CHIP],
            &["xf", "sdo", "read", "0", "0x5555", "--link", CHIP],
            &["xf", "sdo", "write", "0", "statusword", "1", "--link", CHIP],
            &["xf", "sdo", "read", "3", "statusword", "--link", CHIP],
        ]),
    );
}

/// XF-18.7 A wrong value is reported before a chip is opened.
#[test]
fn a_wrong_value_opens_no_chip() {
    for (words, why) in [
        (&["write", "0", "0x5555", "1"][..], "the type of 0x5555:0 is not known"),
        (&["write", "0", "homing_method", "128"], "128 does not fit"),
        (&["write", "0", "0x1018", "1", "--complete"], "all sub-indices at once are bytes"),
        (&["write", "0", "0x5555", "hex:123"], "two hexadecimal digits"),
        (&["write", "0", "0x5555", "x"], "bytes as hex:0102FF"),
        (&["read", "128", "0x1000"], "allowed: 0 to 127"),
        (&["read", "0", "0x1000", "--complete", "--type", "u8"], "--complete"),
        (&["read", "0", "6041"], "did you mean `0x6041`?"),
    ] {
        // `sim:` is no link to a chip. If the tool tried to open it, it would report that instead of the wrong value.
        let ran = run([&["xf", "sdo"], words, &["--link", "sim:"]].concat());
        ran.expect_misuse(&[why]);
    }
}

/// XF-18.8 `xf pdo` shows the layout of the process data by slave and object, with the present inputs.
#[test]
fn pdo_shows_objects_and_inputs() {
    support::snapshot(
        "tool_xf_pdo",
        &transcript(&[
            &["xf", "pdo", "--link", CHIP],
            &["xf", "pdo", "2", "--link", CHIP, "--json"],
            &["xf", "pdo", "3", "--link", CHIP],
        ]),
    );
}

/// XF-18.9 `xf gpio`, `adc`, `dac` and `encoder` read and set the chip's own inputs and outputs.
#[test]
fn units_are_read_and_set() {
    support::snapshot(
        "tool_xf_units",
        &transcript(&[
            &["xf", "gpio", "--link", CHIP],
            &["xf", "gpio", "--link", CHIP, "--json"],
            &["xf", "gpio", "mode", "0,4-7,16", "output", "--link", CHIP],
            &["xf", "gpio", "mode", "3", "open-drain", "--pull", "up", "--link", CHIP, "--json"],
            &["xf", "gpio", "set", "0x10010", "--link", CHIP],
            &["xf", "adc", "--link", CHIP],
            &["xf", "adc", "--differential", "--link", CHIP, "--json"],
            &["xf", "dac", "1.65V", "--link", CHIP],
            &["xf", "dac", "off", "--link", CHIP, "--json"],
            &["xf", "encoder", "--link", CHIP],
            &["xf", "encoder", "start", "--mode", "x2-free", "--link", CHIP, "--json"],
            &["xf", "encoder", "stop", "--link", CHIP],
        ]),
    );
    for (words, why) in [
        (&["gpio", "mode", "20", "output"][..], "pins from 0 to 19"),
        (&["gpio", "mode", "0", "out"], "allowed: input, output, open-drain, quasi-bidirectional"),
        (&["gpio", "set", "0x100000"], "allowed: 0 to 0xFFFFF"),
        (&["dac", "5V"], "allowed: 0 to 4095 for 0 V to 3.3 V, or off"),
        (&["encoder", "start", "--mode", "x3"], "allowed: x4-free, x2-free"),
    ] {
        run([&["xf"], words, &["--link", CHIP]].concat()).expect_misuse(&[why]);
    }
}

/// XF-18.10 Any function is run by its name, and its answer is shown by fields.
#[test]
fn raw_runs_functions_and_shows_answers_by_fields() {
    let raw = |words: &'static [&'static str]| [&["xf", "raw"], words, &["--link", CHIP]].concat();
    let lines = [
        raw(&["FW_VERSION_GET"]),
        raw(&["ECM_CMD_ECAT_INT_GET_ENABLE", "--json"]),
        raw(&["CoeEmergency", "count=2"]),
        raw(&["ECAT_STATE_GET", "slaves=all"]),
        raw(&["ECAT_SLV_CNT_GET", "--json"]),
        raw(&["ECAT_INIT_OP", "sync0_ns=1000000", "reserve=lrw", "--json"]),
        raw(&["ECM_GpioGetValue"]),
        raw(&["FIFO_ENABLE", "on=off"]),
        raw(&["SDO_ABORTCODE_GET"]),
        raw(&["MDIO", "operation=read", "phy=0", "register=1"]),
        raw(&["PDO_DATA_OP", "operation=read,valid"]),
        raw(&["402_STATE_GET", "motor=0"]),
        raw(&["CRC_TYPE_SET", "kind=fixed"]),
        raw(&["WARM_RESET"]),
        raw(&["STATE_SET", "slaves=all"]),
        raw(&["STATE_SIT"]),
    ];
    let lines: Vec<&[&str]> = lines.iter().map(Vec::as_slice).collect();
    support::snapshot("tool_xf_raw", &transcript(&lines));
}

/// XF-18.10 Each function of `commands` is one that `raw` knows, by either name; for a name that the manuals give to
/// two functions, the error lists the types to choose from.
#[test]
fn raw_knows_each_function_of_the_list() {
    let commands = json_lines(&run(["xf", "commands", "--json"]).expect_quiet());
    let name = |n: usize, key: &str| commands[n][key].as_str().expect("a name").to_owned();
    for n in 0..commands.len() {
        for key in ["type", "name"] {
            // A wrong field is an error that lists the fields of the function. It comes after the name was found, so a name
            // that is not known would give another error.
            let ran = run(["xf", "raw", &name(n, key), "wrong=1"]);
            let several = commands.iter().filter(|row| row["name"] == commands[n]["name"]).count() > 1;
            if key == "name" && several {
                ran.expect_misuse(&["several functions", &name(n, "type")]);
                continue;
            }
            ran.expect_misuse(&["there is no field `wrong`", &name(n, "type")]);
            for field in commands[n]["fields"].as_array().expect("names") {
                assert!(ran.err.contains(&format!("{}=", field.as_str().expect("a name"))), "{}", ran.err);
            }
        }
    }
}
