//! The behaviour of the library's functions, call by call, seen from C: every program in `tests/c/` is a user of the
//! shared library and checks itself; the tests choose the link that it runs on.
#![cfg(target_os = "linux")]

/// Links that most programs run on: on virtual time every run is the same, on the real clock a thread runs the board.
#[cfg(test)]
pub const CLOCKS: [&str; 2] = ["sim:?slaves=drive*2&clock=virtual", "sim:?slaves=drive*2&clock=real"];

/// Compiles `tests/c/NAME.c`.
#[cfg(test)]
pub fn c_program(name: &str) -> support::Program {
    support::compile(&support::root().join("tests/c").join(name).with_extension("c"), support::Language::C("c99"))
}

/// Runs a program that checks itself and prints `ok`. Neither it nor the library may print anything else.
#[cfg(test)]
pub fn passes(name: &str, link: &str, arguments: &[&str]) {
    let ended = c_program(name).run(link, arguments);
    assert_eq!(ended.stderr, "", "{name} on {link}");
    assert_eq!(ended.success(), "ok\n", "{name} on {link}");
}

mod needs_cxx {
    use std::fs;
    use std::os::unix::fs::symlink;

    use ecmsk::link::Dir;
    use ecmsk::recording::{Recorded, Recording};

    use super::{CLOCKS, c_program, passes};
    use support::{self, out_dir};

    /// LIB-41 Read and write before Open and after Close give false at once and do not crash; LIB-47 Close twice is harmless;
    /// LIB-20 a read right after Open works.
    #[test]
    fn calls_while_nothing_is_open_are_false() {
        for link in CLOCKS {
            passes("not_open", link, &[]);
        }
    }

    /// LIB-54 A read that fails leaves the frame that was moved last, as many bytes as the buffer has: before any
    /// frame, after Close, while nothing is open, and when the board is gone.
    #[test]
    fn a_read_that_fails_leaves_the_last_frame() {
        for link in CLOCKS {
            passes("last_frame", link, &[]);
        }
    }

    /// LIB-28, LIB-52 A length above 512 counts as 512, and not a byte beyond is touched; a read copies min(n, 512) bytes.
    /// LIB-27, LIB-51, LIB-53 NULL and a length of 0 are false. LIB-6 All bits of `unsigned long` count.
    #[test]
    fn lengths_are_limited_to_512_and_null_is_an_error() {
        for link in CLOCKS {
            passes("lengths", link, &[]);
        }
    }

    /// LIB-44 Open while open returns true, and the board goes on working; LIB-47 Close twice is harmless; the board is
    /// unchanged when it is opened again.
    #[test]
    fn open_twice_close_twice_open_again() {
        for link in CLOCKS {
            passes("open_close", link, &[]);
        }
    }

    /// LIB-42 Open without a device returns false, and the reason can be read. SK-9.16 Open fails if no slave was
    /// found.
    #[test]
    fn an_open_that_fails_says_why() {
        passes("open_fails", "sim:?slaves=none&clock=virtual", &["no slave"]);
        passes("open_fails", "can:eth1", &["from ECMSK_LINK", "unknown scheme `can`", "sim:?slaves=drive*2"]);
        passes("open_fails", "sim:?slaves=drive&colour=red", &["from ECMSK_LINK", "colour"]);
        passes("open_fails", "nonsense", &["from ECMSK_LINK", "nonsense"]);
    }

    /// LIB-42 On a machine without libusb a board on USB does not open, and the error says what to install; nothing
    /// else needs it.
    #[test]
    fn a_machine_without_libusb_says_what_to_install() {
        let mut command = c_program("open_fails").command("usb:");
        support::without_libusb(&mut command);
        let ended = support::run(command.args(["from ECMSK_LINK", "libusb", "sudo apt-get install libusb-1.0-0"]));
        assert_eq!(ended.stderr, "");
        assert_eq!(ended.success(), "ok\n");
    }

    /// LIB-48 Close during a blocked read: the read returns false.
    #[test]
    fn close_ends_a_read() {
        passes("close_during_read", "sim:?slaves=drive&clock=real", &[]);
    }

