//! pysoem, which is SOEM in a Python wheel, on simulated slaves. Each program of this folder contains its checks, and
//! begins with a network of its own.
#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};

use masters::Rig;

/// Runs a program of this folder on the slaves of the list; returns the server's lines and the recording `name`.
fn run_as(name: &str, list: &str, program: &str) -> (Vec<String>, PathBuf) {
    let rig = Rig::new(list, name);
    run_on(&rig, program);
    let recording = rig.recording.clone();
    (rig.end(), recording)
}

/// Runs a program of this folder on these slaves; returns its output.
fn run_on(rig: &Rig, program: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pysoem");
    rig.python(&folder.join(format!("{program}.py")))
}

/// The slaves of `aborts.py`: a drive with an object that cannot be read, and a DP3CL.
fn aborts() -> String {
    let objects = support::target_dir().join("masters/write_only.objects");
    std::fs::create_dir_all(objects.parent().expect("a folder")).expect("the target folder");
    std::fs::write(&objects, "0x2100:0 u16 wo 0 It cannot be read\n").expect("a file");
    format!("drive:objects@{},dp3cl", objects.display())
}

/// The slave of `texts.py`: a drive with a long text, an output and an input of its maker.
fn texts() -> String {
    let objects = support::target_dir().join("masters/texts.objects");
    std::fs::create_dir_all(objects.parent().expect("a folder")).expect("the target folder");
    let file =
        "0x2010:0 text rw \"twenty-four letters long\" Nickname\n0x2020:0 u16 rw rx 0 Out\n0x2021:0 i32 ro tx -7 In\n";
    std::fs::write(&objects, file).expect("a file");
    format!("drive:objects@{}", objects.display())
}

mod needs_pysoem {
    use masters::Rig;

    use super::{aborts, run_as, run_on, texts};

    mod needs_tshark {
        use super::{aborts, run_as};

        /// ECAT-15.13 Wireshark dissects the recordings, and finds no malformed packet in them: there are two for each
        /// frame.
        #[test]
        fn recordings_have_no_malformed_packet() {
            let programs = [
                ("drive*2", "start"),
                ("drive*2", "csp"),
                ("dp3cl*2", "dp3cl"),
                ("drive,dp3cl", "sdo"),
                (&aborts(), "aborts"),
                ("drive*2", "emergency"),
                ("drive*2", "watchdog"),
                ("drive*2", "refused"),
                ("drive*3", "vanish"),
                ("drive*40", "many"),
                ("drive", "files"),
                ("drive*2", "two"),
            ];
            for (list, program) in programs {
                let (said, recording) = run_as(&format!("dissected_{program}"), list, program);
                masters::dissect(&recording, &said);
            }
        }
    }

    fn run(list: &str, program: &str) -> Vec<String> {
        run_as(program, list, program).0
    }

    /// ECAT-15.4 Two drives and distributed clocks: scan, EEPROM, identity, mapping, OP; each working counter is the expected one.
    #[test]
    fn two_drives_reach_op_with_distributed_clocks() {
        let said = run("drive*2", "start");
        assert_eq!(said[0], "a master is there on veth1");
        for state in ["in PreOP", "in OP"] {
            // Neighbours share a line if they were seen together.
            assert!(
                said.iter().any(|line| line.starts_with("slave") && line.ends_with(state)),
                "no `{state}`: {said:?}"
            );
        }
        assert!(said.last().is_some_and(|line| line.ends_with("were answered, 0 were lost")), "{said:?}");
    }

    /// ECAT-15.5 A drive follows a path in CSP, and is at rest at its end.
    #[test]
    fn a_drive_moves_in_csp() {
        run("drive*2", "csp");
    }

    /// ECAT-15.12 A DP3CL is homed, moved by profiles and along a path.
    #[test]
    fn a_dp3cl_homes_and_moves_by_profiles() {
        run("dp3cl*2", "dp3cl");
    }

    /// ECAT-15.6 Each abort code that a slave can have, by its cause where a master can cause it, and by a script.
    #[test]
    fn each_abort_code_arrives() {
        run(&aborts(), "aborts");
    }

    /// ECAT-15.6 Values of each length from 1 to 300 bytes, complete access both ways, and codes for one object.
    #[test]
    fn sdos_of_each_length_and_their_aborts() {
        run("drive,dp3cl", "sdo");
    }

