//! `ecmsk monitor` on a terminal: it draws, scrolls, and leaves the terminal as it was, however it ends.
#![cfg(target_os = "linux")]

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::num::NonZero;
use std::os::fd::OwnedFd;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use crate::common::{ecmsk, with_default_signals};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, ControlModes, LocalModes, Termios, Winsize, tcflow, tcgetattr, tcsetwinsize};

const ROWS: NonZero<u16> = NonZero::new(20).expect("not 0");
const COLUMNS: NonZero<u16> = NonZero::new(90).expect("not 0");
/// The question for the status of a terminal, and its answer.
const QUESTION: &[u8] = b"\x1b[5n";
const ANSWER: &[u8] = b"\x1b[0n";

/// A terminal on which the tool runs.
pub(super) struct Terminal {
    pub(super) keyboard: File,
    /// The tool's end of the terminal. It keeps the terminal open, and the test reads the terminal's settings from it.
    pub(super) line: File,
    screen: Arc<Mutex<vt100::Parser>>,
    before: Termios,
    pub(super) tool: Child,
    /// Whether the terminal answers to the question for its status (ESC [5n).
    pub(super) answers: Arc<AtomicBool>,
    /// Ends the thread `reader`, because the handle from which it reads keeps the terminal open, too.
    end: Arc<AtomicBool>,
    reader: thread::JoinHandle<()>,
}

/// The process that has the terminal as its controlling terminal, and so gets SIGHUP when the terminal is closed.
#[derive(Clone, Copy, PartialEq)]
enum Owner {
    /// The tool: it gets the signal.
    Tool,
    /// No process: the tool has to notice the end by itself.
    Nobody,
}

impl Terminal {
    pub(super) fn start(arguments: &[&str]) -> Self {
        Self::start_as(arguments, Owner::Tool)
    }