    /// LIB-64 Two threads that read one board: both get reports, each report goes to exactly one of them, and none is lost.
    #[test]
    fn two_threads_share_the_reports() {
        let [on_virtual, on_real] = CLOCKS;
        for _ in 0..5 {
            passes("two_readers", on_virtual, &["exact"]);
        }
        passes("two_readers", on_real, &[]);
    }

    /// SK-4.34, LIB-49 SW_RESET drops the connection: calls are false until Open, and Close is not needed. LIB-43 On the virtual
    /// clock a loop that opens again ends.
    #[test]
    fn a_reset_board_is_dead_until_open() {
        for link in CLOCKS {
            passes("reset", link, &[]);
        }
    }

    /// LIB-36 With `read_timeout_ms` in the link a read returns false after that time; LIB-54 the last frame is in the
    /// buffer.
    #[test]
    fn a_read_with_a_limit_ends() {
        for link in CLOCKS {
            passes("timeout", &format!("{link}&read_timeout_ms=20"), &[]);
        }
    }

    /// LIB-55 Without reads the newest 32 reports are kept; dropped ones are counted. SK-9.11 Old ones are read first.
    /// SK-9.10 Several writes per read and several reads per write are both normal.
    #[test]
    fn unread_reports_are_kept_and_counted() {
        passes("unread", "sim:?slaves=drive&clock=virtual", &[]);
    }

    /// LIB-39 Success is 1, and failure 0, in the whole register of the returned `bool`.
    #[test]
    fn the_library_can_be_loaded_and_unloaded_by_name() {
        let library = support::library().shared.to_string_lossy();
        for link in CLOCKS {
            passes("loaded", link, &[&library]);
        }
    }

    /// LIB-41 A program that ends without Close ends, whatever its threads are doing; a child of fork leaves its
    /// parent's board alone.
    #[test]
    fn programs_may_end_without_close() {
        for link in CLOCKS {
            passes("exit_open", link, &["return"]);
            let ended = c_program("exit_open").run(link, ["exit"]);
            assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{link}");
            passes("exit_open", link, &["fork"]);
        }
    }

    /// LIB-41, LIB-47 A global object's destructor still has the board: it may stop the machine, read and close. A
    /// recording has all frames, closed or not.
    #[test]
    fn a_destructor_of_a_global_has_the_board() {
        let source = support::root().join("tests/c/late_close.cpp");
        let program = support::compile(&source, support::Language::Cpp("c++11"));
        for link in CLOCKS {
            let file = out_dir().join("late.pcapng");
            for how in [&[][..], &["forgets"]] {
                let ended = program.run(&format!("{link}&record={}", file.display()), how);
                assert_eq!((ended.stderr.as_str(), ended.stdout.as_str()), ("", "ok\n"), "{how:?} on {link}");
                let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
                let frames = frames.unwrap_or_else(|error| panic!("{how:?} on {link}: {error}"));
                assert_eq!(frames.iter().filter(|frame| frame.dir == Dir::Write).count(), 21, "{how:?} on {link}");
            }
            let ended = program.run(link, [""; 0]);
            assert_eq!(ended.stderr, "");
            assert_eq!(ended.success(), "ok\n", "{link}");
            let traced = support::run(program.command(link).env("ECMSK_LOG", "trace"));
            assert!(traced.stderr.trim_end().ends_with("CloseECMUSB() -> ()"), "{}", traced.stderr);
            assert_eq!(traced.success(), "ok\n", "{link}");
        }
    }

    /// A signal of the program is handled in the thread that the program chooses, whatever threads the library has.
    #[test]
    fn a_signal_goes_to_the_program() {
        for link in CLOCKS {
            let file = out_dir().join("signals.pcapng");
            passes("signals", &format!("{link}&record={}", file.display()), &[]);
        }
    }

