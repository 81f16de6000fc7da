//! `ecmsk exec --clock virtual`: programs that sleep.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::exec::ExecFolder;
use crate::common::{Ran, ecmsk};

/// The link gets a virtual clock, whether it is given or found. The library is preloaded before those of the user.
#[test]
fn the_program_gets_a_link_on_virtual_time_and_the_library() {
    let place = ExecFolder::new();
    place.program("libecmsk_sleep.so", "", "644");
    let script = "echo \"$ECMSK_LINK\"; echo \"$LD_PRELOAD\"";
    for link in ["sim:?slaves=io", "sim:?slaves=io&clock=virtual"] {
        let ran = place.run(&["--clock", "virtual", "--link", link], script);
        let lines: Vec<&str> = ran.out.lines().collect();
        assert_eq!(lines[0], "sim:?slaves=io&clock=virtual");
        assert!(lines[1].starts_with(place.tmp().to_str().expect("UTF-8")), "{}", lines[1]);
        assert!(lines[1].ends_with("/libecmsk_sleep.so"), "{}", lines[1]);
    }
    let script =
        ["--clock", "virtual", "--", "sh", "-c", ": > \"$ECMSK_OPENED\"; echo \"$ECMSK_LINK\"; echo \"$LD_PRELOAD\""];
    let mut command = place.exec(&script);
    let ran =
        Ran::from(command.env("ECMSK_LINK", "xf-sim:").env("LD_PRELOAD", "others").output().expect("the tool starts"));
    assert!(
        ran.out.starts_with("xf-sim:?clock=virtual\n") && ran.out.ends_with("/libecmsk_sleep.so:others\n"),
        "{}",
        ran.out
    );
    place.is_clean();
}

/// Only a simulated board can have a virtual clock; the program is not started on another one.
#[test]
fn boards_that_are_not_simulated_are_refused() {
    let place = ExecFolder::new();
    for link in ["usb:", "tcp://127.0.0.1:1", "nic:eth1"] {
        let ran = place.run(&["--clock", "virtual", "--link", link], "echo started");
        ran.expect_failure(2, &["--clock virtual takes a simulated board", link], "sim:?slaves=drive*2");
        assert_eq!(ran.out, "");
    }
    let nowhere = place.tmp();
    let mut command = place.exec(&["--clock", "virtual", "--", "sh", "-c", "echo started"]);
    command.env("HOME", &nowhere).env("XDG_CONFIG_HOME", &nowhere).env_remove("ECMSK_LINK");
    let ran = Ran::from(command.output().expect("the tool starts"));
    ran.expect_failure(2, &["takes a simulated board", "`usb:`"], "sim:?slaves=drive*2");
    let paced = place.run(&["--clock", "virtual", "--link", "sim:?rate=0.5"], "echo started");
    paced.expect_failure(2, &["`rate` does not take `0.5`", "clock=virtual"], "link help");
}

/// Without the library for it the program is not started.
#[test]
fn without_the_library_nothing_starts() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = folder.path().join("libNEXTWUSBLib.so");
    fs::write(&library, "\x7fELF").expect("a file");
    let mut command = ecmsk(["exec", "--clock", "virtual", "--link", "sim:", "--library"]);
    let ran = Ran::from(command.arg(&library).args(["--", "echo", "started"]).output().expect("the tool starts"));
    ran.expect_failure(125, &["no libecmsk_sleep.so beside"], "cargo build -p ecmsk-sleep");
    assert_eq!(ran.out, "");
}

/// Programs in C on the libraries of this build.
mod needs_cxx {
    use super::*;
    use support::{self, Language};

    const LINK: &str = "sim:?slaves=drive";

    fn program(name: &str) -> PathBuf {
        support::compile(&support::root().join("tests/c").join(name), Language::C("c11")).exe
    }

    fn exec(options: &[&str], program: &Path, arguments: &[&str]) -> Ran {
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(&support::library().shared).args(options).arg("--").arg(program).args(arguments);
        command.output().expect("the tool starts").into()
    }

    /// The waits and the virtual time, in microseconds, that the tool reports with -v.
    fn counts(said: &str) -> (u64, u64) {
        let line = said.lines().find_map(|line| line.strip_prefix("clock: ")).unwrap_or_else(|| panic!("{said}"));
        let (waits, time) = line.split_once(" waits, ").expect("two numbers");
        let seconds = time.strip_suffix(" s of virtual time").expect("a time");
        (waits.parse().expect("a number"), seconds.replace('.', "").parse().expect("a number"))
    }

