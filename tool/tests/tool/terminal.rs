//! `ecmsk shell` in a terminal: completion, history, progress, Ctrl-C and SIGTERM.
#![cfg(target_os = "linux")]

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use crate::common::{ecmsk, with_default_signals};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// The time limit of a wait for output. In a run without faults every wait takes only a fraction of it.
const HANG: Duration = Duration::from_secs(60);

/// The process that has the terminal as its controlling terminal, and so gets SIGHUP when the terminal is closed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Owner {
    /// The tool: it gets SIGHUP when the terminal is closed.
    Tool,
    /// No process: the tool gets no signal and has to notice by itself that the terminal is closed.
    Nobody,
}

/// A terminal in which the tool runs.
struct Terminal {
    keys: File,
    /// The tool's output so far, and whether the output has ended.
    screen: Arc<(Mutex<(String, bool)>, Condvar)>,
    /// The length of the output that earlier waits have consumed.
    seen: usize,
    child: Child,
    /// Ends the thread `reader`, because the handle from which it reads keeps the terminal open, too.
    hung_up: Arc<AtomicBool>,
    reader: std::thread::JoinHandle<()>,
}

impl Terminal {
    fn start(words: &[&str]) -> Self {
        Self::start_as(words, Owner::Nobody)
    }

    fn start_as(words: &[&str], owner: Owner) -> Self {
        Self::start_with(words, owner, &[])
    }

    fn start_with(words: &[&str], owner: Owner, variables: &[(&str, &str)]) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
        grantpt(&master).expect("it is ours");
        unlockpt(&master).expect("it is ours");
        let name = ptsname(&master, Vec::new()).expect("it has a name").into_string().expect("UTF-8");
        let tty = || File::options().read(true).write(true).open(&name).expect("the other end");
        let mut command = ecmsk(words);
        if owner == Owner::Tool {
            let mut session = Command::new("setsid");
            session.arg("--ctty").arg(command.get_program()).args(command.get_args());
            command = with_default_signals(&session);
        }
        let child = command
            .env("TERM", "xterm")
            .envs(variables.iter().copied())
            .stdin(tty())
            .stdout(tty())
            .stderr(tty())
            .spawn()
            .expect("it starts");
        // The command has handles of the tool's end of the terminal. With them the test would not see that the tool has closed
        // it.
        drop(command);
        let keys = File::from(master);
        let mut output = keys.try_clone().expect("a second handle");
        let screen = Arc::new((Mutex::default(), Condvar::new()));
        let shared = Arc::clone(&screen);
        let hung_up = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&hung_up);
        let reader = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            loop {
                let mut asked = [PollFd::new(&output, PollFlags::IN)];
                let soon = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
                let nothing = poll(&mut asked, Some(&soon)).expect("it can be asked") == 0;
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                if nothing {
                    continue;
                }
                // After the tool has closed the terminal, reading returns an error, which counts as the end of the output.
                let read = output.read(&mut bytes).unwrap_or(0);
                let mut screen: std::sync::MutexGuard<'_, (String, bool)> = shared.0.lock().unwrap();
                screen.0.push_str(&String::from_utf8_lossy(&bytes[..read]));
                screen.1 = read == 0;
                shared.1.notify_all();
                if read == 0 {
                    return;
                }
            }
        });
        Self { keys, screen, seen: 0, child, hung_up, reader }
    }

    /// Closes the terminal, as its window does; returns the tool's exit code.
    #[track_caller]
    fn hang_up(mut self) -> Option<i32> {
        self.hung_up.store(true, Ordering::Relaxed);
        self.reader.join().expect("no panic");
        drop(self.keys);
        for _ in 0..12_000 {
            if let Some(status) = self.child.try_wait().expect("it is ours") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        self.child.kill().expect("it is ours");
        self.child.wait().expect("it is ours");
        panic!("it goes on");
    }

    /// Waits until the output has these words behind those that earlier waits have found.
    fn until(&mut self, words: &str) {
        let mut screen = self.screen.0.lock().unwrap();
        loop {
            if let Some(at) = screen.0[self.seen..].find(words) {
                self.seen += at + words.len();
                return;
            }
            assert!(!screen.1, "it ended without `{words}`: {}", screen.0);
            let (waited, late) = self.screen.1.wait_timeout(screen, HANG).unwrap();
            assert!(!late.timed_out(), "it hangs without `{words}`: {}", waited.0);
            screen = waited;
        }
    }

    fn keys(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).expect("it reads");
    }

    /// Types the lines that bring the shell's network to OP and switch its drive on.
    fn servo_on(&mut self) {
        for (line, answer) in [("state op\r", "OP\r\n"), ("servo on 1\r", "Operation enabled")] {
            self.keys(line);
            self.until(answer);
            self.until("ecmsk> ");
        }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).expect("it runs");
    }

    /// Waits for the tool's end; returns its exit code, and all of its output.
    fn end(mut self) -> (Option<i32>, String) {
        let code = self.child.wait().expect("it ends").code();
        let mut screen = self.screen.0.lock().unwrap();
        while !screen.1 {
            screen = self.screen.1.wait(screen).unwrap();
        }
        (code, screen.0.clone())
    }
}

