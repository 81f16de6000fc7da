//! The slaves, the synchronisation of clocks, and bad cables.

mod needs_network_namespace {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    use std::time::Duration;

    use masters::{MASTER, Rig};
    use serde_json::json;

    use crate::card::{CARD, LIST, in_time, look, run, tool};

    /// BUS-3.1, BUS-4.1, BUS-7.1 On a card the verbs print the same about slaves as in virtual time, which snapshots
    /// keep, in words and as JSON. `list --scan` shows the slaves after the list.
    #[test]
    fn a_card_shows_what_its_slaves_are() {
        let _rig = Rig::new(LIST, "tool_shows");
        let simulated = format!("sim:?slaves={LIST}");
        for words in [
            &["scan"][..],
            &["scan", "--json"],
            &["sdo", "list", "3"],
            &["sdo", "list", "2", "--entries"],
            &["sdo", "list", "2", "--entries", "--json"],
            &["sdo", "dump", "1"],
            &["sdo", "dump", "3", "--json"],
            &["sdo", "read", "2", "0x1018:2"],
            &["sdo", "read", "2", "0x1018", "--complete", "--json"],
            &["sii", "read", "3"],
            &["sii", "read", "1", "--json"],
            &["foe", "read", "1", "firmware"],
            &["errors"],
            &["errors", "--json"],
        ] {
            let card = in_time(|| look(words));
            let simulated = run(&[&["bus"], words, &["--link", &simulated]].concat());
            assert!(simulated.code == Some(0) && simulated.out.len() > 5, "{simulated:?}");
            // In virtual time a drive was switched on only just before, and has no state yet.
            let lines =
                |out: &str| out.lines().filter(|line| !line.starts_with("0x6041:0 ")).collect::<Vec<_>>().join("\n");
            assert_eq!((card.code, lines(&card.out)), (simulated.code, lines(&simulated.out)), "{words:?}");
            // The previous run has left a slave in PreOP, which is shown.
            let others = |line: &&str| !(line.starts_with("note: slave ") && line.contains("was found in PreOP"));
            assert_eq!(card.err.lines().filter(others).collect::<Vec<_>>(), simulated.err.lines().collect::<Vec<_>>());
        }
        let tree = in_time(|| look(&["scan"])).good();
        let (list, with_slaves) = (run(&["list"]), in_time(|| run(&["list", "--scan", MASTER])));
        assert_eq!((with_slaves.code, with_slaves.out), (list.code, list.out + &tree));
        let with_slaves = in_time(|| run(&["list", "--json", "--scan", MASTER]));
        let list = run(&["list", "--json"]);
        let slaves = with_slaves.lines().split_off(list.lines().len());
        let names: Vec<&str> = slaves.iter().filter_map(|slave| slave["name"].as_str()).collect();
        assert_eq!((with_slaves.code, names), (list.code, vec!["drive", "drive", "io"]));
    }

    /// Clocks with equal crystals stay synchronised, and drifting ones are measured; the exit code agrees with the
    /// report on each clock.
    #[test]
    fn clocks_are_measured() {
        for drift_ppm in [0, 50] {
            let _rig = Rig::with_drift(LIST, "tool_clocks", drift_ppm);
            let measured = look(&["dc", "--seconds", "1", "--json"]);
            let lines = measured.lines();
            let [reference, other] = &lines[..] else { panic!("two drives have clocks: {measured:?}") };
            assert_eq!((&reference["slave"], &reference["reference"]), (&json!(1), &json!(true)), "{reference}");
            assert_eq!(
                (&other["slave"], &other["reference"], &other["delay_ns"]),
                (&json!(2), &json!(false), &json!(310))
            );
            let [min, mean, max] = ["min_ns", "mean_ns", "max_ns"].map(|name| other[name].as_i64().expect("a number"));
            assert!(min <= mean && mean <= max, "{other}");
            let is_good = -1000 < min && max < 1000;
            assert_eq!((&other["good"], measured.code), (&json!(is_good), Some(i32::from(!is_good))), "{other}");
            if drift_ppm == 0 {
                assert!(is_good, "{other}");
            } else {
                assert_ne!((min, max), (0, 0), "{other}");
            }
            let text = look(&["dc", "--seconds", "1"]).out;
            assert!(
                text.contains(" 1  drive  delay      0 ns") && text.contains(" 2  drive  delay    310 ns"),
                "{text}"
            );
        }
    }