    /// LIB-57 A thread that is cancelled in a call, or before it, completes the call and ends after it: in a read that
    /// waits, and in calls that open, close and write files.
    #[test]
    fn a_thread_may_be_cancelled() {
        for link in CLOCKS {
            passes("cancelled", link, &[]);
            let file = out_dir().join("cancelled.pcapng");
            passes("cancelled", &format!("{link}&record={}", file.display()), &[]);
        }
    }

    /// LIB-70 A thread that is ended by force while it waits in a read, and one that is cancelled there: read, write, Close and
    /// the next Open go on, with a recording, too.
    #[test]
    fn a_thread_that_is_gone_hinders_nobody() {
        let file = out_dir().join("gone.pcapng");
        let links = [
            CLOCKS[1].to_owned(),
            format!("{}&record={}", CLOCKS[1], file.display()),
            format!("{}&fault.delay.read=1&fault.delay_ms=50", CLOCKS[1]),
        ];
        for link in &links {
            passes("gone", link, &[]);
            passes("gone", link, &["cancel"]);
        }
        let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
        assert!(!frames.expect("whole").is_empty());
    }

    /// LIB-70 The same with a served board. A thread that is ended while it receives bytes loses the board, since the
    /// beginning of the next message is unknown: reads say so, and Close and the next Open go on.
    #[test]
    fn a_thread_that_is_gone_hinders_nobody_on_a_served_board() {
        let (server, _) = support::tcp::serve(CLOCKS[1]);
        let file = out_dir().join("gone_tcp.pcapng");
        let link = support::tcp::uri(&server, "keepalive_ms=200");
        let recorded = format!("{link}&record={}", file.display());
        for link in [&link, &recorded] {
            for how in [&[][..], &["cancel"], &["receives"]] {
                passes("gone", link, how);
            }
        }
        let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
        assert!(!frames.expect("whole").is_empty());
    }

    /// LIB-24, LIB-55 SDO requests of a program that is starved, so that most reports are dropped: each is answered.
    #[test]
    fn a_starved_program_gets_its_answers() {
        passes("starved_sdo", CLOCKS[0], &[]);
    }

    /// LIB-74 A console program of Visual Studio compiles with the headers of `share/msvc`: sleeps, clocks, keys.
    #[test]
    fn a_program_of_visual_studio_compiles_as_it_is() {
        let (source, exe) = (support::root().join("tests/c/msvc_console.cpp"), out_dir().join("msvc_console"));
        let mut compiler = support::Language::Cpp("c++11").compiler();
        for folder in ["share/msvc", "share/msvc/capital"] {
            compiler.arg("-I").arg(support::root().join(folder));
        }
        compiler.arg(source).arg("-o").arg(&exe);
        support::succeed(compiler.arg("-L").arg(&support::library().dir).arg("-lNEXTWUSBLib"));
        let keys = out_dir().join("msvc_keys");
        fs::write(&keys, "xq\n").expect("a file");
        let mut command = support::Program { exe }.command(CLOCKS[1]);
        command.stdin(fs::File::open(&keys).expect("it is there"));
        assert_eq!(support::succeed(&mut command), "state 2, Enter, slept, end\n");
    }

    /// LIB-73 A thread with 16 kB of stack writes and reads.
    #[test]
    fn a_thread_with_little_stack_writes_and_reads() {
        for link in CLOCKS {
            passes("small_stack", link, &[]);
        }
    }

    /// LIB-72 However little memory the system leaves to a program, its calls report that and the program does not end:
    /// the vendor's calls, and `ecmsk_open`, which returns `ECMSK_ERROR_IO`.
    #[test]
    fn a_program_without_memory_is_told() {
        for link in CLOCKS {
            passes("no_memory", link, &[]);
            passes("no_memory", link, &["ecmsk_open"]);
        }
    }

