//! Two cards at the ends of the cable.

mod needs_network_namespace {
    use ecmsk::bus;
    use masters::Rig;

    use crate::card::{CARD, LIST, doctor, finding, run};

    const RING: &str = "nic:veth0?second=veth2";

    /// In a ring the verbs find all slaves, read back what they have written, and `doctor` measures how long frames
    /// take from one card to the other; the same holds with a cut cable. Meanwhile both cards are in use.
    #[test]
    fn a_ring_is_looked_at_by_both_cards() {
        let rig = Rig::ring(LIST, "tool_ring");
        let names = || {
            let scanned = run(&["bus", "scan", "--json", "--link", RING]);
            scanned.lines().iter().map(|slave| slave["name"].as_str().expect("a name").to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(names(), ["drive", "drive", "io"]);
        run(&["bus", "sdo", "write", "2", "0x6099:1", "51234", "--link", RING]).good();
        for what in ["", "cut 2", "heal", "cut 1"] {
            rig.happen(what);
            assert_eq!(names(), ["drive", "drive", "io"], "{what}");
            let read = run(&["bus", "sdo", "read", "2", "0x6099:1", "--link", RING]);
            assert_eq!(read.good(), "51234 (0x0000C822)\n", "{what}");
            let trips = finding(&doctor(RING), "round-trip").cloned().expect("it is measured");
            assert_eq!(trips["figures"]["slaves"], 3, "{what}: {trips}");
            let errors = run(&["bus", "errors", "--clear", "--link", RING]);
            // Links that were lost, at either side of the cut.
            assert_eq!(errors.out.contains("lost link"), what.starts_with("cut"), "{what}: {errors:?}");
        }
        rig.happen("heal");
        let tree = run(&["bus", "scan", "--link", RING]).good();
        assert!(tree.contains(": the second card"), "{tree}");
        let network = bus::open(RING).expect("it opens");
        for card in [CARD, "nic:veth2"] {
            run(&["bus", "scan", "--link", card]).fails(1, &["is in use by another program of ecmsk"]);
        }
        drop(network);
        let twice = run(&["bus", "scan", "--link", "nic:veth2?second=veth2"]);
        twice.fails(1, &["a ring needs two cards", "name another one"]);
    }
}