    /// BUS-7.1, BUS-7.2 A bad cable is named while it is watched, and by its counters until they are cleared.
    #[test]
    fn a_bad_cable_is_named() {
        let rig = Rig::new("io*3", "tool_noise");
        let blamed = "bad: the cable from slave 2, port 1 to slave 3, port 0: ";
        assert!(look(&["errors", "--clear"]).err.contains("the counters of all slaves were cleared"));
        rig.happen("noise 3 20");
        let watched = look(&["errors", "--watch", "1"]);
        rig.happen("end noise 3");
        assert!(watched.code == Some(1) && watched.out.contains(blamed), "{watched:?}");
        assert!(watched.err.contains("frames did not come back"), "{watched:?}");
        let told = look(&["errors"]);
        assert!(told.code == Some(1) && told.out.contains(blamed), "{told:?}");
        let first = told.out.lines().next().expect("slave 1");
        assert!(
            first.starts_with("slave 1: port 1: ") && first.ends_with(" damaged before"),
            "blamed on no one: {told:?}"
        );
        let cleared = look(&["errors", "--clear", "--json"]);
        assert_eq!(cleared.code, Some(1), "{cleared:?}");
        let trouble = cleared.lines().pop().expect("a line");
        assert_eq!(
            (&trouble["near"], &trouble["far"]),
            (&json!({"slave": 2, "port": 1}), &json!({"slave": 3, "port": 0}))
        );
        let after = look(&["errors"]);
        assert_eq!((after.code, &*after.out), (Some(0), "slave 1: nothing\nslave 2: nothing\nslave 3: nothing\n"));
        assert!(after.err.contains("no cable is bad"), "{after:?}");
    }

    /// BUS-7.2 A slave that is lost while cables are watched is reported, the others go on, and its counters are shown
    /// when it is back.
    #[test]
    fn a_slave_that_goes_while_cables_are_watched_is_told() {
        let rig = Rig::new("io*3", "tool_watch");
        // The watch shows its counters after a scan.
        look(&["sdo", "read", "3", "0x1000"]).good();
        let mut watch = tool(&["bus", "errors", "--watch", "5", "--link", CARD]);
        let mut watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        let mut note = String::new();
        BufReader::new(watch.stderr.as_mut().expect("a pipe")).read_line(&mut note).expect("a note");
        assert_eq!(note, "note: slave 3 was found in PreOP, and was brought to Init\n");
        std::thread::sleep(Duration::from_millis(500));
        rig.happen("cut 3");
        let mut said = String::new();
        for line in BufReader::new(watch.stdout.take().expect("a pipe")).lines() {
            let line = line.expect("text");
            if line.ends_with("slave 3: it does not answer") {
                rig.happen("heal");
            }
            said += &(line + "\n");
        }
        assert_eq!(watch.wait().expect("it ends").code(), Some(1), "{said}");
        assert!(said.contains("slave 3: it does not answer"), "{said}");
        assert!(
            said.contains("slave 2: port 1: 1 lost link") && said.contains("slave 3: port 0: 1 lost link"),
            "{said}"
        );
        assert!(!said.contains("slave 1") && said.matches("bad: ").count() == 1, "{said}");
        assert!(
            said.contains("bad: the cable from slave 2, port 1 to slave 3, port 0: slave 2 has 1 lost link"),
            "{said}"
        );
    }
}