    /// LIB-1 The static library does the same. LIB-41 Programs that end without Close among them.
    #[test]
    fn a_program_may_link_the_static_library() {
        for (name, arguments) in [("not_open", &[][..]), ("exit_open", &["moves"])] {
            let exe = out_dir().join(format!("{name}-static"));
            let mut compiler = support::Language::C("c99").compiler();
            compiler.arg(support::root().join(format!("tests/c/{name}.c"))).arg("-o").arg(&exe);
            compiler.arg(&support::library().archive);
            support::succeed(compiler.args(["-lgcc_s", "-lutil", "-lrt", "-lpthread", "-lm", "-ldl"]));
            let program = support::Program { exe };
            for link in CLOCKS {
                let file = out_dir().join("static.pcapng");
                let link = format!("{link}&record={}", file.display());
                assert_eq!(program.run(&link, arguments).success(), "ok\n", "{link}");
                if name == "exit_open" {
                    let frames = Recording::open(&file).expect("a recording").map(|frame| frame.expect("whole"));
                    assert_eq!(frames.count(), 200, "{link}");
                }
            }
        }
    }

    /// LIB-41 A program that ends without Close leaves a whole recording of every frame that it moved.
    #[test]
    fn a_recording_is_whole_without_close() {
        for link in CLOCKS {
            for how in ["moves", "return", "exit", "fork"] {
                let file = out_dir().join("exit.pcapng");
                let ended = c_program("exit_open").run(&format!("{link}&record={}", file.display()), [how]);
                assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{how} on {link}");
                let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
                let frames = frames.unwrap_or_else(|error| panic!("{how} on {link}: {error}"));
                let count = |dir| frames.iter().filter(|frame| frame.dir == dir).count();
                if how == "moves" {
                    assert_eq!((count(Dir::Write), count(Dir::Read)), (100, 100), "{link}");
                } else {
                    assert!(count(Dir::Read) >= 1, "{how} on {link}");
                }
            }
        }
    }

    /// SK-1.23 The caller's bytes go to the board unchanged: a missing or wrong CRC is not filled in.
    #[test]
    fn a_write_does_not_touch_the_bytes() {
        let file = out_dir().join("untouched.pcapng");
        let link = format!("sim:?clock=virtual&record={}", file.display());
        assert_eq!(c_program("untouched").run(&link, [""; 0]).success(), "ok\n");
        let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
        let written: Vec<Recorded> =
            frames.expect("whole").into_iter().filter(|frame| frame.dir == Dir::Write).collect();
        let mut expected: [u8; 512] = std::array::from_fn(|i| (0x80 + i * 7) as u8);
        for (frame, crc) in written.iter().zip([0, 0xEE]) {
            expected[3] = crc;
            assert_eq!(frame.frame.bytes(), &expected);
        }
        assert_eq!(written.len(), 2);
    }

    /// A child of fork has its parent's board without the thread behind it: its calls fail and do not hang.
    #[test]
    fn a_forked_child_has_no_board() {
        for link in CLOCKS {
            passes("forked", link, &[]);
        }
    }

    /// LIB-60 LIB-41 A fork while another thread opens, uses and closes the board: the child has the library whole or none of
    /// it, its calls do not hang, and neither does its exit.
    #[test]
    fn a_fork_while_a_board_is_opened_or_closed() {
        for link in CLOCKS {
            passes("fork_while_changing", link, &[]);
        }
    }

