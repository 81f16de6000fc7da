//! Whether the card is usable, and its faults.

mod needs_network_namespace {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    use ecmsk::link::{Share, open};
    use masters::{MASTER, Rig, SLAVES};
    use serde_json::{Value, json};

    use crate::card::{CARD, InOp, LIST, doctor, ended, finding, listed, look, run, tool, wait_for};

    /// `list` shows whether a card is free, in use, switched off or of another network, with the link and what to do.
    /// `doctor` reports the same, and measures how long frames take if nothing prevents that. While a program has the
    /// card no verb sends anything there.
    #[test]
    fn list_and_doctor_say_what_the_card_is() {
        let rig = Rig::new("io*2", "tool_card");
        let (text, row) = listed();
        assert!(text.contains("nic:veth0  network card (virtual, ") && text.contains("): can be opened\n"), "{text}");
        assert_eq!((&row["link"], &row["can_open"], &row["up"]), (&json!(CARD), &json!(true), &json!(true)), "{row}");
        assert_eq!(
            (&row["carrier"], &row["address"], &row["reason"]),
            (&json!(true), &Value::Null, &Value::Null),
            "{row}"
        );
        let lines = run(&["list", "--json"]).lines();
        let slaves = lines.iter().find(|row| row["path"] == SLAVES).expect("the slaves' end");
        assert_eq!(slaves["can_open"], false, "its server has it: {slaves}");
        let findings = doctor(CARD);
        let state = |check| finding(&findings, check).map(|finding| finding["state"].clone());
        for check in ["card-fit", "card-use", "raw-frames", "card-cable"] {
            assert_eq!(state(check), Some(json!("ok")), "{findings:?}");
        }
        let figures = finding(&findings, "round-trip").expect("it is measured")["figures"].clone();
        let [p50, p99, max] = ["p50_us", "p99_us", "max_us"].map(|name| figures[name].as_i64().expect("a number"));
        assert!(0 < max && p50 <= p99 && p99 <= max, "{figures}");
        assert_eq!(figures["slaves"], 2, "{figures}");
        let late = finding(&findings, "wake-up").expect("it is measured")["found"].clone();
        assert!(late.as_str().is_some_and(|text| text.contains("however far ahead a program is")), "{late}");
        let quick = ended(tool(&["doctor", "--quick"]).env("ECMSK_LINK", CARD));
        assert!(quick.out.contains("card-use veth0") && !quick.out.contains("round-trip"), "{quick:?}");
        let said = rig.said();
        assert!(!said.iter().any(|line| line.contains("slave")), "nothing has happened to them: {said:?}");

        let board = open(CARD, Share::ByUri).expect("it opens");
        let (text, row) = listed();
        assert!(
            text.contains("cannot be opened: another program of ecmsk has it") && text.contains("do: end that program")
        );
        assert_eq!((&row["can_open"], &row["next"]), (&json!(false), &json!(["end that program"])), "{row}");
        look(&["scan"]).fails(1, &["`nic:veth0` is in use by another program of ecmsk", "end that program"]);
        look(&["sdo", "write", "1", "0x7000:1", "1", "--type", "u16"]).fails(1, &["`nic:veth0` is in use"]);
        let scanned = run(&["list", "--scan", MASTER]);
        assert_eq!((scanned.code, scanned.out), (Some(1), text));
        assert!(scanned.err.contains("`nic:veth0` is in use by another program of ecmsk"), "{}", scanned.err);
        let findings = doctor(CARD);
        assert_eq!(finding(&findings, "card-use").expect("it is said")["state"], "wrong", "{findings:?}");
        assert!(finding(&findings, "round-trip").is_none(), "{findings:?}");
        board.close();
        assert_eq!(listed().1["can_open"], true);

        support::succeed(Command::new("ip").args(["address", "add", "192.0.2.7/24", "dev", MASTER]));
        let (text, row) = listed();
        assert!(text.contains("cannot be opened: it belongs to another network (192.0.2.7)"), "{text}");
        assert_eq!((&row["address"], &row["can_open"]), (&json!("192.0.2.7"), &json!(false)), "{row}");
        look(&["errors"]).fails(1, &["192.0.2.7", "ip address flush dev veth0"]);
        support::succeed(Command::new("ip").args(["address", "flush", "dev", MASTER]));
        support::succeed(Command::new("ip").args(["link", "set", MASTER, "down"]));
        let (text, row) = listed();
        assert!(text.contains("cannot be opened: it is switched off"), "{text}");
        assert_eq!((&row["up"], &row["next"]), (&json!(false), &json!(["sudo ip link set veth0 up"])), "{row}");
        look(&["scan"]).fails(1, &["veth0 is down", "sudo ip link set veth0 up"]);
        let fit = finding(&doctor(CARD), "card-fit").cloned().expect("it is said");
        assert_eq!((&fit["state"], &fit["next"]), (&json!("wrong"), &json!("sudo ip link set veth0 up")), "{fit}");
    }

