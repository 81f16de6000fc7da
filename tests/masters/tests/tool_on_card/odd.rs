//! Slaves that keep to the standard in unusual ways: the tool moves their drives, and its messages name what they refuse.
//! Their implementation shares nothing with the models of this project, and they answer at an interface.

mod needs_network_namespace {
    use masters::OddRig;
    use support::odd_line::{OddSlave, coupler, drive, drive_of, sii, terminal};

    use crate::card::{Ran, file, look, run};

    const LINK: &str = "nic:veth0?priority=20";
    /// How often a run is repeated that did not come to its end: on a busy machine frames are late, and slaves are lost.
    const TRIES: usize = 5;

    /// Runs the tool until its output or its messages have that.
    #[track_caller]
    fn until_said(what: &str, mut once: impl FnMut() -> Ran) -> Ran {
        let mut ran = once();
        for _ in 1..TRIES {
            if ran.out.contains(what) || ran.err.contains(what) {
                break;
            }
            ran = once();
        }
        assert!(ran.out.contains(what) || ran.err.contains(what), "never: {what}; {ran:?}");
        ran
    }

    fn move_up(axis: usize, list: &str) -> Ran {
        run(&["move", &format!("{axis}=300"), "--up", "--link", LINK, "--slaves", list])
    }

    /// `bus scan` finds these slaves, and `move --up` moves the drive at the end of the line to its target.
    #[track_caller]
    fn moves(slaves: Vec<OddSlave>, list: &str) {
        let axis = slaves.len();
        let rig = OddRig::new(slaves);
        let scanned = until_said("vendor 0x00001234, product 0x00005678", || look(&["scan"]));
        assert!(scanned.good().contains("an odd drive"));
        let moved = until_said(&format!("axis {axis}: at 300"), || move_up(axis, list));
        moved.good();
        assert_eq!(rig.slave(axis, |slave| slave.position()), 300);
    }

    /// MASTER-3.7 A coupler whose AL status copies AL control, the acknowledge bit too, stands before a drive.
    #[test]
    fn a_coupler_that_copies_the_acknowledgement() {
        moves(vec![coupler(), drive()], "none,drive");
    }

    /// MASTER-3.7 A terminal of that kind is an IO module of a script of the tool. Its inputs copy its outputs.
    #[test]
    fn a_terminal_that_copies_the_acknowledgement() {
        let _rig = OddRig::new([terminal()]);
        let script = file("odd_io.ecm");
        std::fs::write(&script, "state op\nio 1 --set 0x5\nwait 0.3s\nio 1\n").expect("a file");
        let script = script.display().to_string();
        until_said("inputs 0x0005", || run(&["run", &script, "--link", LINK, "--slaves", "io"])).good();
    }

    /// MASTER-2.9 An EEPROM whose sync managers have no type, and one without sync managers.
    #[test]
    fn sync_managers_that_the_eeprom_does_not_name() {
        let untyped = sii::MANAGERS.map(|(start, len, control, enable, _)| (start, len, control, enable, 0));
        for managers in [Some(&untyped[..]), None] {
            moves(vec![drive_of(sii::drive(managers))], "drive");
        }
    }

    /// MASTER-2.3 An EEPROM whose commands take 60 ms.
    #[test]
    fn an_eeprom_that_takes_its_time() {
        moves(vec![drive().with(|slave| slave.eeprom.busy_ns = 60_000_000)], "drive");
    }

    /// The reason for a refused state is in words, for common AL status codes of synchronization.
    #[test]
    fn refusals_are_in_words() {
        let rig = OddRig::new([drive()]);
        for code in [0x001A, 0x002C, 0x002D, 0x0032, 0x0070] {
            rig.slave(1, |slave| slave.states.refuses = vec![(4, code)]);
            let ran = until_said("slave 1 refused", || move_up(1, "drive"));
            let error = ran.err.lines().find(|line| line.contains("slave 1 refused")).expect("it was found");
            assert!(error.contains(&format!("AL status 0x{code:04X} (")), "{error}");
            assert_eq!(ran.code, Some(1), "{ran:?}");
        }
    }
}