    /// ECAT-15.7 An alarm sends an emergency, and a fault reset another one. ECAT-15.20 The server reports both.
    #[test]
    fn an_alarm_sends_an_emergency() {
        let said = run("drive*2", "emergency");
        for line in ["slave 2: alarm 0x7500 (communication)", "slave 2: alarm 0x7500 is cleared"] {
            assert!(said.iter().any(|said| said == line), "no `{line}`: {said:?}");
        }
    }

    /// ECAT-15.8 A master that stops finds its slaves in SafeOP with code 0x001B; without the watchdog they stay in OP.
    #[test]
    fn the_watchdog_ends_op() {
        let said = run("drive*2", "watchdog");
        assert!(said.iter().any(|line| line.contains("in SafeOP with AL status 0x001B")), "{said:?}");
    }

    /// ECAT-15.9 Refused states have the code of the reason; also that of a script.
    #[test]
    fn refused_states_have_their_codes() {
        run("drive*2", "refused");
    }

    /// ECAT-15.10 Slaves behind a cut are lost and come back unchanged; one that has lost its power is configured
    /// again.
    #[test]
    fn slaves_vanish_and_come_back() {
        run("drive*3", "vanish");
    }

    /// ECAT-15.17 Files by FoE in PreOP, firmware in bootstrap; a file that is refused is an error in SOEM, too.
    #[test]
    fn firmware_is_written_in_bootstrap() {
        let rig = Rig::new("drive", "files");
        let printed = run_on(&rig, "files");
        // SOEM 1.1.13 returns a negative count, nothing, and the fault of the mailbox.
        let found: Vec<&str> = printed.lines().map(|line| line.split(',').next().unwrap_or_default()).collect();
        assert_eq!(found, ["-5", "b''", "MailboxError (1"], "{printed}");
        let said = rig.end();
        assert!(said.iter().any(|line| line == "slave 1 is in BOOT"), "{said:?}");
    }

    /// ECAT-15.18 Clocks whose crystals drift by up to 100 ppm are synchronised by the time that pysoem sends in each
    /// cycle.
    #[test]
    fn clocks_that_drift_are_held_together() {
        run_on(&Rig::with_drift("drive*3", "drift", 100), "drift");
    }

    /// ECAT-15.19 Another master on the same wire that only reads does no harm; when it takes the slaves to Init pysoem
    /// notices that and brings them back. ECAT-15.22 The server reports once that there are two.
    #[test]
    fn two_masters_on_one_wire() {
        let said = run("drive*2", "two");
        let others = said.iter().filter(|line| line.contains("another master sends frames to veth1, too: "));
        let others: Vec<&String> = others.collect();
        assert!(others.len() == 1 && others[0].contains("10:20:30:40:50:60"), "{said:?}");
        assert!(said.last().is_some_and(|line| line.ends_with("were answered, 0 were lost")), "{said:?}");
    }

    /// ECAT-11.14 A drive that is set to SYNC0 refuses OP without it.
    #[test]
    fn sync0_that_was_told_is_needed() {
        let said = run("drive", "sync0");
        assert!(said.iter().any(|line| line.starts_with("slave 1 is in SafeOP with AL status 0x0030")), "{said:?}");
    }

    /// SK-7.47 Texts of any length in segments, and objects of a file as process data.
    #[test]
    fn texts_are_whole_and_objects_of_a_file_mapped() {
        run(&texts(), "texts");
    }

    /// ECAT-15.27 A hundred slaves. ECAT-11.13 They reach OP without outputs. ECAT-15.26 Each of their states is
    /// reported.
    #[test]
    fn a_hundred_terminals() {
        let said = run("io*100", "crowd");
        // Neighbours share a line if they were seen together.
        let told = |state: &str| -> usize {
            let of = |line: &String| {
                let (who, rest) = line.strip_prefix("slave")?.split_once(" in ")?;
                let numbers: Vec<usize> = who.split_whitespace().filter_map(|word| word.parse().ok()).collect();
                (rest == state).then(|| numbers[numbers.len() - 1] - numbers[0] + 1)
            };
            said.iter().filter_map(of).sum()
        };
        // SafeOP may have ended before it is reported.
        assert_eq!(["PreOP", "OP"].map(told), [100; 2], "{said:?}");
    }

    /// ECAT-15.11 40 drives with process data in several frames.
    #[test]
    fn forty_drives_in_several_frames() {
        run("drive*40", "many");
    }
}