    fn start_as(arguments: &[&str], owner: Owner) -> Self {
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
        grantpt(&keyboard).expect("a terminal");
        unlockpt(&keyboard).expect("a terminal");
        let name = ptsname(&keyboard, Vec::new()).expect("a name").into_string().expect("UTF-8");
        let line = OpenOptions::new().read(true).write(true).open(name).expect("a terminal");
        let size = Winsize { ws_row: ROWS.get(), ws_col: COLUMNS.get(), ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&line, size).expect("a terminal has a size");
        let before = tcgetattr(&line).expect("settings");
        let inner = ecmsk(arguments);
        // The terminal has to be the tool's own, independent of the tests' terminal.
        let mut command = Command::new("setsid");
        if owner == Owner::Tool {
            command.arg("--ctty");
        }
        command.arg(inner.get_program()).args(inner.get_args()).env("TERM", "xterm-256color");
        let mut command = with_default_signals(&command);
        let side = || OwnedFd::from(line.try_clone().expect("a file"));
        let tool = command.stdin(side()).stdout(side()).stderr(side()).spawn().expect("setsid starts");
        let screen = Arc::new(Mutex::new(vt100::Parser::new(ROWS, COLUMNS, 0)));
        let keyboard = File::from(keyboard);
        let (mut output, drawn) = (keyboard.try_clone().expect("a file"), Arc::clone(&screen));
        let end = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&end);
        let answers = Arc::new(AtomicBool::new(true));
        let (does_answer, mut keys) = (Arc::clone(&answers), keyboard.try_clone().expect("a file"));
        let reader = thread::spawn(move || {
            let mut bytes = [0; 4096];
            // The end of what was read before: a question may be cut.
            let mut asked = Vec::new();
            while !ends.load(Ordering::Relaxed) {
                let mut has_output = [PollFd::new(&output, PollFlags::IN)];
                let soon = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
                if poll(&mut has_output, Some(&soon)).expect("it can be asked") == 0 {
                    continue;
                }
                let Ok(n @ 1..) = output.read(&mut bytes) else { return };
                drawn.lock().expect("no panic").process(&bytes[..n]);
                for byte in &bytes[..n] {
                    asked.push(*byte);
                    if asked.ends_with(QUESTION) && does_answer.load(Ordering::Relaxed) {
                        // It fails when the tool has ended.
                        let _ = keys.write_all(ANSWER);
                    }
                }
                asked.drain(..asked.len().saturating_sub(QUESTION.len()));
            }
        });
        Self { keyboard, line, screen, before, tool, answers, end, reader }
    }

    /// Closes the terminal, as its window does; returns the tool.
    pub(super) fn hang_up(self) -> Child {
        self.end.store(true, Ordering::Relaxed);
        self.reader.join().expect("no panic");
        self.tool
    }

    pub(super) fn text(&self) -> String {
        self.screen.lock().expect("no panic").screen().contents()
    }

    /// Waits until `so` is true of the screen; `what` names the expected content in the error.
    #[track_caller]
    pub(super) fn until(&self, what: &str, so: impl Fn(&vt100::Screen) -> bool) {
        for _ in 0..12_000 {
            if so(self.screen.lock().expect("no panic").screen()) {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("never: {what}\n{}", self.text());
    }

    pub(super) fn type_keys(&mut self, keys: &[u8]) {
        self.keyboard.write_all(keys).expect("typed");
    }

    fn is_raw(&self) -> bool {
        let now = tcgetattr(&self.line).expect("settings");
        !now.local_modes.intersects(LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG)
    }

    pub(super) fn signal(&self, signal: Signal) {
        let pid = Pid::from_raw(self.tool.id() as i32).expect("a process");
        kill_process(pid, signal).expect("a signal is sent");
    }

    /// Waits for the tool's end, and checks that the terminal is as before.
    #[track_caller]
    pub(super) fn ended(mut self) -> Option<i32> {
        let code = ends(&mut self.tool);
        self.until("the screen of before", |screen| !screen.alternate_screen() && !screen.hide_cursor());
        let after = tcgetattr(&self.line).expect("settings");
        assert_eq!(after.local_modes, self.before.local_modes);
        assert_eq!(after.input_modes, self.before.input_modes);
        assert_eq!(after.output_modes, self.before.output_modes);
        // All modes except the speeds, which a pseudo-terminal does not have.
        let modes = ControlModes::CSIZE | ControlModes::CSTOPB | ControlModes::CREAD | ControlModes::PARENB;
        assert_eq!(after.control_modes & modes, self.before.control_modes & modes);
        code
    }
}

const BOARD: &[&str] = &["monitor", "--link", "sim:?slaves=drive*38,io*2", "--interval", "20ms"];

fn started() -> Terminal {
    started_as(Owner::Tool)
}

fn started_as(owner: Owner) -> Terminal {
    let terminal = Terminal::start_as(BOARD, owner);
    terminal.until("the table", |screen| screen.contents().contains("rows 1 to "));
    let screen = terminal.screen.lock().expect("no panic");
    assert!(screen.screen().alternate_screen() && screen.screen().hide_cursor());
    drop(screen);
    assert!(terminal.is_raw());
    terminal
}

/// The keys q and Ctrl-C end the monitor with exit code 0, and the terminal is as it was.
#[test]
fn q_and_ctrl_c_end_the_monitor_and_restore_the_terminal() {
    for key in [b"q" as &[u8], b"\x03", b"Q"] {
        let mut terminal = started();
        terminal.type_keys(key);
        assert_eq!(terminal.ended(), Some(0), "{key:?}");
    }
}

/// After SIGTERM, SIGINT and SIGHUP the terminal is as it was, and the exit code shows the signal.
#[test]
fn signals_end_the_monitor_and_restore_the_terminal() {
    for (signal, code) in [(Signal::TERM, 143), (Signal::INT, 130), (Signal::HUP, 129)] {
        let terminal = started();
        terminal.signal(signal);
        assert_eq!(terminal.ended(), Some(code), "{signal:?}");
    }
}

/// Waits for the end of a process that has to end by itself; returns its exit code. A process that does not end is killed, and
/// the test fails.
#[track_caller]
pub(super) fn ends(tool: &mut Child) -> Option<i32> {
    for _ in 0..12_000 {
        if let Some(status) = tool.try_wait().expect("it is ours") {
            return status.code();
        }
        thread::sleep(Duration::from_millis(10));
    }
    tool.kill().expect("it is ours");
    tool.wait().expect("it is ours");
    panic!("it goes on");
}

/// The monitor ends when its terminal is closed, even without a signal.
#[test]
fn a_closed_terminal_ends_the_monitor() {
    for owner in [Owner::Tool, Owner::Nobody] {
        let mut tool = started_as(owner).hang_up();
        assert_eq!(ends(&mut tool), Some(129));
    }
}

/// SIGTERM ends it though the terminal takes no output, and its modes are as they were.
#[test]
fn sigterm_ends_the_monitor_on_a_terminal_that_takes_no_output() {
    let mut terminal = started();
    tcflow(&terminal.line, Action::OOff).expect("output stops");
    // The terminal's output is not read meanwhile.
    terminal.type_keys(b"jjjj");
    terminal.signal(Signal::TERM);
    assert_eq!(ends(&mut terminal.tool), Some(143));
    assert_eq!(tcgetattr(&terminal.line).expect("settings").local_modes, terminal.before.local_modes);
}

/// `--seconds` ends the monitor by itself.
#[test]
fn the_monitor_ends_after_the_given_seconds() {
    let terminal = Terminal::start(&[BOARD, &["--seconds", "0.3"]].concat());
    assert_eq!(terminal.ended(), Some(0));
}

/// The table is live, and keys scroll through forty slaves; a board that is gone leaves its last values.
#[test]
fn keys_scroll_through_forty_slaves() {
    let mut terminal = started();
    // The terminal has 20 lines: 7 above the rows of the table and one below.
    terminal.until("the first rows", |screen| screen.contents().contains("rows 1 to 12 of 40"));
    for (keys, rows) in [
        (b"\x1b[B" as &[u8], "rows 2 to 13 of 40"),
        (b"\x1b[6~", "rows 12 to 23 of 40"),
        (b"\x1b[F", "rows 29 to 40 of 40"),
        (b"\x1b[B", "rows 29 to 40 of 40"),
        (b"\x1b[A", "rows 28 to 39 of 40"),
        (b"\x1b[5~", "rows 18 to 29 of 40"),
        (b"\x1b[H", "rows 1 to 12 of 40"),
        (b"G?", "rows 1 to 12 of 40"),
        (b"jj", "rows 3 to 14 of 40"),
        (b"k", "rows 2 to 13 of 40"),
    ] {
        terminal.type_keys(keys);
        terminal.until(rows, |screen| screen.contents().contains(rows));
    }
    let reports = |text: &str| {
        let begin = text.find("reports ").expect("a count") + "reports ".len();
        text[begin..].split(',').next().and_then(|n| n.parse::<u64>().ok()).expect("a number")
    };
    let first = reports(&terminal.text());
    terminal.until("more reports", |screen| reports(&screen.contents()) > first + 10);
    terminal.type_keys(b"q");
    assert_eq!(terminal.ended(), Some(0));

    let mut lost = Terminal::start(&["monitor", "--link", "sim:?fault.disconnect_ms=200", "--interval", "20ms"]);
    lost.until("the loss", |screen| screen.contents().contains("is gone"));
    lost.until("its last state", |screen| screen.contents().contains("state PreOP"));
    lost.type_keys(b"q");
    assert_eq!(lost.ended(), Some(0));
}