    /// A program that sleeps 20 s of machine time does the same as where time passes by its calls. Each sleep is passed on,
    /// and virtual time passes in it. Two runs give the same output and the same recording, byte for byte.
    #[test]
    fn a_program_that_sleeps_runs_on_virtual_time() {
        let program = program("sleeps.c");
        let by_calls = exec(&["--link", "sim:?slaves=drive&clock=virtual"], &program, &["by-calls"]).expect_quiet();
        assert!(by_calls.ends_with("ok\n"), "{by_calls}");
        let folder = tempfile::tempdir().expect("a folder");
        // A recording contains its path.
        let file = folder.path().join("run.pcapng");
        let path = file.to_str().expect("UTF-8");
        let runs = [(); 2].map(|()| {
            let options = ["-v", "--clock", "virtual", "--link", LINK, "--record", path, "--overwrite"];
            let ran = exec(&options, &program, &[]);
            assert_eq!((ran.code, &ran.out), (Some(0), &by_calls), "{}", ran.err);
            let own = ran.err.lines().find(|line| line.contains(" sleeps, ")).expect("the program's line").to_owned();
            let (sleeps, time) = own.split_once(" sleeps, ").expect("two numbers");
            let (waits, passed_us) = counts(&ran.err);
            assert_eq!(waits, sleeps.parse::<u64>().expect("a number"));
            assert!(waits >= 20_000, "{waits}");
            let time = time.strip_suffix(" s").expect("a time").replace('.', "").parse::<u64>().expect("a number");
            assert!(time >= 20_000_000 && passed_us >= time && passed_us >= waits * 1_000, "{own}, {passed_us} us");
            (own, passed_us, fs::read(&file).expect("the recording"))
        });
        let [(own, passed_us, recording), (own_again, passed_again_us, recording_again)] = runs;
        assert_eq!((own, passed_us), (own_again, passed_again_us));
        assert!(recording == recording_again, "the recordings differ");
    }

