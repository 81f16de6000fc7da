//! `ecmsk serve tcp`, and processes that are killed while axes move.
#![cfg(unix)]

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, Command, Stdio};

use crate::common::{Ran, ecmsk, without_times};
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Slave};
use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterState};
use rustix::process::{Pid, Signal, kill_process};
use support::tcp::{LIMIT, options, serve_with, until, uri};

/// A running `ecmsk serve tcp` on any free port; dropping the value kills it.
struct Serving {
    child: Child,
    address: String,
    says: BufReader<std::process::ChildStderr>,
}

impl Serving {
    fn start(keys: &str) -> Self {
        let mut command = ecmsk(["serve", "tcp", "--listen", "127.0.0.1:0", "--link"]);
        command.arg(format!("sim:?slaves=drive*2{keys}")).env_remove("ECMSK_TCP_SECRET");
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.strip_prefix("listening on ").and_then(|line| line.split(';').next());
        let address = address.unwrap_or_else(|| panic!("{line}")).to_owned();
        assert!(line.contains("serving sim:") && line.contains("slots of 12 bytes, real clock"), "{line}");
        let says = BufReader::new(child.stderr.take().unwrap());
        Self { child, address, says }
    }

    fn uri(&self) -> String {
        format!("tcp://{}", self.address)
    }

    /// Reads standard error until a line contains `part`; returns the line.
    fn wait(&mut self, part: &str) -> String {
        loop {
            let mut line = String::new();
            assert!(self.says.read_line(&mut line).unwrap() > 0, "no line with `{part}`");
            if line.contains(part) {
                return line;
            }
        }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The tool prints its address, what it serves, and the clients that come and go; it ends by SIGINT and SIGTERM, and
/// informs its clients.
#[test]
fn the_tool_serves_until_it_is_stopped() {
    for (signal, name) in [(Signal::INT, "SIGINT"), (Signal::TERM, "SIGTERM")] {
        let mut serving = Serving::start("");
        let link = link::open(&serving.uri(), Share::ByName).unwrap();
        let came = serving.wait("is a writer");
        let came = without_times(&came);
        assert!(came.starts_with("serve: ") && came.contains(&format!("PID {}", std::process::id())), "{came}");
        link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
        kill_process(Pid::from_child(&serving.child), signal).unwrap();
        let end = until("the end", || link.read(&mut Frame::new(), Wait::For(LIMIT)).err());
        assert!(matches!(&end, LinkError::Lost { reason, .. } if reason.contains("stopped")), "{end:?}");
        assert_eq!(serving.child.wait().unwrap().code(), Some(0));
        let mut rest = String::new();
        serving.says.read_to_string(&mut rest).unwrap();
        assert!(rest.contains(name), "{rest}");
    }
}

/// A link or address that cannot be served ends with 1 and says what to do.
#[test]
fn a_link_or_address_that_cannot_be_served_is_an_error() {
    let serve = |arguments: &[&str]| -> Ran {
        let mut command = ecmsk(["serve", "tcp"]);
        command.args(arguments).env_remove("ECMSK_TCP_SECRET").output().unwrap().into()
    };
    for (arguments, part) in [
        (&["--link", "sim:", "--listen", "0.0.0.0:0"][..], "--secret-file"),
        (&["--link", "sim:?slaves=none", "--listen", "127.0.0.1:0"], "slaves="),
        (&["--link", "sim:", "--listen", "127.0.0.1:0", "--secret-file", "/does/not/exist"], "make one"),
    ] {
        let ran = serve(arguments);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.err.contains(part) && ran.out.is_empty(), "{ran:?}");
    }
    for arguments in [&["--link", "sim:", "--on-vanish", "fly"][..], &["--link", "sim:", "--max-clients", "0"], &[]] {
        assert_eq!(serve(arguments).code, Some(2));
    }
}

fn in_op(uri: &str) -> Ecm {
    let ecm = Ecm::open(uri).unwrap();
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV)];
    ecm.configure(&Config { slaves, ..Config::default() }).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1, 2]).unwrap();
    ecm
}

/// When a server is killed while axes move, every call of its clients ends at once with an error.
#[test]
fn killing_the_server_ends_every_call_of_its_clients() {
    let mut serving = Serving::start("");
    let ecm = in_op(&serving.uri());
    let mut stream = ecm.stream(16).unwrap();
    let mut killed = false;
    let mut n = 0;
    let error = loop {
        n += 1;
        let stepped = stream.csp(1, n * 10).and_then(|()| stream.step());
        if let Err(error) = stepped {
            break error;
        }
        if n == 100 {
            serving.child.kill().unwrap();
            killed = true;
        }
    };
    assert!(killed && matches!(error, EcmError::Link(LinkError::Lost { .. } | LinkError::Unsure { .. })), "{error:?}");
    drop(stream);
    assert!(matches!(ecm.close(Close::Hold), Err(EcmError::Link(LinkError::Lost { .. }))));
}

/// The environment variable with the link to the server. A test program that is started with it is the writer that is killed.
const WRITER: &str = "ECMSK_TEST_WRITER";

/// TCP-9 When a writer is killed while axes move, the server brings them to a standstill.
#[test]
fn killing_the_writer_has_the_server_stop_its_axes() {
    if let Ok(uri) = std::env::var(WRITER) {
        let ecm = in_op(&uri);
        let mut stream = ecm.stream(16).unwrap();
        for n in 0.. {
            stream.csp(1, n * 10).unwrap();
            stream.csv(2, 100_000).unwrap();
            stream.step().unwrap();
        }
    }
    let (options, told) = options();
    let server = serve_with("sim:?slaves=drive*2", options);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args(["--exact", "tcp_process::killing_the_writer_has_the_server_stop_its_axes"])
        // With this keep-alive time a lost writer would be noticed only after hours. So the axes stop because the server sees
        // the end of the connection at once.
        .env(WRITER, uri(&server, "keepalive_ms=3600000"));
    let mut writer = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let reader = link::open(&uri(&server, "role=reader"), Share::ByName).unwrap();
    let mut report = Frame::new();
    let position = |report: &Frame| report.slot(support::tcp::SIZE, 1).data1 as i32;
    until("motion", || {
        reader.read(&mut report, Wait::For(LIMIT)).unwrap();
        (position(&report) > 500).then_some(())
    });
    writer.kill().unwrap();
    writer.wait().unwrap();
    let line = told.wait("stand still");
    assert!(line.contains(&format!("PID {}", writer.id())), "{line}");
    let ecm = until("place for a writer", || Ecm::open(&uri(&server, "")).ok());
    ecm.adopt(&Config::drives(2)).unwrap();
    let first = ecm.next_cycle(LIMIT).unwrap();
    let later = (0..100).map(|_| ecm.next_cycle(LIMIT).unwrap()).last().unwrap();
    for slave in [1, 2] {
        let moved = later.position(slave).unwrap() - first.position(slave).unwrap();
        assert!(moved.abs() < 20, "slave {slave}: {moved}");
        assert!(later.drive(slave).unwrap().statusword.is_enabled());
    }
    ecm.close(Close::Leave).unwrap();
}
