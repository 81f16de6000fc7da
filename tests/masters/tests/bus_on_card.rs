//! Inspection of a network over a network card, on simulated slaves that keep their state between two inspections.
#![cfg(target_os = "linux")]

mod needs_network_namespace {
    use std::process::Command;
    use std::time::Duration;

    use ecmsk::bus::port_errors::{self, ProblemPlace};
    use ecmsk::bus::{self, FoundSlave, Network, clocks, dictionary, eeprom};
    use ecmsk::coe::{ObjectAddress, SdoScope};
    use ecmsk::ethercat::AlState;
    use ecmsk::ethercat::registers::RequestedState;
    use ecmsk::ethercat::sii::checksum;
    use ecmsk::link::uri::LinkUri;
    use ecmsk::link::{Share, open};
    use ecmsk::machine::Machine;
    use ecmsk::machine::findings::FindingVerdict;
    use masters::{MASTER, Rig};

    const LINK: &str = "nic:veth0";

    fn look() -> (Box<dyn Network>, Vec<FoundSlave>) {
        let mut network = bus::open(LINK).expect("it opens");
        let slaves = network.scan().expect("slaves");
        (network, slaves)
    }

    fn refused<T>(result: Result<T, bus::BusError>) -> String {
        result.err().expect("it is refused").to_string()
    }

    /// Over a card: the slaves, the state after each inspection, objects, files, clocks; no slave is above PreOP.
    #[test]
    fn a_network_at_the_end_of_a_card() {
        let rig = Rig::with_drift("drive*2,io", "bus", 50);
        let (mut network, slaves) = look();
        assert!(!network.is_virtual());
        assert_eq!(slaves.iter().map(|slave| &*slave.name).collect::<Vec<_>>(), ["drive", "drive", "io"]);
        let value = network.upload(1, ObjectAddress::new(0x1018, 1), SdoScope::Entry).expect("a value");
        assert_eq!(value, [0x53, 0x4D, 0x43, 0x45]);
        assert!(dictionary::objects(&mut *network, 3).expect("a dictionary").len() > 5);
        network.write_file(2, "a.csv", 0, &[7; 300]).expect("it is written");
        drop(network);
        let (mut network, slaves) = look();
        let found = slaves.iter().map(|slave| slave.found.status.state()).collect::<Vec<_>>();
        assert_eq!(found, [RequestedState::State(AlState::PreOp); 3]);
        assert_eq!(network.read_file(2, "a.csv", 0).expect("it is read"), [7; 300]);
        let clocks = clocks::measure(&mut *network, &slaves, Duration::from_millis(300)).expect("clocks");
        assert_eq!(
            clocks.iter().map(|clock| (clock.slave, clock.is_reference)).collect::<Vec<_>>(),
            [(1, true), (2, false)]
        );
        drop(network);
        let said = rig.end();
        assert!(
            !said.iter().any(|line| line.contains("SafeOP") || line.ends_with("OP") && !line.ends_with("PreOP")),
            "{said:?}"
        );
    }

    /// An EEPROM that was written is what the next look finds, once the slave was switched off and on.
    #[test]
    fn an_eeprom_stays_written() {
        let rig = Rig::new("io*2", "bus_sii");
        let (mut network, _) = look();
        let mut content = network.read_eeprom(2).expect("an EEPROM");
        content[8] = 9;
        content[14] = checksum(content.first_chunk().expect("14 bytes"));
        let changes = eeprom::changes(&mut *network, 2, &content).expect("they are read");
        eeprom::write(&mut *network, 2, &changes, |_| ()).expect("it is written");
        drop(network);
        rig.happen("lose 2");
        rig.happen("find 2");
        let (mut network, slaves) = look();
        assert_eq!(slaves.iter().map(|slave| slave.alias).collect::<Vec<_>>(), [0, 9]);
        assert_eq!(network.read_eeprom(2).expect("an EEPROM"), content);
    }

