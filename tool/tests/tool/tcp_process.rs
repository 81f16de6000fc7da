//! `ecmsk serve tcp`, and processes that are killed while axes move.
#![cfg(unix)]

use std::process::{Command, Stdio};

use crate::common::serving::Serving;
use crate::common::{Ran, ecmsk, without_times};
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Slave};
use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterState};
use rustix::process::Signal;
use support::tcp::{LIMIT, options, serve_with, until, uri};

/// A server of two drives.
fn serving() -> Serving {
    let serving = Serving::start("tcp", &["--link", "sim:?slaves=drive*2"]);
    let line = &serving.first_line;
    assert!(line.contains("serving sim:") && line.contains("slots of 12 bytes, real clock"), "{line}");
    serving
}

/// The tool prints its address, what it serves, and the clients that come and go; it ends by SIGINT and SIGTERM, and
/// informs its clients.
#[test]
fn the_tool_serves_until_it_is_stopped() {
    for (signal, name) in [(Signal::INT, "SIGINT"), (Signal::TERM, "SIGTERM")] {
        let mut serving = serving();
        let link = link::open(&serving.link(), Share::ByName).unwrap();
        let came = serving.wait_for("is a writer");
        let came = without_times(&came);
        assert!(came.starts_with("serve: ") && came.contains(&format!("PID {}", std::process::id())), "{came}");
        link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
        serving.signal(signal);
        let end = until("the end", || link.read(&mut Frame::new(), Wait::For(LIMIT)).err());
        assert!(matches!(&end, LinkError::Lost { reason, .. } if reason.contains("stopped")), "{end:?}");
        let rest = serving.ended();
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
    let mut serving = serving();
    let ecm = in_op(&serving.link());
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
