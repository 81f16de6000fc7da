//! Verbs that move axes while their output is not read: a full pipe, a terminal that is full or stopped. They move,
//! obey Ctrl-C, brake and end.
#![cfg(target_os = "linux")]

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::process::{Child, Stdio};
use std::thread;

use crate::common::ecmsk;
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::port::tcp::Server;
use ecmsk::sk::Frame;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, tcflow};
use std::sync::Arc;
use support::full_pipe;
use support::tcp::{LIMIT, SIZE, serve, until, uri};

/// Which output of the tool takes no bytes, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stalled {
    OutPipe,
    ErrPipe,
    BothPipes,
    FullTerminal,
    HeldTerminal,
}

/// The running tool, with an output that takes no bytes as long as this value lives.
struct Work {
    child: Child,
    _unread: Vec<File>,
}

impl Work {
    fn start(words: &[&str], stalled: Stalled) -> Self {
        let mut command = ecmsk(words);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut unread = Vec::new();
        let mut pipe = || {
            let (reader, writer) = full_pipe();
            unread.push(File::from(std::os::fd::OwnedFd::from(reader)));
            writer
        };
        match stalled {
            Stalled::OutPipe => _ = command.stdout(pipe()),
            Stalled::ErrPipe => _ = command.stderr(pipe()),
            Stalled::BothPipes => _ = command.stdout(pipe()).stderr(pipe()),
            Stalled::FullTerminal | Stalled::HeldTerminal => {
                let (master, name) = terminal();
                let tty = || File::options().read(true).write(true).open(&name).unwrap();
                let mut own = tty();
                if stalled == Stalled::HeldTerminal {
                    tcflow(&own, Action::OOff).unwrap();
                } else {
                    fcntl_setfl(&own, fcntl_getfl(&own).unwrap() | OFlags::NONBLOCK).unwrap();
                    while own.write(&[b'.'; 64]).is_ok() {}
                }
                command.stdout(tty()).stderr(tty());
                unread.extend([master, own]);
            }
        }
        Self { child: command.spawn().unwrap(), _unread: unread }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for the tool's end; returns its exit code.
    fn ends(mut self) -> Option<i32> {
        until("the end of the tool", || self.child.try_wait().unwrap()).code()
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

fn terminal() -> (File, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (File::from(master), name)
}

/// A reader of a served board, for the position of axis 1.
struct Look(Arc<dyn Link>);

impl Look {
    fn at(server: &Server) -> Self {
        Self(link::open(&uri(server, "role=reader"), Share::ByName).unwrap())
    }

    fn position(&self) -> i32 {
        let mut report = Frame::new();
        self.0.read(&mut report, Wait::For(LIMIT)).unwrap();
        report.slot(SIZE, 1).data1 as i32
    }

    /// Two positions of the axis, 50 reports apart.
    fn twice(&self) -> [i32; 2] {
        [0; 2].map(|_| (0..50).fold(0, |_, _| self.position()))
    }

    fn until_beyond(&self, position: i32) {
        until("motion", || (self.position().abs() > position).then_some(()));
    }
}

const ALL: [Stalled; 5] =
    [Stalled::OutPipe, Stalled::ErrPipe, Stalled::BothPipes, Stalled::FullTerminal, Stalled::HeldTerminal];

/// Runs a test for all cases at the same time, each in a thread.
fn at_once<T: Send>(cases: impl IntoIterator<Item = T>, run: impl Fn(T) + Sync) {
    let run = &run;
    thread::scope(|scope| cases.into_iter().for_each(|case| _ = scope.spawn(move || run(case))));
}

/// A move whose output is not read goes on and brakes at Ctrl-C, and the tool closes the board and ends by itself: with
/// lines and with JSON, on a pipe and on a terminal.
#[test]
fn a_move_obeys_ctrl_c() {
    at_once(ALL.into_iter().flat_map(|stalled| [false, true].map(|json| (stalled, json))), |(stalled, json)| {
        let (server, told) = serve("sim:?slaves=drive");
        let look = Look::at(&server);
        let link = uri(&server, "");
        let mut words = vec!["move", "1=9000000", "--velocity", "100000", "--up", "--link", &link];
        words.extend(json.then_some("--json"));
        let work = Work::start(&words, stalled);
        // When the axis has gone so far, the tool has printed progress.
        look.until_beyond(150_000);
        work.signal(Signal::INT);
        assert_eq!(work.ends(), Some(130), "{stalled:?}, JSON: {json}");
        told.wait("has closed its link");
        let [stands, later] = Look::at(&server).twice();
        assert!(stands < 9_000_000 && later.abs_diff(stands) < 3, "{stalled:?}, JSON: {json}: {stands} {later}");
    });
}

/// Ctrl-C ends a homing whose output is not read, and the tool ends by itself.
#[test]
fn homing_obeys_ctrl_c() {
    at_once(ALL, |stalled| {
        let (server, told) = serve("sim:?slaves=drive");
        let look = Look::at(&server);
        let link = uri(&server, "");
        let line = ["home", "1", "--method", "1", "--up", "--link", &link];
        let work = Work::start(&line, stalled);
        look.until_beyond(1_000);
        work.signal(Signal::INT);
        assert_eq!(work.ends(), Some(130), "{stalled:?}");
        told.wait("has closed its link");
        let [stands, later] = Look::at(&server).twice();
        assert!(later.abs_diff(stands) < 3, "{stalled:?}: {stands} {later}");
    });
}

/// The tool waits until its result is read, with the axes at a standstill. So a slow reader gets the whole result, and the tool
/// succeeds.
#[test]
fn a_result_waits_for_its_reader() {
    let (server, _told) = serve("sim:?slaves=drive");
    let look = Look::at(&server);
    let link = uri(&server, "");
    let (mut reader, writer) = full_pipe();
    let mut command = ecmsk(["move", "1=2000", "--up", "--link", &link]);
    let mut child = command.stdout(writer).stderr(Stdio::null()).spawn().unwrap();
    drop(command);
    look.until_beyond(1_998);
    // The axis has arrived, and the output has not been read.
    for _ in 0..1000 {
        look.position();
    }
    assert!(child.try_wait().unwrap().is_none(), "the result is not told yet");
    let said = thread::spawn(move || {
        let mut said = String::new();
        reader.read_to_string(&mut said).unwrap();
        said
    });
    assert_eq!(until("the end of the tool", || child.try_wait().unwrap()).code(), Some(0));
    assert_eq!(said.join().unwrap().trim_start_matches('.'), "axis 1: at 2000\n");
}
