//! Faults of a cable while a program drives its machine: frames are lost, late, doubled or foreign, the card is down,
//! slaves are lost and come back.

mod needs_network_namespace {
    use std::process::Command;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    use ecmsk::ecm::{Config, Ecm};
    use ecmsk::engine::Counters;
    use ecmsk::ethercat::{Command as Datagram, DatagramHeader, ETHERTYPE, FrameHeader, FrameWriter};
    use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
    use ecmsk::link::{Link, Share, open};
    use ecmsk::sk::StateByte;
    use masters::motion::{arrive, switch_on};
    use masters::{MASTER, Rig, SLAVES, Trouble};

    /// Two drives that are switched on, and the handles of their board.
    struct Machine {
        link: Arc<dyn Link>,
        ecm: Ecm,
    }

    /// Sets a flag when it is dropped.
    struct Ends<'a>(&'a AtomicBool);

    impl Drop for Ends<'_> {
        fn drop(&mut self) {
            self.0.store(true, Ordering::Relaxed);
        }
    }

    impl Machine {
        fn in_op() -> Self {
            let link = open("nic:veth0?priority=20", Share::ByUri).expect("it opens");
            let ecm = Ecm::over(Arc::clone(&link), Default::default()).expect("it talks");
            ecm.configure(&Config { cycle_us: 2000, ..Config::drives(2) }).expect("it is configured");
            switch_on(&ecm, &[1, 2]);
            Self { link, ecm }
        }

        fn counters(&self) -> Counters {
            self.link.stats().board.expect("a board of this process")
        }

        /// Moves both axes along their paths in that many steps to their ends. Returns how many attempts were reported
        /// as failed.
        fn moves(&self, steps: i32) -> usize {
            arrive(&self.ecm, &[(1, 10), (2, -20)], steps, |_| ())
        }

        fn wait(&self, what: &str, mut is_so: impl FnMut(StateByte) -> bool) {
            let so = (0..3000).any(|_| {
                let state = self.ecm.state().expect("the newest report");
                // A silent board makes no report.
                let _ = self.ecm.next_cycle(Duration::from_millis(10));
                is_so(state)
            });
            assert!(so, "never: {what}");
        }

        /// Brings the slaves back that were lost, and moves both.
        fn comes_back(&self) {
            switch_on(&self.ecm, &[1, 2]);
            self.moves(100);
        }
    }

    /// NIC-2.3 Frames that are lost, late, doubled and out of order on their way back: no axis leaves its path, both
    /// arrive, no target is lost unreported, and the cycles are counted.
    #[test]
    fn axes_arrive_whatever_the_cable_does_to_frames() {
        let (_rig, middle) = Rig::with_middle("drive*2", "nic_cable");
        let machine = Machine::in_op();
        let late = Duration::from_millis(5);
        for trouble in [
            Trouble { lost: 50, ..Trouble::default() },
            Trouble { doubled: 10, ..Trouble::default() },
            Trouble { late: 50, by: late, ..Trouble::default() },
            Trouble { lost: 100, doubled: 100, late: 100, by: late },
        ] {
            let before = (middle.faults(), machine.counters());
            middle.make(trouble);
            let failed = machine.moves(500);
            middle.make(Trouble::default());
            let (faults, counters) = (middle.faults() - before.0, machine.counters());
            assert!(faults > 0, "{trouble:?}");
            assert_eq!(counters.full, before.1.full, "{trouble:?}");
            let for_lost = counters.for_lost - before.1.for_lost;
            assert!(
                for_lost == 0 || failed > 0,
                "{trouble:?}: {for_lost} targets were lost, and the program was not told"
            );
            let answers_lost = counters.answers_lost - before.1.answers_lost;
            assert!(trouble.lost == 0 || answers_lost > 0, "{trouble:?}: {answers_lost} of {faults}");
        }
    }

    /// The network is found and brought to OP although frames are lost and doubled by the cable.
    #[test]
    fn a_bad_cable_does_not_keep_a_network_from_op() {
        let (_rig, middle) = Rig::with_middle("drive*2", "nic_bad_cable");
        middle.make(Trouble { lost: 200, doubled: 50, ..Trouble::default() });
        let machine = Machine::in_op();
        assert!(middle.faults() > 0);
        middle.make(Trouble::default());
        machine.moves(100);
    }

    /// NIC-2.8 A card that goes down acts as a cut cable: the board is silent, and SET_STATE brings its slaves back
    /// when the card is up again.
    #[test]
    fn a_card_goes_down_and_comes_up() {
        let _rig = Rig::new("drive*2", "nic_down");
        let machine = Machine::in_op();
        machine.moves(100);
        let switch = |how: &str| support::succeed(Command::new("ip").args(["link", "set", MASTER, how]));
        switch("down");
        let reports = machine.counters().reports;
        std::thread::sleep(Duration::from_millis(500));
        assert!(machine.counters().reports < reports + 100, "a board without a network makes no reports");
        switch("up");
        machine.wait("reports again", |_| machine.counters().reports > reports + 200);
        machine.comes_back();
    }

    /// Frames of other protocols, and those of another master on the same cable, change nothing.
    #[test]
    fn strange_frames_change_nothing() {
        let _rig = Rig::new("drive*2", "nic_strangers");
        let machine = Machine::in_op();
        let before = machine.counters();
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            // Also when this thread panics: otherwise it would wait for the other one.
            let ends = Ends(&over);
            scope.spawn(|| {
                let interface = check(SLAVES, DefaultRoute::Allowed).expect("the other end");
                let other = EthernetSocket::open(&interface, ETHERTYPE).expect("root");
                for n in (0..=u8::MAX).cycle() {
                    if over.load(Ordering::Relaxed) {
                        return;
                    }
                    let mut frame = [0; 60];
                    let mut writer =
                        FrameWriter::new(&mut frame, FrameHeader::datagrams([0x12, 0, 0, 0, 0, 7])).expect("room");
                    let header = DatagramHeader { index: n, ..DatagramHeader::register(Datagram::Brd, 0, 0, 0x0130) };
                    writer.push(header, &[2, 0]).expect("room");
                    writer.finish();
                    other.send(&frame).expect("it is sent");
                    // ARP, and an empty frame with EtherCAT's EtherType.
                    for kind in [[0x08, 0x06], [0x88, 0xA4]] {
                        let mut frame = [n; 60];
                        frame[12..14].copy_from_slice(&kind);
                        other.send(&frame).expect("it is sent");
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            });
            let failed = machine.moves(500);
            let for_lost = machine.counters().for_lost - before.for_lost;
            assert!(for_lost == 0 || failed > 0, "{for_lost} targets were lost, and the program was not told");
            drop(ends);
        });
    }

    /// NIC-2.8 A slave whose cable is cut, or that has no power, is named; the other one goes on, and SET_STATE brings it back.
    #[test]
    fn slaves_go_and_come() {
        let rig = Rig::new("drive*2", "nic_come");
        let machine = Machine::in_op();
        for (gone, back) in [("cut 2", "heal"), ("lose 2", "find 2"), ("cut 1", "heal")] {
            rig.happen(gone);
            if gone == "cut 1" {
                std::thread::sleep(Duration::from_millis(300));
            } else {
                machine.wait(gone, StateByte::is_failed);
                let failure = machine.link.stats().state_failure.expect("it has failed").to_string();
                assert!(failure.contains("slave 2"), "{gone}: {failure}");
            }
            rig.happen(back);
            machine.comes_back();
        }
    }
}