    /// BUS-5.1, BUS-7.1 A missing slave, a refused object or value, a missing file, and a cut cable are reported with
    /// exit code and next step. So is a cable by which no frame comes back.
    #[test]
    fn what_cannot_be_is_told() {
        let rig = Rig::new(LIST, "tool_wrong");
        for verb in [&["sdo", "read", "4", "0x1000"][..], &["sdo", "list", "4"], &["sii", "read", "4"]] {
            look(verb).fails(1, &["there is no slave 4, but 3 slaves", "number them from 1"]);
        }
        look(&["sdo", "read", "41", "0x1000"]).code.filter(|code| *code == 2).expect("no network has so many");
        look(&["sdo", "read", "1", "0x5555"]).fails(1, &["slave 1, object 0x5555:0", "`ecmsk bus sdo list`"]);
        look(&["sdo", "write", "1", "statusword", "1"]).fails(1, &["aborted with 0x06010002", "the slave's manual"]);
        look(&["sdo", "write", "1", "homing_method", "128"]).fails(2, &["128 does not fit"]);
        look(&["sdo", "read", "3", "0x1000", "--type", "u8"])
            .fails(1, &["slave 3: device_type (0x1000:0) has 4 bytes, not 1"]);
        look(&["foe", "read", "3", "firmware"]).fails(1, &["slave 3 has no files"]);
        look(&["foe", "write", "1", "no such file"]).fails(1, &["cannot read no such file"]);
        run(&["bus", "scan", "--link", "nic:veth7"]).fails(1, &["no network interface veth7", "veth0"]);
        run(&["bus", "scan", "--link", "nic:veth0?priorty=3"]).fails(2, &["priorty", "priority"]);
        let failed = look(&["sdo", "read", "4", "0x1000", "--json"]);
        let error = failed.err.lines().last().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
        assert_eq!((failed.code, &error.expect("an error")["exit_code"]), (Some(1), &json!(1)), "{failed:?}");

        rig.happen("cut 3");
        assert_eq!(look(&["scan", "--json"]).lines().len(), 2, "those before the cut");
        look(&["sdo", "read", "3", "0x1000"]).fails(1, &["there is no slave 3, but 2 slaves"]);
        let cut = look(&["errors"]);
        assert!(cut.code == Some(1) && cut.out.contains("what was connected to slave 2, port 1"), "{cut:?}");
        rig.happen("heal");
        assert_eq!(look(&["scan", "--json"]).lines().len(), 3);
        rig.happen("cut 1");
        for verb in [&["scan"][..], &["sdo", "dump", "1"], &["sii", "read", "1"], &["dc"], &["errors"]] {
            look(verb).fails(1, &["no slave answers", "look at the cable to the first slave"]);
        }
        let scanned = run(&["list", "--scan", MASTER]);
        assert!(scanned.code == Some(1) && scanned.out.contains(CARD) && scanned.err.contains("no slave answers"));
        let trips = finding(&doctor(CARD), "round-trip").cloned().expect("it is said");
        assert_eq!((&trips["state"], &trips["found"]), (&json!("wrong"), &json!("no frame comes back")), "{trips}");
    }

    /// A cable that is cut in the middle of a dump ends it, after the values that were read.
    #[test]
    fn a_cable_that_is_cut_ends_what_is_going_on() {
        let rig = Rig::new("drive", "tool_cut");
        rig.happen("sdo-delay 1 20ms");
        let mut dump = tool(&["bus", "sdo", "dump", "1", "--link", CARD]);
        let mut dump = dump.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        let mut first = String::new();
        BufReader::new(dump.stdout.as_mut().expect("a pipe")).read_line(&mut first).expect("a line");
        rig.happen("cut 1");
        let ended = dump.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert!(first.starts_with("0x1000:0 ") && ended.status.code() == Some(1), "{first}{said}");
        assert!(said.contains("error: slave 1") && said.contains("check its cable and its power"), "{said}");
    }

    /// After a program was killed in OP, the next scan finds each slave in the state to which its watchdog has brought
    /// it, with the reason; another scan finds them in Init.
    #[test]
    fn slaves_of_a_program_that_was_killed_are_found() {
        let rig = Rig::new(LIST, "tool_killed");
        let shell = InOp::start();
        look(&["scan"]).fails(1, &["`nic:veth0` is in use by another program of ecmsk"]);
        assert_eq!(listed().1["reason"], "another program of ecmsk has it");
        shell.kill();
        wait_for(&rig, "slaves 1 to 3 are in SafeOP with AL status 0x001B");
        let found = "SafeOP with an error, AL status 0x001B (sync manager watchdog)";
        let first = look(&["scan"]);
        assert_eq!(
            first.err.matches(&format!("was found in {found}, and was brought to Init")).count(),
            3,
            "{first:?}"
        );
        assert_eq!(first.good().matches(found).count(), 3);
        let second = look(&["scan", "--json"]);
        assert!(
            second.lines().iter().all(|slave| slave["found_in"] == "Init" && slave["failed"] == false),
            "{second:?}"
        );
        assert_eq!((second.code, &*second.err), (Some(0), ""));
    }
}
