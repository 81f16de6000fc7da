//! `ecmsk monitor` of a board on the network: it is one of the readers, and the writer goes on.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;

use crate::common::{ecmsk, run};
use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, SlotSize};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// `monitor` of a served board is a reader beside the writer, whatever role its link names, and sends nothing. The same holds
/// for other verbs that only show something.
#[test]
fn a_monitor_is_a_reader() {
    let mut command = ecmsk(["serve", "tcp", "--link", "sim:?slaves=drive*2", "--listen", "127.0.0.1:0"]);
    let mut server = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts");
    let mut line = String::new();
    BufReader::new(server.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    let place = line.strip_prefix("listening on ").and_then(|rest| rest.split(';').next()).expect("where it listens");
    let writer = link::open(&format!("tcp://{place}"), Share::ByName).expect("a board");
    for role in ["", "?role=writer", "?role=reader"] {
        let link = format!("tcp://{place}{role}");
        let out = run(["monitor", "--link", &link, "--json", "--seconds", "0.2"]).expect_quiet();
        let last: Value = serde_json::from_str(out.lines().last().expect("a view")).expect("an object");
        assert_eq!((&last["slots"][0]["state"], &last["counters"]["frames"]), (&"PreOP".into(), &0.into()), "{role}");
    }
    for (verb, shown) in [("info", "state       PreOP"), ("state", "PreOP")] {
        let said = run([verb, "--link", &format!("tcp://{place}")]).expect_quiet();
        assert!(said.contains(shown), "{verb}: {said}");
    }
    let mut frame = Frame::new();
    frame.put_master(SlotSize::Bytes12, &MasterCommand::GetStatus);
    writer.write(&frame, Wait::Forever).expect("the writer is still the writer");
    writer.close();
    kill_process(Pid::from_raw(server.id() as i32).expect("a process"), Signal::TERM).expect("a signal is sent");
    let mut said = String::new();
    server.stderr.take().expect("a pipe").read_to_string(&mut said).expect("UTF-8");
    server.wait().expect("it ends");
    assert_eq!((said.matches(" is a writer").count(), said.matches(" is a reader").count()), (1, 5), "{said}");
}
