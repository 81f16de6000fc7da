//! `ecmsk stop`: a second terminal stops the axes that another program moves.
#![cfg(unix)]

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::Stdio;

use crate::common::{Ran, ecmsk, run};
use ecmsk::ecm::{Config, Ecm};
use serde_json::json;
use support::tcp::{LIMIT, serve, until, uri};

/// A `move` through a server is stopped: its axes stand and stay on, it fails and says who has stopped it, and `stop`
/// says whom it has stopped. A second stop finds nobody, and switches the axes off.
#[test]
fn a_second_terminal_stops_what_a_program_moves() {
    let (server, told) = serve("sim:?slaves=drive*2");
    let link = uri(&server, "");
    let words = ["move", "1=100000000", "--velocity", "20000", "--yes", "--up", "--machine", "none", "--link", &link];
    let mut moving = ecmsk(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let reader = Ecm::open(&uri(&server, "role=reader")).unwrap();
    reader.adopt(&Config::drives(2)).unwrap();
    let position = || reader.next_cycle(LIMIT).unwrap().position(1).unwrap();
    until("a motion", || (position() > 1000).then_some(()));

    let name = format!("ecmsk (PID {}) at 127.0.0.1:", moving.id());
    let said = run(["stop", "--machine", "none", "--link", &link]).expect_quiet();
    assert!(said.starts_with(&format!("axes stand still; {name}")) && said.ends_with(" was stopped\n"), "{said}");
    // Reports of before the stop may still wait to be read.
    until("a standstill", || {
        let from = position();
        (0..200).all(|_| position().abs_diff(from) <= 2).then_some(())
    });
    assert!(reader.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled());
    let mut error = String::new();
    moving.stderr.take().unwrap().read_to_string(&mut error).unwrap();
    assert_eq!(moving.wait().unwrap().code(), Some(1), "{error}");
    assert!(error.contains("stopped by another client, ecmsk (PID "), "{error}");
    told.wait("was stopped by ecmsk (PID ");

    let said = run(["stop", "--servo-off", "--json", "--machine", "none", "--link", &link]).expect_quiet();
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    let shown = json!({"verb": "stop", "in_op": true, "servo_off": true, "stopped": null, "text": null});
    assert_eq!(said, shown);
    until("axes that are off", || {
        let seen = reader.next_cycle(LIMIT).unwrap();
        (!seen.drive(1).unwrap().statusword.is_enabled()).then_some(())
    });
}

/// A simulated board that the verb opens itself is not the one that moves: never a success. Nor is a server that is not
/// there, and the error says what to do if axes move.
#[test]
fn a_board_that_is_not_served() {
    // No server at the default port has such a board.
    let link = "sim:?slaves=hsp*7,step&clock=virtual";
    run(["stop", "--machine", "none", "--link", link]).expect_failure(
        1,
        &["is a new board of this program, on which nothing moves"],
        "`ecmsk stop --link tcp://localhost:PORT`",
    );
    run(["stop", "--machine", "none", "--link", "tcp://127.0.0.1:1"]).expect_failure(
        1,
        &["nobody listens there; start `ecmsk serve tcp"],
        "use the emergency stop if axes move",
    );
}

/// A server that is killed in a motion brakes nothing: the error of the move says that axes may go on. A stop that finds
/// no server says what to do then.
#[test]
fn a_server_that_is_killed_in_a_motion() {
    let words = ["serve", "tcp", "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive", "--machine", "none"];
    let mut server = ecmsk(words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.strip_prefix("listening on ").and_then(|rest| rest.split(';').next()).expect(&line).to_owned();
    let link = format!("tcp://{address}");
    let words = ["move", "1=100000000", "--velocity", "20000", "--yes", "--up", "--machine", "none", "--link", &link];
    let moving = ecmsk(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let reader = until("a board", || Ecm::open(&format!("{link}?role=reader")).ok());
    reader.adopt(&Config::drives(1)).unwrap();
    until("a motion", || (reader.next_cycle(LIMIT).unwrap().position(1).unwrap() > 1000).then_some(()));
    server.kill().unwrap();
    server.wait().unwrap();
    let moved = Ran::from(moving.wait_with_output().unwrap());
    assert_eq!(moved.code, Some(1), "{moved:?}");
    assert!(moved.err.ends_with("; axes may go on: use the emergency stop if they do\n"), "{moved:?}");
    run(["stop", "--machine", "none", "--link", &link]).expect_failure(
        1,
        &["nobody listens there"],
        "use the emergency stop if axes move",
    );
}
