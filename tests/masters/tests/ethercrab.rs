//! ethercrab, a master as a crate, on simulated slaves. Its programs are `tests/masters/ethercrab`, outside the
//! workspace; each contains its checks, and begins with a network of its own.
#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};
use std::process::Command;

use masters::{MASTER, Rig};

/// Builds the programs; returns their file.
fn programs() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("ethercrab/Cargo.toml");
    let target = support::target_dir().join("masters/ethercrab");
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["build", "--locked", "--manifest-path"]).arg(manifest).arg("--target-dir").arg(&target);
    // Flags for this test's own build (coverage, a linker) must not apply to the programs.
    support::succeed(cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS"));
    target.join("debug/ethercrab_master")
}

/// Runs a program on the slaves of the list and records it by that name; returns its output, the server's lines, and
/// the recording.
fn run_as(name: &str, list: &str, program: &str) -> (String, Vec<String>, PathBuf) {
    let programs = programs();
    let rig = Rig::new(list, name);
    let printed = rig.run(Command::new(programs).args([MASTER, program]));
    let Some(printed) = printed.strip_suffix("all as it has to be\n") else { panic!("{printed}") };
    let recording = rig.recording.clone();
    (printed.to_owned(), rig.end(), recording)
}

mod needs_tshark {
    use super::run_as;

    /// ECAT-15.13 Wireshark finds no malformed packet in the frames of ethercrab and its slaves.
    #[test]
    fn recordings_of_ethercrab_have_no_malformed_packet() {
        for (list, program) in [
            ("drive*2", "start"),
            ("dp3cl*2", "dp3cl"),
            ("drive*2", "watchdog"),
            ("drive*2", "refused"),
            ("drive*3", "vanish"),
            ("drive*40", "many"),
            ("drive*2", "emergency"),
        ] {
            let (_, said, recording) = run_as(&format!("dissected_ethercrab_{program}"), list, program);
            masters::dissect(&recording, &said);
        }
    }
}

mod needs_network_namespace {
    use super::run_as;

    /// Runs a program on the slaves of the list; returns its output and the server's lines.
    fn run(list: &str, program: &str) -> (String, Vec<String>) {
        let (printed, said, _) = run_as(&format!("ethercrab_{program}"), list, program);
        (printed, said)
    }

    /// ECAT-15.14 Two drives with ethercrab: scan, EEPROM, SDOs, aborts, OP with distributed clocks, and a path in CSP.
    #[test]
    fn ethercrab_moves_two_drives_with_distributed_clocks() {
        let (_, said) = run("drive*2", "start");
        assert!(said.iter().any(|line| line.starts_with("slave") && line.ends_with("in OP")), "{said:?}");
    }

    /// ECAT-15.16 A DP3CL with ethercrab and distributed clocks: homing, profiles, and a path in CSP.
    #[test]
    fn ethercrab_homes_a_dp3cl_and_moves_it_by_profiles() {
        run("dp3cl*2", "dp3cl");
    }

    /// ECAT-15.16 Slaves that ethercrab has left without process data are in SafeOP with code 0x001B, and come back.
    #[test]
    fn ethercrab_comes_back_from_the_watchdog() {
        let (printed, said) = run("drive*2", "watchdog");
        assert_eq!(printed, "subdevice error: 0x001b: Sync manager watchdog\n".repeat(2));
        assert!(said.iter().any(|line| line.contains("in SafeOP with AL status 0x001B")), "{said:?}");
    }

    /// ECAT-15.16 ethercrab shows why a state was refused.
    #[test]
    fn ethercrab_shows_why_a_state_was_refused() {
        let (printed, _) = run("drive*2", "refused");
        let lines = [
            "AL control 0x08: subdevice error: 0x0011: Invalid requested state change",
            "AL control 0x17: subdevice error: 0x0012: Unknown requested state",
            "AL control 0x14: subdevice error: 0x001d: Invalid Output Configuration",
            "AL control 0x14: subdevice error: 0x8001: (unknown)",
        ];
        assert_eq!(printed.lines().collect::<Vec<_>>(), lines);
    }

    /// ECAT-15.16 Slaves behind a cut come back unchanged; one that has lost its power is found by a new scan.
    #[test]
    fn ethercrab_finds_slaves_again() {
        run("drive*3", "vanish");
    }

    /// ECAT-15.16 40 drives with process data in several frames.
    #[test]
    fn ethercrab_runs_forty_drives_in_several_frames() {
        run("drive*40", "many");
    }

    /// ECAT-15.16 An emergency waits in the mailbox when ethercrab makes a request, and is dropped by it.
    #[test]
    fn ethercrab_goes_on_behind_an_emergency() {
        run("drive*2", "emergency");
    }

    /// ECAT-15.16 The limits of version 0.7.1 are as on the page on slaves.
    #[test]
    fn ethercrab_has_defects_of_its_own() {
        run("drive", "defects");
    }
}
