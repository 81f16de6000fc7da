//! A network that an ECM-XF has.

use ecmsk::bus;
use ecmsk::coe::{ObjectAddress, SdoScope};

use crate::refused;

/// BUS-8.1 Slaves are numbered from 1, in virtual time, and their objects are read and written; what the chip has no command for is
/// said.
#[test]
fn a_chip_is_a_network() {
    let mut network = bus::open("xf-sim:?slaves=drive,io").expect("a network");
    assert!(network.is_virtual() && !network.resets_slaves());
    let slaves = network.scan().expect("slaves");
    let found: Vec<_> = slaves.iter().map(|slave| (slave.slave, slave.identity.vendor, slave.has_clock)).collect();
    assert_eq!(found, [(1, 0x4543_4D53, true), (2, 0x4543_4D53, false)]);
    let speed = ObjectAddress::new(0x6099, 1);
    network.download(1, speed, SdoScope::Entry, &[7, 0, 0, 0]).expect("it is written");
    assert_eq!(network.upload(1, speed, SdoScope::Entry).expect("it is read"), [7, 0, 0, 0]);
    let said = refused(network.upload(2, speed, SdoScope::Entry));
    assert!(said.contains("slave 2, object 0x6099:1") && said.contains("does not exist"), "{said}");
    for slave in [0, 3] {
        let said = refused(network.upload(slave, speed, SdoScope::Entry));
        assert!(said.contains(&format!("there is no slave {slave}, but 2 slaves")), "{said}");
    }
    let said = refused(network.object_list(1));
    assert!(said.contains("an ECM-XF has no command to") && said.contains("--link nic:eth1"), "{said}");
    let said = refused(bus::open("xf-sim:?slaves=none").expect("a network").scan());
    assert!(said.contains("no slave answers"), "{said}");
}
