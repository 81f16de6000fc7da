//! The programs of `examples/cpp/` and `examples/c/`, built with their own Makefiles and pkg-config as a user would, run on
//! a simulated board. In virtual time they print the snapshots of `tests/snapshots/`, to the byte.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use ecmsk::cia402::DriveState;
use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{DriveResponse, MasterResponse, MasterState, SlotSize};
use support::examples::{C, C_WITHOUT_BOARD, C_WITHOUT_LIBRARY, CPP, SCRIPTS, VIRTUAL, VIRTUAL_16};
use support::{Ended, Program, out_dir, root};

use crate::prefix::prefix;

/// Two drives on the real clock.
const REAL: &str = "sim:?slaves=drive*2&clock=real";

/// With the slaves behind an ECM-XF these print the same. The others print the number of reports of a step, the
/// position of an axis after a number of reports, or the number of frames lost to a full FIFO.
const SAME_BEHIND_CHIP: [&str; 6] =
    ["habit_read_after_open", "habit_reader_writer_threads", "homing", "io", "two_axes_12b", "two_axes_16b"];

/// Every program with the link of its snapshot.
fn programs() -> impl Iterator<Item = (&'static str, String)> {
    CPP.into_iter().chain(C).map(|(name, link)| {
        let script = SCRIPTS.into_iter().find(|(program, _)| *program == name);
        (name, script.map_or(link.to_owned(), |(_, script)| scripted(link, script)))
    })
}

fn link_of(name: &str) -> String {
    programs().find(|(program, _)| *program == name).expect("a program of the tables").1
}

/// A link with a script of `examples/scripts/`.
fn scripted(link: &str, script: &str) -> String {
    let file = root().join("examples/scripts").join(script).with_extension("ecmscript");
    format!("{link}&script={}", uri_part(file.to_str().expect("UTF-8")))
}

/// A path as the value of a link's key.
fn uri_part(path: &str) -> String {
    path.replace('%', "%25").replace('&', "%26").replace(' ', "%20").replace('#', "%23").replace('+', "%2B")
}

/// Builds all programs with `make` and the pkg-config file, and returns their folder.
fn built() -> &'static PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let out = out_dir().join("programs");
        let _ = fs::remove_dir_all(&out);
        for (folder, variable, standard) in [("cpp", "CXXFLAGS", "c++17"), ("c", "CFLAGS", "c99")] {
            let mut make = Command::new("make");
            make.arg("-C").arg(root().join("examples").join(folder)).arg(format!("OUT={}", out.display()));
            make.arg(format!("{variable}=-std={standard} -O1 -g -Wall -Wextra -pedantic -Werror"));
            support::succeed(make.env("PKG_CONFIG_PATH", prefix().join("lib/pkgconfig")));
        }
        out
    })
}

fn program(name: &str) -> Program {
    Program { exe: built().join(name) }
}

/// Runs a program; it must print its snapshot, and nothing to standard error.
fn prints_its_snapshot(name: &str, link: &str) {
    let ended = program(name).run(link, [""; 0]);
    assert_eq!(ended.stderr, "", "{name} on {link}");
    support::snapshot(name, &ended.success());
}

/// Runs a program; returns also the last report it has read.
fn last_report(name: &str, link: &str, size: SlotSize) -> (Ended, MasterState, Vec<DriveResponse>) {
    let file = out_dir().join(format!("{name}.pcapng"));
    let ended = program(name).run(&format!("{link}&record={}", uri_part(file.to_str().expect("UTF-8"))), [""; 0]);
    let recording = Recording::open(&file).expect("the recording");
    let frames = recording.map(|recorded| recorded.expect("a frame")).filter(|recorded| recorded.dir == Dir::Read);
    let last = frames.last().expect("a report").frame;
    let state = MasterResponse::decode(&last.slot(size, 0)).state;
    let slaves = (1..=size.max_slaves()).map(|slave| DriveResponse::decode(&last.slot(size, slave))).collect();
    (ended, state.state().expect("a state"), slaves)
}

mod needs_cxx {
    use super::*;

    /// Every program succeeds with the slaves behind an ECM-XF. The bus comes up later there, so that an alarm in a
    /// motion has its own time.
    #[test]
    fn all_programs_behind_a_chip() {
        let alarm = support::script_client::file("alarm-behind-chip", "at 4s alarm 2 0x7500\n");
        for (name, link) in programs() {
            let link = link.replace("sim:", "xf-sim:");
            if name == "alarm_recovery" {
                let link =
                    format!("{}&script={}", VIRTUAL.replace("sim:", "xf-sim:"), uri_part(&alarm.to_string_lossy()));
                let printed = program(name).run(&link, [""; 0]).success();
                assert!(printed.contains("  axis 2: alarm 0x7500, stopped at "), "{printed}");
                assert!(
                    printed.contains("\ncorner 1 of the square: at 0, 0\ncommands lost: 0\nservos off"),
                    "{printed}"
                );
            } else if SAME_BEHIND_CHIP.contains(&name) {
                prints_its_snapshot(name, &link);
            } else {
                let ended = program(name).run(&link, [""; 0]);
                assert_eq!(ended.stderr, "", "{name} on {link}");
                assert!(!ended.success().is_empty(), "{name}");
            }
        }
    }

