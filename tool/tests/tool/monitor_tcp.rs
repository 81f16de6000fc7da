//! `ecmsk monitor` of a board on the network: it is one of the readers, and the writer goes on.
#![cfg(unix)]

use crate::common::run;
use crate::common::serving::Serving;
use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, SlotSize};
use serde_json::Value;

/// `monitor` of a served board is a reader beside the writer, whatever role its link names, and sends nothing. The same holds
/// for other verbs that only show something.
#[test]
fn a_monitor_is_a_reader() {
    let server = Serving::start("tcp", &["--link", "sim:?slaves=drive*2"]);
    let writer = link::open(&server.link(), Share::ByName).expect("a board");
    for role in ["", "?role=writer", "?role=reader"] {
        let link = server.link() + role;
        let out = run(["monitor", "--link", &link, "--json", "--seconds", "0.2"]).expect_quiet();
        let last: Value = serde_json::from_str(out.lines().last().expect("a view")).expect("an object");
        assert_eq!((&last["slots"][0]["state"], &last["counters"]["frames"]), (&"PreOP".into(), &0.into()), "{role}");
    }
    for (verb, shown) in [("info", "state       PreOP"), ("state", "PreOP")] {
        let said = run([verb, "--link", &server.link()]).expect_quiet();
        assert!(said.contains(shown), "{verb}: {said}");
    }
    let mut frame = Frame::new();
    frame.put_master(SlotSize::Bytes12, &MasterCommand::GetStatus);
    writer.write(&frame, Wait::Forever).expect("the writer is still the writer");
    writer.close();
    let said = server.end();
    assert_eq!((said.matches(" is a writer").count(), said.matches(" is a reader").count()), (1, 5), "{said}");
}
