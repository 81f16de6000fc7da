//! The end of a program on the library with a served board: the program has vanished, unless it has closed the board.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::io::{BufRead as _, BufReader};
    use std::process::{Child, ChildStdout, Command, Stdio};
    use std::sync::mpsc;
    use std::time::Duration;

    use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
    use ecmsk::link::Dir;
    use ecmsk::port::tcp::Server;
    use ecmsk::recording::{Recorded, Recording};

    use support::tcp::{LIMIT, Told, serve, time_behind, until, uri};
    use support::{self, Program, out_dir};

    const CLOCKS: [&str; 2] = ["sim:?slaves=drive&clock=virtual", "sim:?slaves=drive&clock=real"];

    fn program() -> Program {
        support::compile(&support::root().join("tests/c/ends_moving.c"), support::Language::C("c99"))
    }

    /// Whether axis 1 turns, as the next writer sees it, which is accepted once the server has stopped the axes.
    fn turns(server: &Server) -> bool {
        let ecm = until("place for a writer", || Ecm::open(&uri(server, "")).ok());
        ecm.adopt(&Config { slaves: vec![Slave::Drive(Axis::CSV)], ..Config::default() }).unwrap();
        let from = ecm.next_cycle(LIMIT).unwrap().position(1).unwrap();
        let to = (0..100).map(|_| ecm.next_cycle(LIMIT).unwrap()).last().unwrap().position(1).unwrap();
        ecm.close(Close::Leave).unwrap();
        to.abs_diff(from) > 20
    }

    fn ends(server: &Server, told: &Told, how: &str, code: Option<i32>) {
        // "At once": four keep-alive times are four hours.
        let ended = program().run(&uri(server, "keepalive_ms=3600000"), [how]);
        assert_eq!(
            (ended.stderr.as_str(), ended.stdout.as_str(), ended.status.code()),
            ("", "moving\n", code),
            "{how}"
        );
        told.wait(if how == "close" { "has closed its link" } else { "is gone" });
        assert_eq!(turns(server), how == "close", "{how}: {:?}", told.lines());
    }

    /// TCP-21 TCP-10 A program that ends without CloseECMUSB has vanished, however it exits: its axes are brought to a
    /// standstill. After a close they are not touched.
    #[test]
    fn a_program_that_ends_without_close_has_vanished() {
        for clock in CLOCKS {
            for (how, code) in
                [("return", Some(0)), ("fails", Some(1)), ("exit", Some(3)), ("abort", None), ("close", Some(0))]
            {
                let (server, told) = serve(clock);
                ends(&server, &told, how, code);
            }
        }
    }

    /// TCP-21 LIB-41 The recording of a program that ends without CloseECMUSB is whole all the same.
    #[test]
    fn its_recording_is_whole() {
        let (server, told) = serve(CLOCKS[0]);
        let file = out_dir().join("vanish.pcapng");
        let ended = program().run(&uri(&server, &format!("record={}", file.display())), ["fails"]);
        assert_eq!((ended.stderr.as_str(), ended.status.code()), ("", Some(1)));
        told.wait("stand still");
        let frames: Result<Vec<Recorded>, _> = Recording::open(&file).expect("a recording").collect();
        let written = frames.expect("whole").into_iter().filter(|frame| frame.dir == Dir::Write).count();
        assert!(written > 100, "{written}");
    }

    /// The running program, once it has printed that line.
    fn at_work(server: &Server, keys: &str, how: &str, said: &str) -> (Child, BufReader<ChildStdout>) {
        let mut command = program().command(&uri(server, keys));
        command.arg(how).env("ECMSK_LOG", "warn").stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while line.trim_end() != said {
            line.clear();
            assert!(out.read_line(&mut line).unwrap() > 0, "it ended without {said}");
        }
        (child, out)
    }

    fn kill(mut child: Child) {
        child.kill().unwrap();
        child.wait().unwrap();
    }

    /// The server's line on the end of its writer.
    fn end_of_writer(told: &Told) -> String {
        told.wait("is gone");
        told.lines().into_iter().find(|line| line.contains("is gone")).unwrap()
    }

    /// TCP-9 LIB-60 SAFETY: "at once: the system closes its connection, and children that a program on the library has forked have let
    /// go of it". A keep-alive time of an hour would take four hours.
    #[test]
    fn a_child_that_lives_hides_no_end() {
        let (server, told) = serve(CLOCKS[1]);
        let (child, _out) = at_work(&server, "keepalive_ms=3600000", "forks", "forked");
        kill(child);
        let said = end_of_writer(&told);
        // Its end is seen when the connection closes, or when a message is sent to it, whichever is first.
        let ends = ["without closing its link", "does not take what is sent"];
        assert!(ends.iter().any(|end| said.contains(end)), "{said}");
        assert!(!turns(&server), "{:?}", told.lines());
    }

    /// TCP-5 TCP-9 SAFETY: with a child "made by `clone` without `fork`" the end is noticed "after four keep-alive times".
    #[test]
    fn a_child_that_keeps_the_connection() {
        // A machine may be late, but not in each of so many tries.
        let is_in_time = (0..5).any(|_| {
            let (server, told) = serve(CLOCKS[1]);
            let (child, _out) = at_work(&server, "keepalive_ms=500", "clones", "forked");
            kill(child);
            let silent = time_behind(&end_of_writer(&told), "no word for");
            assert!(silent >= Duration::from_secs(2), "docs/SAFETY.md: four keep-alive times, {silent:?}");
            assert!(!turns(&server), "{:?}", told.lines());
            silent < Duration::from_millis(2500)
        });
        assert!(is_in_time, "docs/SAFETY.md: four keep-alive times");
    }

    /// Whether the library's warning says that the program has stood still for `hang_ms=1500`, and little longer.
    fn warns_in_time(child: &mut Child) -> bool {
        let (send, said) = mpsc::channel();
        let err = BufReader::new(child.stderr.take().unwrap());
        std::thread::spawn(move || err.lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
        let warning = loop {
            let line = said.recv_timeout(LIMIT).expect("a warning");
            if line.contains("hang_ms=") {
                break line;
            }
        };
        // The signal comes in a call, or between two of them.
        let words = ["has stood still for", "made no call for"].into_iter().find(|words| warning.contains(words));
        let stood = time_behind(&warning, words.expect("a time"));
        assert!(stood >= Duration::from_millis(1500), "docs/SAFETY.md: after that time, {warning}");
        stood < Duration::from_secs(2)
    }

    /// TCP-5 TCP-22 SAFETY: "a signal handler of the program never returns, while the thread that it interrupted is in a call": noticed
    /// "with `hang_ms=` after that time", though a keep-alive time is an hour, and otherwise "after four keep-alive times", by the
    /// program's own library, which ends the connection. So it is after a call that the handler has made.
    #[test]
    fn a_handler_that_never_returns() {
        // So long that a machine that stalls for a second does not count as hanging.
        let keys = ["hang_ms=1500&keepalive_ms=3600000", "keepalive_ms=1000"];
        for (keys, how) in keys.into_iter().flat_map(|keys| [(keys, "handler"), (keys, "handler-writes")]) {
            // If it has interrupted the library within a lock, which is rare, the server has to wait for four
            // keep-alive times.
            let is_noticed = (0..5).any(|_| {
                let (server, told) = serve(CLOCKS[1]);
                let (mut child, mut out) = at_work(&server, keys, how, "reads");
                let signals = ["-USR1", &child.id().to_string()].map(str::to_owned);
                let mut said = String::new();
                std::thread::scope(|scope| {
                    let reader = scope.spawn(|| out.read_line(&mut said).unwrap());
                    until("the handler", || {
                        support::succeed(Command::new("kill").args(&signals));
                        reader.is_finished().then_some(())
                    });
                });
                assert_eq!(said, "stuck\n");
                let began = std::time::Instant::now();
                let line = loop {
                    if let Some(line) = told.lines().into_iter().find(|line| line.contains("is gone")) {
                        break Some(line);
                    }
                    if began.elapsed() > LIMIT / 6 {
                        break None;
                    }
                    std::thread::sleep(std::time::Duration::from_millis(2));
                };
                let by_library = line.is_some_and(|line| line.contains("without closing its link"));
                let is_in_time = by_library && (!keys.contains("hang_ms") || warns_in_time(&mut child));
                kill(child);
                assert!(!turns(&server), "{keys}: {:?}", told.lines());
                is_in_time
            });
            assert!(is_noticed, "{keys}, {how}");
        }
    }

    /// TCP-22 A program that makes no call while its axis turns is given up after `hang_ms=`, and its axis is braked; by
    /// default it is not, for a program may set a velocity and sleep.
    #[test]
    fn a_program_that_hangs() {
        for keys in ["hang_ms=100", ""] {
            let (server, told) = serve(CLOCKS[1]);
            let mut command = program().command(&uri(&server, keys));
            command.arg("waits").env("ECMSK_LOG", "warn").stdout(Stdio::piped()).stderr(Stdio::piped());
            let mut child = command.spawn().unwrap();
            if keys.is_empty() {
                let mut line = String::new();
                std::io::BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
                assert_eq!(line, "moving\n");
                // It sleeps while its axis turns on for 5 s of the board's time.
                let reader = ecmsk::link::open(&uri(&server, "role=reader"), ecmsk::link::Share::ByName).unwrap();
                let mut report = ecmsk::sk::Frame::new();
                let mut at = || {
                    reader.read(&mut report, ecmsk::link::Wait::For(LIMIT)).unwrap();
                    report.slot(support::tcp::SIZE, 1).data1 as i32
                };
                let from = at();
                until("5 s of motion", || (at().abs_diff(from) > 500_000).then_some(()));
                assert!(!told.lines().iter().any(|line| line.contains("is gone")), "{:?}", told.lines());
                child.kill().unwrap();
            } else {
                told.wait("stand still");
                child.kill().unwrap();
            }
            let ended = child.wait_with_output().unwrap();
            let said = String::from_utf8_lossy(&ended.stderr);
            assert_eq!(said.contains("hang_ms"), !keys.is_empty(), "{said}");
            assert!(!turns(&server), "{keys}: {:?}", told.lines());
        }
    }
}