    /// LIB-25 Start-up, SDOs, servo on and off by the statusword, two axes on a path by CSP, shut-down: on 12-byte slots, on
    /// both firmwares.
    #[test]
    fn two_axes_on_a_square() {
        prints_its_snapshot("two_axes_12b", VIRTUAL);
        prints_its_snapshot("two_axes_12b", &format!("{VIRTUAL}&fw=1.5"));
    }

    /// LIB-25, LIB-8 The same on 16-byte slots.
    #[test]
    fn two_axes_on_a_circle() {
        prints_its_snapshot("two_axes_16b", VIRTUAL_16);
    }

    /// LIB-20 One read right after Open, before any write; LIB-9 with the header of the guides' samples.
    #[test]
    fn a_read_right_after_open() {
        prints_its_snapshot("habit_read_after_open", VIRTUAL);
        prints_its_snapshot("habit_read_after_open", REAL);
    }

    /// LIB-21 Five SET_AXIS writes 2 ms apart, SET_DC, DRIVE_MODE, none followed by a read; then a loop until the state is there.
    #[test]
    fn a_burst_of_set_axis() {
        prints_its_snapshot("habit_set_axis_burst", VIRTUAL);
    }

    /// LIB-22 Two writes, then reads until the FIFO has room, from a thread of its own: nothing is lost.
    #[test]
    fn two_writes_and_reads_to_the_fifo_mark() {
        prints_its_snapshot("habit_two_writes_fifo_mark", VIRTUAL);
    }

    /// LIB-23 A tight writer without reads fills the FIFO, as on the board, and every lost frame is counted.
    #[test]
    fn a_tight_writer_without_reads() {
        prints_its_snapshot("habit_tight_writer", VIRTUAL);
    }

    /// LIB-24 An SDO request once, then zero frames and reads until the answer matches; again after 800 tries.
    #[test]
    fn sdo_requests_with_retries() {
        prints_its_snapshot("habit_sdo_retry", VIRTUAL);
    }

    /// LIB-26 One thread reads while another one writes: nothing is lost.
    #[test]
    fn a_reader_and_a_writer_thread() {
        prints_its_snapshot("habit_reader_writer_threads", VIRTUAL);
        prints_its_snapshot("habit_reader_writer_threads", REAL);
    }

    /// SK-7.19, SK-7.20, SK-7.24 Both axes are homed, moved by CSP in the new coordinates, and a homing that fails (bit 13)
    /// is ended by ABORT_HOME: the same on both firmwares, though one goes back to CSP by itself and the other does not.
    #[test]
    fn homing_and_a_homing_that_fails() {
        prints_its_snapshot("homing", VIRTUAL);
        prints_its_snapshot("homing", &format!("{VIRTUAL}&fw=1.5"));
    }

    /// LIB-25, SK-7.11 An alarm in the motion is noticed and cleared, and the path is completed.
    #[test]
    fn recovery_from_an_alarm() {
        let link = link_of("alarm_recovery");
        prints_its_snapshot("alarm_recovery", &link);
        let other = program("alarm_recovery").run(&format!("{link}&fw=1.5"), [""; 0]).success();
        assert!(other.contains("  axis 2: alarm 0x7500, stopped at "), "{other}");
        assert!(other.contains("\ncorner 1 of the square: at 0, 0\ncommands lost: 0\nservos off"), "{other}");
        let undisturbed = program("alarm_recovery").run(VIRTUAL, [""; 0]).success();
        assert!(!undisturbed.contains("alarm") && undisturbed.contains("servos off, PreOP"), "{undisturbed}");
    }