    /// For a program of the other slot size the log says so, once.
    #[test]
    fn the_wrong_slot_size_is_named() {
        let mut command = c_program("other_slots").command("sim:?slot=16&clock=virtual");
        let ended = support::run(command.env("ECMSK_LOG", "warn"));
        assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(0), "ok\n"), "{}", ended.stderr);
        assert_eq!(ended.stderr.matches("frames of 504 bytes, the board's are 512 (16-byte slots)").count(), 1);
    }

    /// LIB-26, LIB-41 Eight threads that open, close, read and write at once: no crash, no hang, and the board works after it.
    #[test]
    fn eight_threads_that_open_use_and_close_at_once_do_no_harm() {
        for link in CLOCKS {
            passes("stress", link, &[]);
        }
    }

    /// Several boards at once by URI; LIB-41 handles that are closed or made up are errors; statistics, counters, names, timeouts.
    #[test]
    fn the_ecmsk_functions_open_several_boards_and_report_errors() {
        passes("boards", "sim:?slaves=drive*2&clock=virtual", &[]);
    }

    /// Counters of commands for a lost slave and of modes that were not restored after homing; statistics of faults
    /// that the link injected.
    #[test]
    fn counters_and_faults_are_shown() {
        let script = out_dir().join("facts.ecmscript");
        let text = "at 3s sdo-abort 1 0x6060:0 0x06020000\nat 6s mute 2\n";
        fs::write(&script, text).expect("a file in the target folder");
        passes("facts", &format!("sim:?slaves=drive*2&clock=virtual&script={}", script.display()), &[]);
    }

    /// Nothing is printed unless `ECMSK_LOG` asks; then every call is traced and every failure has its reason.
    #[test]
    fn the_log_speaks_when_it_is_asked() {
        let ended = support::run(c_program("not_open").command(CLOCKS[0]).env("ECMSK_LOG", "trace"));
        assert!(ended.stderr.contains("OpenECMUSB() -> "), "{}", ended.stderr);
        assert!(ended.stderr.contains("call OpenECMUSB first"), "{}", ended.stderr);
        assert_eq!(ended.success(), "ok\n");
        let ended = support::run(c_program("not_open").command(CLOCKS[0]).env("ECMSK_LOG", "error"));
        assert_eq!(ended.stderr, "");
    }

    /// LIB-42 The link comes from `ECMSK_LINK`, then from `ecmsk.toml` beside the program, then beside the library; none: `usb:`.
    #[test]
    fn the_link_comes_from_variable_program_library_or_is_usb() {
        let folder = out_dir().join("places");
        let _ = fs::remove_dir_all(&folder);
        let [program_dir, library_dir] = ["program", "library"].map(|name| folder.join(name));
        for dir in [&program_dir, &library_dir] {
            fs::create_dir_all(dir).expect("a folder in the target folder");
        }
        let original = c_program("which_link");
        let program = support::Program { exe: program_dir.join("which_link") };
        fs::hard_link(&original.exe, &program.exe).expect("the program in another folder");
        symlink(&support::library().shared, library_dir.join("libNEXTWUSBLib.so.0")).expect("a symbolic link");
        let says = |link: &str| {
            let mut command = program.command(link);
            command.env("LD_LIBRARY_PATH", &library_dir);
            if link.is_empty() {
                // The test must not use a board that is plugged in here.
                support::without_libusb(command.env_remove("ECMSK_LINK"));
            }
            support::run(&mut command).stdout
        };
        let write = |dir: &std::path::Path, slaves: u32| {
            let text = format!("link = \"sim:?slaves=drive*{slaves}\"\n");
            fs::write(dir.join("ecmsk.toml"), text).expect("a file in the target folder");
        };

        assert!(says("").contains("`usb:`"), "{}", says(""));
        write(&library_dir, 3);
        assert!(says("").contains("drive*3"), "{}", says(""));
        write(&program_dir, 4);
        assert!(says("").contains("drive*4"), "{}", says(""));
        assert!(says("sim:?slaves=drive*5").contains("drive*5"));
        fs::write(program_dir.join("ecmsk.toml"), "link = 3\n").expect("a file in the target folder");
        let wrong = says("");
        assert!(wrong.contains("ecmsk.toml, line 1"), "{wrong}");
    }
}

mod needs_valgrind {
    use super::{CLOCKS, c_program};

    /// LIB-28, LIB-52, LIB-54 The library touches no byte that is not the caller's or not initialised, and leaks no
    /// memory.
    #[test]
    fn memcheck_finds_nothing() {
        for (name, links) in [("not_open", &CLOCKS[..]), ("lengths", &CLOCKS[..1]), ("boards", &CLOCKS[..1])] {
            for link in links {
                assert_eq!(support::memcheck(&c_program(name), link, &[]), "ok\n", "{name} on {link}");
            }
        }
        assert_eq!(support::memcheck(&c_program("exit_open"), CLOCKS[1], &["return"]), "ok\n");
    }
}
