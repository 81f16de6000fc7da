//! Files of a slave.

use crate::{network, refused};

/// BUS-5.1 A file of any length is written and read back; a refusal is reported with the slave's error.
#[test]
fn files_are_moved_both_ways() {
    let (mut network, _) = network("drive,dp3cl");
    for len in [0, 1, 115, 116, 117, 5000] {
        let content: Vec<u8> = (0..len).map(|n| n as u8).collect();
        network.write_file(1, "table.csv", 0, &content).expect("it is written");
        assert_eq!(network.read_file(1, "table.csv", 0).expect("it is read"), content, "{len}");
    }
    assert_eq!(network.read_file(1, "firmware", 0).expect("it is read"), b"firmware of a simulated drive\n");
    let said = refused(network.write_file(1, "firmware", 0, &[1]));
    assert!(said.contains("file firmware") && said.contains("bootstrap"), "{said}");
    let said = refused(network.read_file(1, "none", 0));
    assert!(said.contains("not found") && said.contains("manual"), "{said}");
    for said in [refused(network.read_file(2, "a", 0)), refused(network.write_file(2, "a", 0, &[]))] {
        assert!(said.contains("slave 2 has no files: its EEPROM declares no FoE"), "{said}");
    }
}