    /// SK-7.12 An alarm that ALM_CLR does not clear is reported to the user, and both axes end switched off.
    #[test]
    fn an_alarm_that_stays() {
        let link = scripted(VIRTUAL, "alarm_that_stays");
        let (ended, state, drives) = last_report("alarm_recovery", &link, SlotSize::Bytes12);
        assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(1), ""));
        support::snapshot("alarm_that_stays", &ended.stdout);
        assert_eq!(state, MasterState::PreOp);
        assert_eq!(drives[0].statusword.state(), Some(DriveState::Fault));
        assert_eq!(drives[1].statusword.state(), Some(DriveState::SwitchOnDisabled));
    }

    /// SK-4.26, SK-4.27, SK-7.3, SK-7.4, SK-7.33 One drive by velocity, one by torque.
    #[test]
    fn velocity_and_torque() {
        prints_its_snapshot("csv_cst", VIRTUAL);
        prints_its_snapshot("csv_cst", &format!("{VIRTUAL}&fw=1.5"));
    }

    /// SK-3.22, SK-3.23, SK-3.29, SK-4.25 Both channels of a module follow their paths in one slot, each with its
    /// outputs and inputs.
    #[test]
    fn a_module_of_two_channels() {
        let link = link_of("hsp_16b");
        prints_its_snapshot("hsp_16b", &link);
        prints_its_snapshot("hsp_16b", &format!("{link}&fw=1.5"));
    }

    /// SK-3.17, SK-4.31, SK-4.32, SK-8.1 The inputs of a slave and of the board are read, and outputs are set.
    #[test]
    fn inputs_and_outputs() {
        let link = link_of("io");
        prints_its_snapshot("io", &link);
        prints_its_snapshot("io", &format!("{link}&fw=1.5"));
    }

    /// LIB-25, SK-7.20, SK-7.21 A panel: jog, an alarm while jogging, homing with a search that is aborted, buttons at wrong
    /// moments.
    #[test]
    fn a_panel() {
        let link = link_of("operator_panel");
        prints_its_snapshot("operator_panel", &link);
        prints_its_snapshot("operator_panel", &format!("{link}&fw=1.5"));
    }

    /// SK-7.10 However a program ends, well or by an alarm it does not expect, it leaves the network in PreOP and no drive
    /// in Operation enabled.
    #[test]
    fn programs_end_in_a_safe_state() {
        let well = |name| (name, link_of(name), Some(0));
        // Two axes stop in their motion, one is turning at a velocity.
        let by_alarm = |name| (name, scripted(VIRTUAL, "alarm"), Some(1));
        let ends = ["alarm_recovery", "homing", "hsp_16b", "operator_panel", "two_axes_12b", "csv_cst", "io"].map(well);
        for (name, link, code) in ends.into_iter().chain(["two_axes_12b", "homing", "csv_cst"].map(by_alarm)) {
            let size = if link.contains("slot=16") { SlotSize::Bytes16 } else { SlotSize::Bytes12 };
            let (ended, state, drives) = last_report(name, &link, size);
            assert_eq!(ended.status.code(), code, "{name} on {link}: {ended:?}");
            assert_eq!(ended.stderr.contains("failed: "), code == Some(1), "{name} on {link}: {ended:?}");
            assert_eq!(state, MasterState::PreOp, "{name} on {link}");
            let on = |drive: &DriveResponse| name != "io" && drive.statusword.is_enabled();
            assert!(!drives.iter().any(on), "{name} on {link}: {:?}", &drives[..2]);
        }
    }

    /// SK-4.61 A cable that is cut behind the first drive ends a program, and it stops the drive that it still reaches.
    #[test]
    fn a_cable_that_is_cut() {
        let script = out_dir().join("cut.ecmscript");
        fs::write(&script, "at 1s cut 2 for 10s\n").expect("a file in the target folder");
        let link = format!("{VIRTUAL}&script={}", uri_part(script.to_str().expect("UTF-8")));
        let left_op = "failed: the network is not in OP any more\n";
        let homing = "failed: an axis stops during homing\n";
        for (name, said) in
            [("two_axes_12b", left_op), ("alarm_recovery", homing), ("csv_cst", left_op), ("operator_panel", left_op)]
        {
            let (ended, state, drives) = last_report(name, &link, SlotSize::Bytes12);
            assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(1), said), "{name}: {ended:?}");
            assert_eq!((state, drives[0].statusword.state()), (MasterState::PreOp, Some(DriveState::SwitchOnDisabled)));
        }
    }

    /// LIB-22, LIB-25 On the real clock the path takes its time, and nothing is lost either.
    #[test]
    fn two_axes_on_the_real_clock() {
        let said = program("two_axes_12b").run(REAL, [""; 0]).success();
        assert!(said.contains("\ncommands lost: 0\n"), "{said}");
        assert!(said.ends_with("servos off, PreOP, closed\n"), "{said}");
    }

    /// With `ecmsk exec --clock virtual` programs that sleep print the same at each run, also one with two threads.
    #[test]
    fn programs_that_sleep_on_a_virtual_clock() {
        for name in
            ["habit_set_axis_burst", "habit_two_writes_fifo_mark", "habit_reader_writer_threads", "two_axes_12b"]
        {
            let exec = ["exec", "--quiet", "--clock", "virtual", "--link", "sim:?slaves=drive*2", "--library"];
            let printed = || {
                let mut tool = support::tool_without_link(&exec);
                let ended = support::run(tool.arg(&support::library().shared).arg("--").arg(program(name).exe));
                assert_eq!(ended.stderr, "", "{name}");
                ended.success()
            };
            let first = printed();
            assert!(!first.is_empty(), "{name}");
            assert_eq!(first, printed(), "{name}");
        }
    }

    /// The axes of the machine file of docs/MACHINE.md, in their units. A file that is not there or is wrong has its error.
    #[test]
    fn the_axes_of_a_machine_file() {
        let page = fs::read_to_string(root().join("docs/MACHINE.md")).expect("the page");
        let text = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
        let file = out_dir().join("machine_axes.toml");
        let run = |file: &Path| program(C_WITHOUT_BOARD).run("sim:", [file]);
        fs::write(&file, text).expect("a file in the target folder");
        let ended = run(&file);
        assert_eq!(ended.stderr, "");
        let shown = "X: slave 1, 26214.4 counts per mm, from -10, to 250, at most 100 mm/s; 100 mm are 2621440 counts\n\
                     C: slave 2, -364.089 counts per deg; 100 deg are -36409 counts\n";
        assert_eq!(ended.success(), shown);
        fs::write(&file, text.replace("max = 250", "max = 50")).expect("a file in the target folder");
        assert!(run(&file).success().contains("100 mm are 2621440 counts, beyond its limits\n"));
        fs::write(&file, text.replace("\"-360/131072\"", "0")).expect("a file in the target folder");
        let ended = run(&file);
        assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(1), ""));
        assert!(ended.stderr.contains("machine_axes.toml, line 28: axes.C.per: 0 is no scale"), "{ended:?}");
        let ended = run(Path::new("nonexistent.toml"));
        assert!(ended.stderr.starts_with("cannot read the machine file nonexistent.toml: "), "{ended:?}");
    }

    /// LIB-19 The programs are C++98, those with threads C++11, and C99; no warning in any standard.
    #[test]
    fn programs_compile_in_old_and_new_standards() {
        use support::Language::{self, Cpp};
        let compiles = |source: &Path, language: Language| {
            support::succeed(language.compiler().arg("-fsyntax-only").arg(source));
        };
        for (name, _) in CPP {
            let source = root().join("examples/cpp").join(name).with_extension("cpp");
            let text = fs::read_to_string(&source).expect("the program");
            let oldest = if text.contains("#include <thread>") { "c++11" } else { "c++98" };
            for standard in [oldest, "c++20"] {
                compiles(&source, Cpp(standard));
            }
        }
        for name in C.map(|(name, _)| name).into_iter().chain([C_WITHOUT_BOARD]) {
            let source = root().join("examples/c").join(name).with_extension("c");
            for standard in ["c99", "c11", "c17"] {
                compiles(&source, Language::C(standard));
            }
        }
    }

    /// LIB-20 Every program of the folders is one of these.
    #[test]
    fn no_program_is_left_out() {
        let in_folder = |folder: &str| {
            let entries = fs::read_dir(root().join("examples").join(folder)).expect("the folder");
            let files = entries.map(|entry| entry.expect("readable").path());
            let mut names: Vec<String> = files
                .filter(|file| file.extension().is_some_and(|extension| extension == folder))
                .map(|file| file.file_stem().expect("a name").to_string_lossy().into_owned())
                .collect();
            names.sort();
            names
        };
        assert_eq!(in_folder("cpp"), CPP.map(|(name, _)| name));
        let mut c = C.map(|(name, _)| name).to_vec();
        c.extend([C_WITHOUT_BOARD, C_WITHOUT_LIBRARY]);
        assert_eq!(in_folder("c"), c);
    }
}

mod needs_valgrind {
    use super::*;

    fn memcheck_finds_nothing(of_which: impl Fn(&str) -> bool) {
        for (name, link) in programs().filter(|(name, _)| of_which(name)) {
            support::snapshot(name, &support::memcheck(&program(name), &link, &[]));
        }
    }

    /// LIB-20, LIB-21, LIB-22, LIB-23, LIB-24, LIB-26 Under memcheck every program with a habit prints the same, and
    /// memcheck finds nothing.
    #[test]
    fn memcheck_finds_nothing_in_habits() {
        memcheck_finds_nothing(|name| name.starts_with("habit_"));
    }

    /// LIB-22, LIB-25 Nor in any other program.
    #[test]
    fn memcheck_finds_nothing_in_machines() {
        memcheck_finds_nothing(|name| !name.starts_with("habit_"));
    }
}
