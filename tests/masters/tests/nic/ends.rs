//! Programs on the library that end while an axis moves, on a network card: it is the program's own board.

mod needs_network_namespace {
    mod needs_cxx {
        use std::thread;
        use std::time::Duration;

        use masters::Rig;
        use support::{Language, root};

        const BY_WATCHDOG: &str = "slave 1 is in SafeOP with AL status 0x001B";
        /// The most repetitions if the machine is late: a late frame has the watchdog expire, too.
        const TRIES: usize = 5;

        /// The lines of the slaves for a program that has ended so, and whether their watchdog has expired.
        fn ends(how: &str, code: Option<i32>) -> (Vec<String>, bool) {
            let program = support::compile(&root().join("tests/c/ends_moving.c"), Language::C("c99"));
            let rig = Rig::new("drive", &format!("nic_ends_{how}"));
            let ended = program.run("nic:veth0?priority=20", [how]);
            assert_eq!((ended.stdout.as_str(), ended.status.code()), ("moving\n", code), "{how}: {ended:?}");
            let has_expired = |said: &[String]| said.iter().any(|line| line.starts_with(BY_WATCHDOG));
            for _ in 0..600 {
                if code.is_some() || has_expired(&rig.said()) {
                    break;
                }
                thread::sleep(Duration::from_millis(50));
            }
            let said = rig.end();
            let expired = has_expired(&said);
            (said, expired)
        }

        /// SAFETY: closing a board on a network card, and the end of its program by `exit`, take the slaves down to PreOP.
        /// Where the program is aborted no frame comes any more, and the watchdog takes them out of OP.
        #[test]
        fn a_program_that_exits_takes_its_slaves_out_of_op() {
            // Each program has a network of its own, which is that of a thread.
            let on_a_card =
                |how, code| thread::scope(|scope| scope.spawn(|| ends(how, code)).join().expect("no panic"));
            for (how, code) in [("close", 0), ("return", 0), ("exit", 3)] {
                let said = (0..TRIES).map(|_| on_a_card(how, Some(code))).find(|(_, expired)| !expired);
                let (said, _) = said.unwrap_or_else(|| panic!("{how}: the watchdog has stopped the axis"));
                let last = said.iter().rfind(|line| line.starts_with("slave"));
                assert_eq!(last.map(String::as_str), Some("slave 1 is in PreOP"), "{how}: {said:?}");
            }
            let (said, expired) = on_a_card("abort", None);
            assert!(expired, "{said:?}");
        }
    }
}
