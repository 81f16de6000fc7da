//! Servers as services of systemd: they report when they are ready (sd_notify), and a service manager that does not read
//! holds nothing up.
#![cfg(target_os = "linux")]

use std::io::{BufRead as _, BufReader};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use crate::common::ecmsk;
use rustix::process::{Pid, Signal, kill_process};

/// `ecmsk serve tcp` that reports to `socket` as its service manager, and the first line of its output.
fn serve(socket: &Path) -> (Child, String) {
    let mut command = ecmsk(["serve", "tcp", "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive"]);
    command.env("NOTIFY_SOCKET", socket).env_remove("ECMSK_TCP_SECRET");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts");
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says where it listens");
    (child, line)
}

fn end(child: Child) -> String {
    kill_process(Pid::from_child(&child), Signal::TERM).expect("it runs");
    let ended = child.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(0), "{said}");
    said
}

/// A server tells its service manager that it is ready once it serves, with the line that it prints.
#[test]
fn a_service_is_ready_when_it_serves() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = folder.path().join("notify");
    let manager = UnixDatagram::bind(&socket).expect("a socket");
    manager.set_read_timeout(Some(Duration::from_secs(60))).expect("a time");
    let (child, line) = serve(&socket);
    let mut message = [0; 1000];
    let len = manager.recv(&mut message).expect("it reports");
    let text = String::from_utf8_lossy(&message[..len]).into_owned();
    assert_eq!(text, format!("READY=1\nSTATUS={line}"));
    end(child);
}

/// A server does not wait for a service manager that reads nothing or does not exist: it serves, and a signal ends it.
#[test]
fn a_service_manager_that_does_not_read_holds_nothing_up() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = folder.path().join("notify");
    let _deaf = UnixDatagram::bind(&socket).expect("a socket");
    let filler = UnixDatagram::unbound().expect("a socket");
    filler.set_nonblocking(true).expect("it may");
    while filler.send_to(b"full", &socket).is_ok() {}
    let (child, line) = serve(&socket);
    assert!(line.starts_with("listening on 127.0.0.1:"), "{line}");
    end(child);
    let (child, _) = serve(&folder.path().join("nobody"));
    let said = end(child);
    assert!(said.contains("warning: systemd does not know that the server is ready"), "{said}");
}
