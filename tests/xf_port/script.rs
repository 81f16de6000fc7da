//! `script=` of a chip that is opened as one.

use std::path::Path;

use ecmsk::link::chip::{self, ChipError};
use ecmsk::port::xf::{Options, Server};
use ecmsk::xf::EtherCatState;
use ecmsk::xf::host::Wires;
use ecmsk::xf::request::Slaves;
use ecmsk::xf_api::{NetworkConfig, Xf};

use crate::client::{Remote, any_port};

fn link(script: &Path, keys: &str) -> String {
    format!("xf-sim:?slaves=drive*2&clock=virtual&script={}{keys}", script.display())
}

/// XF-11.75 A script's refusal of SafeOP for 20 s works behind a chip that a program opens, behind one that is served,
/// and with either network; then the slave accepts it.
#[test]
fn a_script_happens_to_the_slaves_of_a_chip() {
    fn safe_op<L: chip::ChipLink>(xf: &mut Xf<L>) -> bool {
        xf.set_state(Slaves::All, EtherCatState::SafeOp).is_ok()
    }
    fn run<L: chip::ChipLink>(mut xf: Xf<L>) {
        xf.start_network(&NetworkConfig::default()).expect("a network");
        xf.set_state(Slaves::All, EtherCatState::PreOp).expect("PreOP");
        assert!(!safe_op(&mut xf), "the script refuses it");
        let later = xf.link_mut().now() + 30_000_000_000;
        xf.link_mut().wait_until(later).expect("it waits");
        assert!(safe_op(&mut xf), "it is over");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("refuse.ecmscript");
    std::fs::write(&script, "refuse 2 safeop for 20s\n").expect("it is written");
    for keys in ["&network=models", "&network=controllers"] {
        let uri = link(&script, keys);
        run(Xf::open(&uri).expect("it starts"));
        let options = Options { listen: any_port(), ..Options::default() };
        let server = Server::start(move || chip::open(&uri), options).expect("it is served");
        run(Xf::over(Remote::connect(server.listen()), Default::default()).expect("it starts"));
    }
}

/// XF-11.75 With a missing script, or one with an unsupported event, opening the link fails with the line and the next
/// step.
#[test]
fn a_script_that_cannot_be_carried_out_refuses_the_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("wrong.ecmscript");
    let refused = |keys: &str| match chip::open(&link(&script, keys)) {
        Err(error @ ChipError::Script(_)) => error.to_string(),
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("it opens"),
    };
    assert!(refused("").contains("cannot read the script"), "{}", refused(""));
    for (text, keys, parts) in [
        ("silent for 1s", "", ["line 1", "happens to a board"]),
        ("\nnoise 1 10", "&network=models", ["line 2", "happens to frames"]),
        ("from op\nat 1s cut 1", "", ["line 2", "serve ethercat"]),
        ("alarm 3 0x7500", "", ["line 1", "column"]),
    ] {
        std::fs::write(&script, text).expect("it is written");
        let said = refused(keys);
        assert!(parts.iter().all(|part| said.contains(part)), "{text}: {said}");
    }
}
