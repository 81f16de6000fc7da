//! Kinds of networks, the scan, and the effects of a cut cable.

use std::time::Duration;

use ecmsk::bus;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{AL_CONTROL, AL_STATUS, RequestedState, TYPE};
use ecmsk::ethercat::{AlState, AlStatus};

use crate::{network, refused, with_script};

/// A board's link is refused with the alternative; an invalid link, and one without slaves, are reported.
#[test]
fn a_board_is_no_network() {
    for link in ["usb:", "spi:/dev/spidev0.0", "tcp://press:4000"] {
        let said = refused(bus::open(link));
        assert!(said.contains("is a board") && said.contains("`ecmsk info`"), "{said}");
    }
    assert!(refused(bus::open("sim:?slave=drive")).contains("slave"));
    let none = refused(bus::open("sim:?slaves=none").expect("a network").scan());
    assert!(none.contains("no slave answers; look at the cable"), "{none}");
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("a.ecmscript");
    std::fs::write(&script, "at 1s silent for 2s\n").expect("it is written");
    let said = refused(bus::open(&format!("sim:?slaves=io&script={}", script.display())));
    assert!(said.contains("`silent` happens to a board"), "{said}");
}

/// Identity, name, clock and mailbox of each slave, and how they are connected.
#[test]
fn slaves_are_found_in_their_order() {
    let (mut network, slaves) = network("drive,io,dp3cl");
    assert!(network.is_virtual());
    assert_eq!(
        slaves.iter().map(|slave| (slave.slave, &*slave.name)).collect::<Vec<_>>(),
        [(1, "drive"), (2, "io"), (3, "dp3cl")]
    );
    let upstream: Vec<_> = slaves.iter().map(|slave| slave.upstream.map(|up| (up.slave, up.port))).collect();
    assert_eq!(upstream, [None, Some((1, 1)), Some((2, 1))]);
    assert_eq!(slaves.iter().map(|slave| slave.has_clock).collect::<Vec<_>>(), [true, false, true]);
    assert_eq!((slaves[2].identity.vendor, slaves[2].process_bytes), (0x556, (Some(8), Some(19))));
    assert!(slaves.iter().all(|slave| slave.port_types == 0x0F && slave.ports.has_link(0)));
    let mut kind = [0];
    network.read(1, TYPE, &mut kind).expect("a register");
    assert_eq!(kind, [0x11]);
}

/// A slave's state is read before the scan. Then all are in Init, and a call that needs a mailbox brings one slave to
/// PreOP.
#[test]
fn states_are_told_and_none_is_above_preop() {
    let (mut network, slaves) = network("io*2");
    assert!(slaves.iter().all(|slave| slave.found.status.state() == RequestedState::State(AlState::Init)));
    network.upload(2, ObjectAddress::new(0x1000, 0), SdoScope::Entry).expect("a value");
    let state = |network: &mut dyn bus::Network, slave| {
        let mut status = [0; 2];
        network.read(slave, AL_STATUS, &mut status).expect("a register");
        status[0]
    };
    assert_eq!([1, 2].map(|slave| state(&mut *network, slave)), [1, 2]);
    // A refused change of state sets an error.
    network.write(2, AL_CONTROL, &[8, 0]).expect("a register");
    network.wait(Duration::from_millis(10)).expect("time");
    let found = network.scan().expect("slaves");
    let (status, code) = (found[1].found.status, found[1].found.code);
    assert_eq!((status.0, code), (0x12, AlStatus::INVALID_CHANGE));
    assert_eq!([1, 2].map(|slave| state(&mut *network, slave)), [1; 2]);
}

/// There is no slave 0, and none after the last one; a lost slave is distinguished from one that refuses.
#[test]
fn a_cut_cable_ends_everything() {
    let (mut network, _) = network("io");
    for slave in [0, 2, 255] {
        let said = refused(network.read(slave, TYPE, &mut [0]));
        assert!(said.contains(&format!("there is no slave {slave}, but 1 slave")), "{said}");
    }
    let (mut network, slaves) = with_script("drive*2", "at 1s cut 2\n");
    assert_eq!(slaves.len(), 2);
    let object = ObjectAddress::new(0x1000, 0);
    network.upload(2, object, SdoScope::Entry).expect("a value");
    network.wait(Duration::from_secs(1)).expect("time");
    network.upload(1, object, SdoScope::Entry).expect("a value of the one before");
    for said in [
        refused(network.read(2, TYPE, &mut [0])),
        refused(network.upload(2, object, SdoScope::Entry)),
        refused(network.download(2, object, SdoScope::Entry, &[1])),
        refused(network.object_list(2)),
        refused(network.read_file(2, "a", 0)),
        refused(network.read_eeprom_words(2, 0, 8)),
        refused(network.write_eeprom_words(2, 0, &[1])),
    ] {
        assert!(said.contains("slave 2") && said.contains("check"), "{said}");
    }
    let (mut network, _) = with_script("io", "at 500ms cut 1\n");
    network.wait(Duration::from_secs(1)).expect("time");
    assert!(refused(network.read(1, TYPE, &mut [0])).contains("the frame did not come back"));
    assert!(refused(network.scan()).contains("no slave answers"));
}
