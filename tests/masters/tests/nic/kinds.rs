//! 40 slaves of every kind.

mod needs_network_namespace {
    use std::time::Duration;

    use ecmsk::ecm::{Close, Config, Ecm, Slave};
    use ecmsk::link::slaves::{SlaveModel, parse};
    use ecmsk::sk::SlaveKind;
    use masters::Rig;
    use masters::motion::{arrive, switch_on};

    const LIST: &str = "drive*10,io*4,step*6,hsp*5,dp3cl*5,io*4,hsp2*2,drive*4";
    /// The steps of every axis.
    const STEPS: i32 = 100;

    /// 40 slaves of every kind come to OP: each axis follows its path, and each module's inputs are its outputs.
    #[test]
    fn forty_slaves_of_every_kind_move() {
        let specs = parse(LIST).expect("a list of slaves");
        assert_eq!(specs.len(), 40);
        assert!(SlaveModel::ALL.iter().all(|model| specs.iter().any(|spec| spec.model == *model)), "every kind");
        let _rig = Rig::new(LIST, "nic_forty");
        let ecm = Ecm::open("nic:veth0?priority=20").expect("it opens");
        let slaves: Vec<Slave> = specs.iter().map(|spec| Slave::of_kind(spec.model.kind())).collect();
        // The machine may be busy with other tests.
        ecm.configure(&Config { slaves: slaves.clone(), cycle_us: 4000 }).expect("it is configured");
        let numbered = || (1..).zip(&slaves);
        let axes: Vec<u8> =
            numbered().filter(|(_, kind)| kind.kind() != SlaveKind::Io).map(|(slave, _)| slave).collect();
        switch_on(&ecm, &axes);
        let ways: Vec<(u8, i32)> = axes.iter().map(|slave| (*slave, 4)).collect();
        arrive(&ecm, &ways, STEPS, |_| ());
        let modules = || numbered().filter(|(_, kind)| **kind == Slave::Io).map(|(slave, _)| slave);
        modules().for_each(|slave| ecm.set_outputs(slave, 0x5500 + u16::from(slave)).expect("outputs"));
        let all_come = || modules().all(|slave| ecm.inputs(slave).expect("inputs") == 0x5500 + u16::from(slave));
        let waited = (0..1000).find(|_| {
            ecm.next_cycle(Duration::from_secs(1)).expect("a report");
            all_come()
        });
        assert!(waited.is_some(), "the outputs are wired to the inputs");
        ecm.close(Close::ServoOff).expect("it closes");
    }
}
