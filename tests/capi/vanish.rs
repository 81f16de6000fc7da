//! How a program on the library leaves a board that is served when it ends: it has vanished, unless it has closed the board.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::io::BufRead as _;
    use std::process::Stdio;

    use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
    use ecmsk::link::Dir;
    use ecmsk::port::tcp::Server;
    use ecmsk::recording::{Recorded, Recording};

    use support::tcp::{LIMIT, Told, serve, until, uri};
    use support::{self, Program, out_dir};

    const CLOCKS: [&str; 2] = ["sim:?slaves=drive&clock=virtual", "sim:?slaves=drive&clock=real"];

    fn program() -> Program {
        support::compile(&support::root().join("tests/c/ends_moving.c"), support::Language::C("c99"))
    }

    /// Whether axis 1 turns, by a look of the next writer, which has a place once the server has done with the axes.
    fn turns(server: &Server) -> bool {
        let ecm = until("place for a writer", || Ecm::open(&uri(server, "")).ok());
        ecm.adopt(&Config { slaves: vec![Slave::Drive(Axis::CSV)], ..Config::default() }).unwrap();
        let from = ecm.next_cycle(LIMIT).unwrap().position(1).unwrap();
        let to = (0..100).map(|_| ecm.next_cycle(LIMIT).unwrap()).last().unwrap().position(1).unwrap();
        ecm.close(Close::Leave).unwrap();
        to.abs_diff(from) > 20
    }

    fn ends(server: &Server, told: &Told, how: &str, code: Option<i32>) {
        let ended = program().run(&uri(server, ""), [how]);
        assert_eq!(
            (ended.stderr.as_str(), ended.stdout.as_str(), ended.status.code()),
            ("", "moving\n", code),
            "{how}"
        );
        told.wait(if how == "close" { "has closed its link" } else { "is gone" });
        assert_eq!(turns(server), how == "close", "{how}: {:?}", told.lines());
    }

    /// TCP-21 TCP-10 A program that ends without CloseECMUSB has vanished, by whatever it ends and with whatever exit
    /// code: its axes are brought to a standstill. One that has closed is trusted.
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
