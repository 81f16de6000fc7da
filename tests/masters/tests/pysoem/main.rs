//! pysoem, which is SOEM in a Python wheel, on simulated slaves. What a program of this folder checks is in it; each begins with a
//! network of its own.
#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};

use masters::Rig;

/// Runs a program of this folder on the slaves of the list: what the server has said, and the recording `name`.
fn run_as(name: &str, list: &str, program: &str) -> (Vec<String>, PathBuf) {
    let rig = Rig::new(list, name);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pysoem");
    rig.python(&folder.join(format!("{program}.py")));
    let recording = rig.recording.clone();
    (rig.end(), recording)
}

mod needs_tshark {
    use std::process::Command;

    use super::run_as;

    /// ECAT-15.13 Wireshark dissects the recordings, and finds no packet in them that is malformed: there are two of each frame.
    #[test]
    fn recordings_have_no_malformed_packet() {
        for (list, program) in
            [("drive*2", "start"), ("drive,dp3cl", "sdo"), ("drive*2", "emergency"), ("drive*40", "many")]
        {
            let (said, recording) = run_as(&format!("dissected_{program}"), list, program);
            let packets = |filter: &str| {
                let mut tshark = Command::new("tshark");
                support::succeed(tshark.arg("-r").arg(&recording).args(["-Y", filter])).lines().count()
            };
            let answered = said.last().and_then(|line| line.split(' ').next()).expect("a number");
            let answered: usize = answered.parse().expect("a number");
            assert_eq!(packets("ecat"), 2 * answered, "{program}");
            assert_eq!(packets("_ws.malformed"), 0, "{program}: {}", recording.display());
        }
    }
}

mod needs_pysoem {
    use super::run_as;

    fn run(list: &str, program: &str) -> Vec<String> {
        run_as(program, list, program).0
    }

    /// ECAT-15.4 Two drives and distributed clocks: scan, EEPROM, identity, mapping, OP; each working counter is the expected one.
    #[test]
    fn two_drives_reach_op_with_distributed_clocks() {
        let said = run("drive*2", "start");
        for line in ["a master is there on veth1", "slaves 1 to 2 are in PreOP", "slaves 1 to 2 are in OP"] {
            assert!(said.iter().any(|said| said == line), "no `{line}`: {said:?}");
        }
        assert!(said.last().is_some_and(|line| line.ends_with("were answered, 0 were lost")), "{said:?}");
    }

    /// ECAT-15.5 A drive follows a path in CSP, and stands at its end.
    #[test]
    fn a_drive_moves_in_csp() {
        run("drive*2", "csp");
    }

    /// ECAT-15.12 A DP3CL is homed, moved by profiles and along a path.
    #[test]
    fn a_dp3cl_homes_and_moves_by_profiles() {
        run("dp3cl*2", "dp3cl");
    }

    /// ECAT-15.6 Values of 1 to 300 bytes, complete access, abort codes, and those of a script.
    #[test]
    fn sdos_of_each_length_and_their_aborts() {
        run("drive,dp3cl", "sdo");
    }

    /// ECAT-15.7 An alarm sends an emergency, and a fault reset another one.
    #[test]
    fn an_alarm_sends_an_emergency() {
        run("drive*2", "emergency");
    }

    /// ECAT-15.8 A master that stops finds its slaves in SafeOP with code 0x001B; without the watchdog they stay in OP.
    #[test]
    fn the_watchdog_ends_op() {
        let said = run("drive*2", "watchdog");
        let line = "slaves 1 to 2 are in SafeOP with AL status 0x001B";
        assert!(said.iter().any(|said| said.starts_with(line)), "{said:?}");
    }

    /// ECAT-15.9 States that are refused have the code that says why; also that of a script.
    #[test]
    fn refused_states_have_their_codes() {
        run("drive*2", "refused");
    }

    /// ECAT-15.10 Slaves behind a cut vanish and come back as they were; one that has lost its power is configured again.
    #[test]
    fn slaves_vanish_and_come_back() {
        run("drive*3", "vanish");
    }

    /// ECAT-15.11 40 drives with process data in several frames.
    #[test]
    fn forty_drives_in_several_frames() {
        run("drive*40", "many");
    }
}
