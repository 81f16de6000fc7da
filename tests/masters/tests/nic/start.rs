//! The choice of the card, from the start to a motion, and the end.

mod needs_network_namespace {
    use std::process::Command;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
    use ecmsk::ethercat::{Command as Datagram, DatagramHeader, ETHERTYPE, FrameHeader, FrameWriter};
    use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
    use ecmsk::link::{LinkError, Share, open};
    use ecmsk::sk::MasterState;
    use masters::motion::{arrive, switch_on};
    use masters::{MASTER, Rig, SECOND_MASTER, SECOND_SLAVES};

    const LINK: &str = "nic:veth0?priority=20";

    fn refused(uri: &str) -> LinkError {
        open(uri, Share::ByUri).err().unwrap_or_else(|| panic!("{uri} is opened"))
    }

    /// A program finds its slaves, brings them to OP, moves two drives along a path and sets outputs.
    /// NIC-1.5 When it closes the board the network goes to PreOP.
    #[test]
    fn a_program_drives_its_machine_from_a_network_card() {
        let rig = Rig::new("drive*2,io", "nic");
        let ecm = Ecm::open(LINK).expect("it opens");
        ecm.set_state(MasterState::PreOp).expect("PreOP");
        let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSP), Slave::Io];
        ecm.configure(&Config { slaves, ..Config::default() }).expect("it is configured");
        switch_on(&ecm, &[1, 2]);
        arrive(&ecm, &[(1, 10), (2, -20)], 380, |_| ());
        ecm.set_outputs(3, 0xA55A).expect("outputs");
        let waited = (0..1000).find(|_| {
            ecm.next_cycle(Duration::from_secs(1)).expect("a report");
            ecm.inputs(3).expect("inputs") == 0xA55A
        });
        assert!(waited.is_some(), "the outputs are wired to the inputs");
        ecm.close(Close::ServoOff).expect("it closes");
        let said = rig.end();
        assert!(said.iter().any(|line| line.ends_with("in OP")), "{said:?}");
        let last = said.iter().rfind(|line| line.starts_with("slaves")).expect("a line");
        // Slaves may have left OP by themselves because the machine was late.
        assert!(last == "slaves 1 to 3 are in PreOP" || last.contains("AL status 0x001B"), "{said:?}");
    }

    /// An interface that is not for EtherCAT frames is refused with the next step. A card that another board uses is in
    /// use.
    #[test]
    fn a_card_is_for_one_program_alone_and_for_nothing_else() {
        let _rig = Rig::new("io", "nic_refused");
        let said = refused("nic:veth7").to_string();
        assert!(said.contains("no network interface veth7; there are") && said.contains("veth0"), "{said}");
        let said = refused("nic:lo").to_string();
        assert!(said.contains("lo is no Ethernet"), "{said}");
        let said = refused("nic:").to_string();
        assert!(said.contains("nic:INTERFACE, e.g. nic:eth1"), "{said}");
        let said = refused("nic:veth0?second=veth0").to_string();
        assert!(said.contains("a ring needs two cards"), "{said}");
        let said = refused("nic:veth0?second=veth7").to_string();
        assert!(said.contains("no network interface veth7"), "{said}");
        let first = open("nic:veth0", Share::ByUri).expect("it opens");
        let error = refused("nic:veth0");
        assert!(matches!(&error, LinkError::InUse { .. }), "{error}");
        first.close();
        open("nic:veth0", Share::ByUri).expect("it is free again").close();
        support::succeed(Command::new("ip").args(["address", "add", "192.0.2.7/24", "dev", MASTER]));
        let said = refused("nic:veth0").to_string();
        assert!(said.contains("192.0.2.7") && said.contains("ip address flush dev veth0"), "{said}");
    }

    /// Frames of another master are noticed before anything is sent.
    #[test]
    fn another_master_is_named_before_anything_is_sent() {
        let rig = Rig::new("io", "nic_other");
        // Another master's frames on the same cable arrive at both ends.
        let other = EthernetSocket::open(&check("veth1", DefaultRoute::Allowed).expect("the other end"), ETHERTYPE)
            .expect("root");
        let mut frame = [0; 60];
        let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([0x10, 0, 0, 0, 0, 7])).expect("room");
        writer.push(DatagramHeader::register(Datagram::Brd, 0, 0, 0x0130), &[0; 2]).expect("room");
        writer.finish();
        let said = std::thread::scope(|scope| {
            let opened = scope.spawn(|| refused("nic:veth0").to_string());
            while !opened.is_finished() {
                other.send(&frame).expect("it is sent");
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            opened.join().expect("it ends")
        });
        assert!(
            said.contains("another master sends frames there (from 10:00:00:00:00:07); nothing was sent"),
            "{said}"
        );
        let said = rig.end();
        assert!(!said.iter().any(|line| line.contains("a master is there")), "{said:?}");
    }

    /// A card takes no frames of other cards while it is opened, however many there are.
    #[test]
    fn a_card_is_opened_deaf() {
        const OPENED: usize = 400;
        let _rig = Rig::ring("io", "nic_deaf");
        let there = check(SECOND_MASTER, DefaultRoute::Allowed).expect("the second card");
        let elsewhere =
            EthernetSocket::open(&check(SECOND_SLAVES, DefaultRoute::Allowed).expect("its other end"), ETHERTYPE);
        let (elsewhere, here) =
            (elsewhere.expect("root"), check(MASTER, DefaultRoute::Allowed).expect("the first card"));
        let listens = EthernetSocket::open(&there, ETHERTYPE).expect("root");
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut frame = [0x33; 60];
                frame[12..14].copy_from_slice(&ETHERTYPE.to_be_bytes());
                while !over.load(Ordering::Relaxed) {
                    // Without room the frame is lost.
                    let _ = elsewhere.send(&frame);
                }
            });
            let mut buffer = [0; 1514];
            let mut heard = 0;
            for _ in 0..OPENED {
                let socket = EthernetSocket::open(&here, ETHERTYPE).expect("root");
                heard += usize::from(socket.take(&mut buffer).expect("it is there").is_some());
            }
            over.store(true, Ordering::Relaxed);
            assert_eq!(heard, 0, "of {OPENED} that were opened");
        });
        assert!(listens.take(&mut [0; 1514]).expect("it is there").is_some(), "frames have come by the second card");
    }

    /// Without slaves there is no board.
    #[test]
    fn without_a_slave_there_is_no_board() {
        let rig = Rig::new("io", "nic_alone");
        rig.happen("cut 1");
        let error = refused("nic:veth0");
        assert!(matches!(&error, LinkError::NoBoard { .. }), "{error}");
        let said = error.to_string();
        assert!(said.contains("no slave") && said.contains("look at the cable"), "{said}");
    }
}