/// In the shell Tab completes words, arrow up recalls lines, Ctrl-C without a running step explains how to leave, and `quit`
/// ends it.
#[test]
fn the_shell_completes_recalls_lines_and_quits() {
    let mut terminal = Terminal::start(&["shell", "--link", "sim:?slaves=drive&clock=virtual"]);
    terminal.until("ecmsk> ");
    terminal.keys("sta\top\r");
    terminal.until("OP\r\n");
    terminal.until("ecmsk> ");
    terminal.keys("servo on 1\r");
    terminal.until("Operation enabled");
    terminal.until("ecmsk> ");
    terminal.keys("mov\t1=7\r");
    terminal.until("axis 1: at 7\r\n");
    terminal.until("ecmsk> ");
    terminal.keys("\x03");
    terminal.until("note: nothing runs; type quit to leave");
    terminal.until("ecmsk> ");
    // The first arrow up recalls the last line, which is the move, and the second one the line `servo`.
    terminal.keys("\x1b[A\x1b[A\r");
    terminal.until("Operation enabled");
    terminal.until("ecmsk> ");
    terminal.keys("nonsense\r");
    terminal.until("error: `nonsense` is unknown; allowed: info");
    terminal.until("ecmsk> ");
    terminal.keys("quit\r");
    assert_eq!(terminal.end().0, Some(0));
}

/// In a terminal progress is one line that changes. Ctrl-C ends the step and the shell goes on; SIGTERM at
/// the prompt closes the board, and the terminal is as it was.
#[test]
fn signals_end_a_step_or_the_shell_and_restore_the_terminal() {
    let mut terminal = Terminal::start(&["shell", "--link", "sim:?slaves=drive"]);
    terminal.until("ecmsk> ");
    terminal.servo_on();
    terminal.keys("move 1=900000 --velocity 100000\r");
    terminal.until("\r\x1b[K[##");
    terminal.until("-] moving, ");
    terminal.until(" %, 1.1 of 9.3 s");
    terminal.signal(Signal::INT);
    terminal.until("error: stopped by Ctrl-C; the board is still open");
    terminal.until("ecmsk> ");
    terminal.keys("move 1=0 --velocity 1000000 --relative\r");
    terminal.until("axis 1: at ");
    terminal.until("ecmsk> ");
    terminal.signal(Signal::TERM);
    let (code, screen) = terminal.end();
    assert_eq!(code, Some(143));
    assert!(screen.contains("error: stopped by SIGTERM; no axis moves"), "{screen}");
    let (on, off) = (screen.matches("\x1b[?2004h").count(), screen.matches("\x1b[?2004l").count());
    assert_eq!(on, off, "bracketed paste is off again");
}

