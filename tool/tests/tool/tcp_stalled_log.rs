//! Servers whose log is not read, because its pipe is full or because the program's function for messages does not return.
//! Axes, clients and the end of the server do not wait for it.
#![cfg(target_os = "linux")]

use std::io::{BufRead as _, BufReader, PipeReader, Read as _};
use std::net::SocketAddr;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;

use crate::common::ecmsk;
use crate::common::serving::Serving;
use ecmsk::ecm::{Axis, Config, Ecm, Slave};
use ecmsk::link::{self, Share, Wait};
use ecmsk::port::tcp::ServeOptions;
use ecmsk::sk::{Frame, MasterState};
use rustix::process::{Pid, Signal, kill_process};
use support::full_pipe;
use support::tcp::proxy::Cable;
use support::tcp::{LIMIT, Raw, SIZE, options, serve_with, until};

/// Starts a server of two drives with a standard error that is a full pipe. Returns it and the reading end of the pipe.
fn serving(port: &str, log: &str) -> (Serving, PipeReader) {
    let (reader, writer) = full_pipe();
    let mut command = ecmsk(["serve", port, "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive*2"]);
    command.env("ECMSK_LOG", log).env_remove("ECMSK_TCP_SECRET");
    (Serving::of(command.stdout(Stdio::piped()).stderr(writer).spawn().unwrap()), reader)
}

fn ends(child: &mut Child) {
    kill_process(Pid::from_child(child), Signal::TERM).unwrap();
    let status = until("the end", || child.try_wait().unwrap());
    assert_eq!(status.code(), Some(0));
}

/// Clients with another protocol are refused, and the connection of a writer whose axes move is cut. Then the axes stand still,
/// one in CSP and one in CSV, and new clients are accepted, also a writer.
fn a_writer_vanishes(server: SocketAddr) {
    for _ in 0..50 {
        Raw::dial_to(server).send(b"GET / HTTP/1.1\r\n\r\n");
    }
    let cable = Cable::to(server);
    let ecm = Ecm::open(&format!("tcp://{}", cable.address)).unwrap();
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV)];
    ecm.configure(&Config { slaves, ..Config::default() }).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1, 2]).unwrap();
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..300 {
        stream.csp(1, n * 10).unwrap();
        stream.csv(2, 100_000).unwrap();
        stream.step().unwrap();
    }
    cable.cut();
    let reader = link::open(&format!("tcp://{server}?role=reader"), Share::ByName).unwrap();
    let mut report = Frame::new();
    let (mut last, mut still) = ([0; 2], 0);
    until("a standstill", || {
        reader.read(&mut report, Wait::For(LIMIT)).unwrap();
        let now = [1, 2].map(|slave| report.slot(SIZE, slave).data1 as i32);
        // The position of an axis that is held may vary by a count.
        let stands = (0..2).all(|axis| i32::abs(now[axis] - last[axis]) < 3);
        still = if stands { still + 1 } else { 0 };
        last = now;
        (still == 100).then_some(())
    });
    until("place for a writer", || link::open(&format!("tcp://{server}"), Share::ByName).ok()).close();
}

/// TCP-25 TCP-9 With a standard error that takes nothing, `ecmsk serve tcp` brakes the axes of a writer that is cut off, takes
/// clients in and ends by SIGTERM; the same with the most verbose log.
#[test]
fn a_full_pipe_stops_nothing() {
    for level in ["off", "trace"] {
        let (mut serving, _unread) = serving("tcp", level);
        a_writer_vanishes(serving.address().parse().unwrap());
        ends(&mut serving.child);
    }
}

/// TCP-25 A pipe that is read again gets the newest lines, and the number of missing ones.
#[test]
fn a_pipe_that_is_read_again_gets_the_newest_lines_and_the_number_of_missing_ones() {
    let (mut serving, mut unread) = serving("tcp", "off");
    // The server logs at least two lines for each writer, in all more lines than its queue holds.
    for _ in 0..700 {
        link::open(&serving.link(), Share::ByName).unwrap().close();
    }
    a_writer_vanishes(serving.address().parse().unwrap());
    let text = thread::spawn(move || {
        let mut text = String::new();
        unread.read_to_string(&mut text).unwrap();
        text
    });
    ends(&mut serving.child);
    let text = text.join().unwrap();
    assert!(text.contains("lines were dropped") || text.contains("more times"), "{text}");
    assert!(text.contains("axes stand still after") && text.contains("stopped by SIGTERM"), "{text}");
}

/// TCP-25 Standard output may be full, too: the server serves, and ends by SIGTERM.
#[test]
fn a_standard_output_that_nobody_reads_stops_nothing() {
    for port in ["tcp", "usbip"] {
        let (_unread, writer) = full_pipe();
        let (said, err) = std::io::pipe().unwrap();
        let mut command = ecmsk(["serve", port, "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive*2"]);
        let mut child = command.env_remove("ECMSK_TCP_SECRET").stdout(writer).stderr(err).spawn().unwrap();
        drop(command);
        let mut line = String::new();
        BufReader::new(said).read_line(&mut line).unwrap();
        assert!(line.contains("standard output takes nothing"), "{line}");
        ends(&mut child);
    }
}

/// `ecmsk serve usbip` ends by SIGTERM, too, while its output is not read.
#[test]
fn usbip_ends_with_a_full_pipe() {
    let (mut serving, _unread) = serving("usbip", "trace");
    for _ in 0..50 {
        Raw::dial_to(serving.address().parse().unwrap()).send(&[7; 8]);
    }
    ends(&mut serving.child);
}

/// TCP-25 TCP-9 The server calls the program's function for messages in a thread of its own. If the function never returns,
/// axes are braked all the same, clients are accepted, and the server can be stopped.
#[test]
fn a_stuck_function_stops_nothing() {
    let (goes_on, stuck) = mpsc::channel::<()>();
    let stuck = Mutex::new(stuck);
    let tell = Arc::new(move |_: &str| assert!(stuck.lock().unwrap().recv().is_err(), "nobody sends"));
    let server = serve_with("sim:?slaves=drive*2", ServeOptions { tell, ..options().0 });
    a_writer_vanishes(server.address());
    let (done, stopped) = mpsc::channel();
    thread::spawn(move || {
        server.stop();
        done.send(()).unwrap();
    });
    stopped.recv_timeout(LIMIT).expect("it stops while the function does not return");
    drop(goes_on);
}
