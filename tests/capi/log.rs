//! The log of the library, whose reader may have stalled: no call waits for it.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::io::{BufRead as _, BufReader, PipeReader, Read as _};
    use std::process::{Child, Stdio};
    use std::sync::mpsc;
    use std::thread;

    use support::tcp::{LIMIT, serve, until, uri};
    use support::{Program, full_pipe, root};

    /// The line of a call that fails since no board is open.
    const LINE: &str = "ECMUSBRead(dwlength=504 ) -> ";

    fn program(name: &str) -> Program {
        support::compile(&root().join("tests/c").join(name).with_extension("c"), support::Language::C("c99"))
    }

    /// The running program, with a standard error that takes nothing until the pipe is read.
    fn stalled(name: &str, link: &str, arguments: &[&str], level: &str) -> (Child, PipeReader) {
        let (reader, writer) = full_pipe();
        let mut command = program(name).command(link);
        command.args(arguments).env("ECMSK_LOG", level).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(writer);
        (command.spawn().unwrap(), reader)
    }

    fn says(child: &mut Child, expected: &str) {
        let (out, (sender, said)) = (child.stdout.take().unwrap(), mpsc::channel());
        thread::spawn(move || {
            let mut line = String::new();
            BufReader::new(out).read_line(&mut line).unwrap();
            sender.send(line).unwrap();
        });
        assert_eq!(said.recv_timeout(LIMIT).as_deref(), Ok(expected));
    }

    fn ends(mut child: Child) -> Option<i32> {
        drop(child.stdin.take());
        until("the end of the program", || child.try_wait().unwrap()).code()
    }

    /// A program with an unread standard error moves its axis and ends, with a log of every call: on both clocks, and
    /// with a served board, whose server stops the axis when the program has ended.
    #[test]
    fn a_standard_error_that_nobody_reads_holds_no_call() {
        for (how, code) in [("close", 0), ("exit", 3)] {
            for link in crate::behaviour::CLOCKS {
                let (child, _unread) = stalled("ends_moving", link, &[how], "trace");
                assert_eq!(ends(child), Some(code), "{how} on {link}");
            }
            let (server, told) = serve("sim:?slaves=drive&clock=real");
            let (child, _unread) = stalled("ends_moving", &uri(&server, ""), &[how], "trace");
            assert_eq!(ends(child), Some(code), "{how}");
            told.wait(if how == "close" { "has closed its link" } else { "stand still" });
        }
    }

    /// Lines without room in the queue are counted, and the count is written in their place when the log is read again:
    /// no line is missing unreported.
    #[test]
    fn lines_that_were_dropped_are_counted() {
        let (mut child, mut unread) = stalled("logs", "sim:", &["3000"], "warn");
        says(&mut child, "ok\n");
        let text = thread::spawn(move || {
            let mut text = String::new();
            unread.read_to_string(&mut text).unwrap();
            text
        });
        // The log flows again while the program goes on.
        assert_eq!(ends(child), Some(0));
        let text = text.join().unwrap();
        let text = text.trim_start_matches('.');
        let dropped: u64 = text
            .lines()
            .filter_map(|line| line.strip_prefix("ecmsk: ")?.split_once(" lines of the log were dropped here"))
            .map(|(count, _)| count.parse::<u64>().unwrap())
            .sum();
        let told = text.matches(LINE).count() as u64;
        assert!(dropped > 0 && told > 0, "{dropped} {told}");
        assert_eq!(told + dropped, 3000);
    }

    /// The lines that are in the queue when the program ends are written, by `exit` and by `return`.
    #[test]
    fn the_last_lines_come_out() {
        let mut command = program("logs").command("sim:");
        let ended = support::run(command.arg("900").env("ECMSK_LOG", "warn"));
        assert_eq!(ended.stderr.matches(LINE).count(), 900, "{}", ended.stderr);
        assert_eq!(ended.success(), "ok\n");
    }

    /// LIB-60 A child that may use the library has a log of its own, and does not wait for its parent's, whether its
    /// reader has stalled or not.
    #[test]
    fn a_child_has_a_log_of_its_own() {
        let mut command = program("logs").command("sim:");
        let ended = support::run(command.args(["100", "fork"]).env("ECMSK_LOG", "warn"));
        assert_eq!(ended.stderr.matches(LINE).count(), 200, "{}", ended.stderr);
        assert_eq!(ended.success(), "ok\n");
        let (mut child, _unread) = stalled("logs", "sim:", &["100", "fork"], "warn");
        says(&mut child, "ok\n");
        assert_eq!(ends(child), Some(0));
    }
}