/// At a terminal a move of more than a minute needs a confirmation: "no", the end of the input and Ctrl-C prevent it,
/// `--yes` skips the question, and in the shell the answer is not read as a step.
#[test]
fn a_long_move_is_asked_for_at_a_terminal() {
    const QUESTION: &str = "move for 16 min 42 s? [y/N] ";
    let line = ["move", "1=100000", "--velocity", "100", "--up", "--link", "sim:?slaves=drive"];
    for (keys, code, said) in [
        ("\r", 1, "nobody has said yes to 16 min 42 s; give a higher --velocity, or --yes"),
        ("no\r", 1, "nobody has said yes to 16 min 42 s"),
        ("\x04", 1, "nobody has said yes to 16 min 42 s"),
        ("\x03", 130, "stopped by Ctrl-C; no axis moves"),
    ] {
        let mut terminal = Terminal::start_as(&line, Owner::Tool);
        terminal.until("note: this move takes 16 min 42 s, for 100000 counts; --velocity makes it shorter");
        terminal.until(QUESTION);
        terminal.keys(keys);
        let (ended, screen) = terminal.end();
        assert!(ended == Some(code) && screen.contains(said) && !screen.contains("moving"), "{keys:?}: {screen}");
    }
    let mut terminal = Terminal::start_as(&line, Owner::Tool);
    terminal.until(QUESTION);
    terminal.keys("y\r");
    terminal.until("moving, ");
    terminal.keys("\x03");
    assert_eq!(terminal.end().0, Some(130));

    let mut terminal = Terminal::start(&["shell", "--link", "sim:?slaves=drive"]);
    terminal.until("ecmsk> ");
    terminal.servo_on();
    terminal.keys("move 1=100000 --velocity 100\r");
    terminal.until(QUESTION);
    terminal.keys("n\r");
    terminal.until("error: move: nobody has said yes");
    terminal.until("ecmsk> ");
    terminal.keys("move 1=500\r");
    terminal.until("axis 1: at ");
    terminal.until("ecmsk> ");
    terminal.keys("move 1=100000 --velocity 100 --yes\r");
    terminal.until("note: this move takes 16 min ");
    terminal.until("moving, ");
    terminal.signal(Signal::INT);
    terminal.until("ecmsk> ");
    terminal.keys("quit\r");
    let (code, screen) = terminal.end();
    assert!(code == Some(0) && screen.matches("[y/N]").count() == 1, "{screen}");
}

/// The shell ends when its terminal is closed: at the prompt, and while a step runs; also without a signal.
#[test]
fn a_closed_terminal_ends_the_shell() {
    for owner in [Owner::Tool, Owner::Nobody] {
        for moving in [false, true] {
            let mut terminal = Terminal::start_as(&["shell", "--link", "sim:?slaves=drive"], owner);
            terminal.until("ecmsk> ");
            if moving {
                terminal.servo_on();
                terminal.keys("move 1=90000 --velocity 100000\r");
                terminal.until("moving, ");
            }
            let code = terminal.hang_up();
            assert!(code.is_some(), "{owner:?}, moving {moving}: {code:?}");
        }
    }
}

/// `doctor` colours the words `ok`, `advice` and `wrong` on a terminal, unless NO_COLOR or TERM=dumb forbids it.
#[test]
fn doctor_uses_colours_on_a_terminal_only() {
    let green = "\x1b[32mok    \x1b[0m  versions ";
    let mut terminal = Terminal::start(&["doctor", "--quick"]);
    terminal.until(green);
    terminal.end();
    for variable in [("NO_COLOR", "1"), ("TERM", "dumb")] {
        let terminal = Terminal::start_with(&["doctor", "--quick"], Owner::Nobody, &[variable]);
        let (_, screen) = terminal.end();
        assert!(screen.contains("ok      versions ") && !screen.contains("\x1b["), "{screen}");
    }
    assert!(!crate::common::run(["doctor", "--quick"]).out.contains('\x1b'));
}
