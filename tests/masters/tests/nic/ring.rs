//! Two cards at the ends of the cable.

mod needs_network_namespace {
    use std::sync::Arc;

    use ecmsk::ecm::{Config, Ecm};
    use ecmsk::link::{Share, open};
    use ecmsk::sk::MasterState;
    use masters::{MASTER, Rig, SECOND_MASTER};

    /// NIC-3.2 A cable is cut in the middle of a motion, and healed: each axis comes to its end, no slave is lost, and the broken ring is
    /// counted.
    #[test]
    fn a_cable_is_cut_in_a_ring() {
        let rig = Rig::ring("drive*4", "nic_ring");
        let link = format!("nic:{MASTER}?second={SECOND_MASTER}&priority=20");
        let link = open(&link, Share::ByUri).expect("it opens");
        let ecm = Ecm::over(Arc::clone(&link), Default::default()).expect("it talks");
        ecm.set_state(MasterState::PreOp).expect("PreOP");
        ecm.configure(&Config::drives(4)).expect("it is configured");
        ecm.set_state(MasterState::Op).expect("OP");
        ecm.servo_on(&[1, 2, 3, 4]).expect("all are on");
        let mut stream = ecm.stream(20).expect("a stream");
        for n in 1..=600 {
            match n {
                150 => rig.happen("cut 3"),
                350 => rig.happen("heal"),
                _ => {}
            }
            for slave in 1..=4 {
                stream.csp(slave, 10 * i32::from(slave) * n.min(560)).expect("a target");
            }
            stream.step().expect("a step");
        }
        stream.finish().expect("it ends");
        let snapshot = ecm.snapshot().expect("a report");
        for slave in 1..=4 {
            let position = snapshot.position(slave).expect("a drive");
            assert!((position - 5600 * i32::from(slave)).abs() <= 4, "slave {slave}: {position}");
        }
        let counters = link.stats().board.expect("a board of this process");
        assert!(counters.ring_broken > 50, "{counters:?}");
        assert_eq!((counters.for_lost, counters.outputs_lost), (0, 0), "{counters:?}");
        drop(ecm);
        link.close();
        let said = rig.end();
        assert!(!said.iter().any(|line| line.contains("AL status")), "no slave has left OP: {said:?}");
    }
}