    /// BUS-7.2 A cable that is bad while the tool looks is found over a card.
    #[test]
    fn a_bad_cable_is_found() {
        let rig = Rig::new("io*3", "bus_noise");
        let (mut network, slaves) = look();
        port_errors::clear(&mut *network, &slaves).expect("they are cleared");
        rig.happen("noise 3 20");
        network.load(Duration::from_millis(500)).expect("time");
        rig.happen("end noise 3");
        let counted = port_errors::read(&mut *network, &slaves).expect("counters");
        let troubles = port_errors::judge(&slaves, &counted);
        let [trouble] = &troubles[..] else { panic!("{troubles:?} of {counted:?}") };
        let ProblemPlace::Cable { near: Some(near), far: Some(far) } = trouble.place else { panic!("{trouble:?}") };
        assert_eq!((near.slave, near.port, far.slave, far.port), (2, 1, 3, 0));
    }

    /// A card that a board has is no network, and the other way round. The list knows it.
    /// A cable that is cut ends what was going on.
    #[test]
    fn a_card_is_for_one_alone() {
        let rig = Rig::new("io", "bus_claim");
        let card = || {
            let cards = Machine::here().net_cards();
            let card = cards.into_iter().find(|card| card.name == MASTER).expect("it is there");
            Machine::here().card_obstacle(&card).map(|finding| finding.found)
        };
        assert_eq!(card(), None);
        let board = open(LINK, Share::ByUri).expect("it opens");
        assert!(refused(bus::open(LINK)).contains("is in use by another program of ecmsk"));
        assert_eq!(card().as_deref(), Some("another program of ecmsk has it"));
        board.close();
        let (mut network, _) = look();
        assert!(open(LINK, Share::ByUri).is_err());
        rig.happen("cut 1");
        let said = refused(network.upload(1, ObjectAddress::new(0x1000, 0), SdoScope::Entry));
        assert!(said.contains("check its cable"), "{said}");
        assert!(refused(network.scan()).contains("no slave answers"));
        drop(network);
        support::succeed(Command::new("ip").args(["address", "add", "192.0.2.7/24", "dev", MASTER]));
        assert!(refused(bus::open(LINK)).contains("192.0.2.7"));
        assert_eq!(card().as_deref(), Some("it belongs to another network (192.0.2.7)"));
        support::succeed(Command::new("ip").args(["address", "flush", "dev", MASTER]));
        support::succeed(Command::new("ip").args(["link", "set", MASTER, "mtu", "1400"]));
        assert!(refused(bus::open(LINK)).contains("sudo ip link set veth0 mtu 1500"));
        assert!(card().is_some_and(|found| found.contains("1400 bytes at most (MTU)")));
        support::succeed(Command::new("ip").args(["link", "set", MASTER, "mtu", "1500", "down"]));
        assert_eq!(card().as_deref(), Some("it is switched off"));
    }

    /// Frames to the slaves and back are measured, and change nothing; without slaves none returns. The data of the
    /// card's driver are judged.
    #[test]
    fn round_trips_are_measured() {
        let rig = Rig::new("io*2", "bus_trips");
        let link = LinkUri::parse(LINK).expect("a link");
        let trips = bus::round_trips(&link, 100).expect("it opens").expect("frames come back");
        // On a machine that is late some come back too late.
        assert!(trips.slaves == 2 && trips.lost < 100, "{trips:?}");
        assert!(trips.p50 <= trips.p99 && trips.p99 <= trips.max && trips.max.as_nanos() > 0, "{trips:?}");
        let findings = Machine::here().findings(Some(&link));
        let wrong: Vec<_> = findings.iter().filter(|finding| finding.subject.as_deref() == Some(MASTER)).collect();
        assert!(wrong.len() > 5 && wrong.iter().all(|finding| finding.verdict != FindingVerdict::Wrong), "{wrong:?}");
        assert!(wrong.iter().any(|finding| finding.check == "card-offloads"), "{wrong:?}");
        rig.happen("cut 1");
        assert_eq!(bus::round_trips(&link, 100).expect("it opens"), None);
        let said = rig.end();
        assert!(!said.iter().any(|line| line.contains("slave")), "nothing has happened to them: {said:?}");
    }
}
