//! Two cards at the ends of the cable.

mod needs_network_namespace {
    use std::sync::Arc;

    use ecmsk::ecm::{Config, Ecm};
    use ecmsk::link::{Share, open};
    use ecmsk::sk::MasterState;
    use masters::motion::{arrive, switch_on};
    use masters::{MASTER, Rig, SECOND_MASTER};

    /// NIC-3.2 A cable is cut in the middle of a motion, and healed: no axis leaves its path, each reaches its end, and
    /// the broken ring is counted. A test in virtual time shows that it costs no cycle.
    #[test]
    fn a_cable_is_cut_in_a_ring() {
        let rig = Rig::ring("drive*4", "nic_ring");
        let link = format!("nic:{MASTER}?second={SECOND_MASTER}&priority=20");
        let link = open(&link, Share::ByUri).expect("it opens");
        let ecm = Ecm::over(Arc::clone(&link), Default::default()).expect("it talks");
        ecm.set_state(MasterState::PreOp).expect("PreOP");
        ecm.configure(&Config::drives(4)).expect("it is configured");
        switch_on(&ecm, &[1, 2, 3, 4]);
        let failed = arrive(&ecm, &[(1, 10), (2, 20), (3, 30), (4, 40)], 560, |n| match n {
            150 => rig.happen("cut 3"),
            350 => rig.happen("heal"),
            _ => {}
        });
        let counters = link.stats().board.expect("a board of this process");
        assert!(counters.ring_broken > 0, "{counters:?}");
        drop(ecm);
        link.close();
        let said = rig.end();
        let has_left = said.iter().any(|line| line.contains("AL status"));
        assert!(!has_left || failed > 0, "a slave has left OP, and the program was not told: {said:?}");
    }
}