    /// A cycle by absolute times, an operator's thread with sleeps and limits, and a thread that waits for both: all
    /// happens at its time.
    #[test]
    fn threads_wait_for_each_other() {
        let ran = exec(&["-v", "--clock", "virtual", "--link", LINK], &program("sleeping_threads.c"), &[]);
        let expected = "slept: 10\nnot yet half way: 125\nhalf way: 150\nnot yet the end: 200\nthe end: 300\nok\n";
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), expected), "{}", ran.err);
        let (waits, passed_us) = counts(&ran.err);
        assert!(waits >= 3_000 && passed_us >= 3_000_000, "{}", ran.err);
    }

    /// A board starts up while it is closed and the program sleeps.
    #[test]
    fn a_board_that_was_reset_is_there_after_a_sleep() {
        let program = program("sleeping_reset.c");
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program, &[]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "ok\n"), "{}", ran.err);
    }

    /// Each function by which a program waits sets its clocks on by the time that it waits for, a day included. So do a
    /// read that another thread ends, and a loop without a call; a thread that waits can be cancelled.
    #[test]
    fn each_way_to_wait_takes_virtual_time() {
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program("waits.c"), &[]);
        let expected = "nanosleep: 5 ms\nclock_nanosleep: 5 ms\nclock_nanosleep until: 6 ms\nusleep: 8 ms\n\
            sleep: 86400000 ms\nthrd_sleep: 9 ms\npoll: 10 ms\nppoll: 9 ms\nselect: 7 ms\npselect: 9 ms\nepoll_wait: 11 ms\n\
            epoll_pwait: 12 ms\npthread_cond_timedwait: 13 ms\non another clock: 14 ms\npthread_cond_clockwait: 15 ms\n\
            cnd_timedwait: 16 ms\nsem_timedwait: 17 ms\nsem_clockwait: 18 ms\n\
            pthread_mutex_timedlock: 20 ms\nand a lock that comes: 9 ms\npoll for a thread: 30 ms\n\
            read: 30 ms\na loop: 30 ms\nthrd_create: 10000 ms\ntimes: 10000 ms\npthread_cancel: 20 ms\nok\n";
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), expected), "{}", ran.err);
    }

    /// No deadline comes while a thread is on its way back from a call without a limit, or while one ends. Limits that the C++
    /// library gives to the system by its own calls, and times of timers, are those of the clock.
    #[test]
    fn threads_hand_over_before_any_deadline() {
        let source = support::root().join("tests/c/hand_over.cpp");
        let program = support::compile(&source, Language::Cpp("c++17")).exe;
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program, &[]);
        let expected = "answers: 0 too late\njoins: 0 too late\na future that does not come: 100 ms\n\
            one that comes: 50 ms\na timer: within the minute\na timer: within the minute\nok\n";
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), expected), "{}", ran.err);
    }

    /// A wait for ever lets no time pass. A wait that a board takes long to pass does not keep other threads from going on. The
    /// clock has an end. Of a set for select no more is used than the program has given.
    #[test]
    fn long_waits_and_small_sets() {
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program("long_waits.c"), &[]);
        let expected = "a small set\nhung up\nfor ever\na day\nok\n";
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), expected), "{}", ran.err);
    }

    /// Handlers of signals use the board wherever they interrupt a wait, and end it. One that is blocked keeps no other thread
    /// from sleeping.
    #[test]
    fn handlers_interrupt_waits_anywhere() {
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program("handlers.c"), &[]);
        let expected = "frames in sleeps\nframes in ppoll\nsleeps end\nclosed\nbeside a handler\nok\n";
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), expected), "{}", ran.err);
    }

    /// Condition variables from before a fork have their clock in the child, and those that processes share wake it.
    #[test]
    fn condition_variables_outlive_a_fork() {
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program("forked_waits.c"), &[]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "500 ms\n500 ms\nwoken\nok\n"), "{}", ran.err);
    }

    /// Groups of the user make what the system says of a thread long. It is read to its end.
    #[test]
    fn a_user_may_be_in_many_groups() {
        let ran = exec(&["--quiet", "--clock", "virtual", "--link", LINK], &program("groups.c"), &[]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "ok\n"), "{}", ran.err);
    }

    /// A program that the program starts sleeps on its own clock.
    #[test]
    fn started_programs_have_their_own_clocks() {
        let ran = exec(&["-v", "--clock", "virtual", "--link", LINK], &program("started.c"), &[]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), "0 s\n"), "{}", ran.err);
        let (_, passed_us) = counts(&ran.err);
        assert!(passed_us >= 3_600_000_000, "{}", ran.err);
    }

    /// The tool says if a board does not pass time with the program's waits: one that another link names, which is on the real
    /// clock, and one of the native API, such as the tool's own.
    #[test]
    fn boards_that_do_not_follow_are_named() {
        let source = support::out_dir().join("own_link.c");
        let text = "#include \"ecmsk.h\"\n#include <unistd.h>\nint main(void) { ecmsk_board *board; sleep(1);\n\
            return ecmsk_open(\"sim:?slaves=io\", &board) != ECMSK_OK || ecmsk_close(board) != ECMSK_OK; }\n";
        fs::write(&source, text).expect("a source");
        let program = support::compile(&source, Language::C("c11")).exe;
        let ran = exec(&["--clock", "virtual", "--link", LINK], &program, &[]);
        let expected = format!("warning: {} has opened boards (1) that are not on virtual time", program.display());
        assert!(ran.err.lines().any(|line| line.starts_with(&expected)), "{}", ran.err);
        assert_eq!(ran.code, Some(0), "{}", ran.err);

        let script = ["-c", "sleep 1; \"$0\" move 1=100 --up --machine none", env!("CARGO_BIN_EXE_ecmsk")];
        let ran = exec(&["--clock", "virtual", "--link", LINK], Path::new("/bin/sh"), &script);
        let expected =
            "warning: /bin/sh: a board that the Rust crate or the Python package opens does not follow its waits";
        assert!(ran.err.lines().any(|line| line == expected), "{}", ran.err);

        let followed = exec(&["--clock", "virtual", "--link", LINK], &self::program("sleeping_reset.c"), &[]);
        assert!(!followed.err.contains("follow"), "{}", followed.err);
    }

    /// A static program, into which nothing can be preloaded, is named. Below a shell, the tool says that no wait was passed on.
    #[test]
    fn a_static_program_is_named() {
        let source = support::out_dir().join("static.c");
        fs::write(&source, "int main(void) { return 0; }\n").expect("a source");
        let program = support::out_dir().join("static");
        let mut compiler = Language::C("c11").compiler();
        support::succeed(compiler.arg("-static").arg(&source).arg("-o").arg(&program));
        let ran = exec(&["--clock", "virtual", "--link", LINK], &program, &[]);
        let expected = format!("warning: {} is statically linked: its waits take real time", program.display());
        assert!(ran.err.lines().any(|line| line == expected), "{}", ran.err);
        assert_eq!(ran.code, Some(0));
        let below = ["-c", "\"$0\"; exit 0", program.to_str().expect("UTF-8")];
        let ran = exec(&["--clock", "virtual", "--link", LINK], Path::new("/bin/sh"), &below);
        let expected = "note: /bin/sh: no wait was put on the virtual clock; if it has waited, that took real time";
        assert!(ran.err.lines().any(|line| line == expected), "{}", ran.err);
    }
}
