//! A network card whose adapter is pulled, or whose interface is deleted, in the middle of a motion.

mod needs_network_namespace {
    use std::process::Command;
    use std::sync::Arc;
    use std::sync::mpsc;
    use std::thread;
    use std::time::Duration;

    use ecmsk::ecm::{Config, Ecm, EcmError, Failure};
    use ecmsk::link::{Link, LinkError, Share, Wait, open};
    use ecmsk::sk::{Frame, MasterState};
    use masters::{Elsewhere, MASTER, Rig, SECOND_MASTER};

    fn in_op(link: &str, drives: u8) -> (Arc<dyn Link>, Ecm) {
        let link = open(link, Share::ByUri).expect("it opens");
        let ecm = Ecm::over(Arc::clone(&link), Default::default()).expect("it talks");
        ecm.configure(&Config::drives(drives.into())).expect("it is configured");
        ecm.set_state(MasterState::Op).expect("OP");
        ecm.servo_on(&(1..=drives).collect::<Vec<_>>()).expect("all are on");
        (link, ecm)
    }

    /// Checks that the error names the interface and what to do.
    fn is_lost(error: &LinkError) {
        let said = error.to_string();
        assert!(matches!(error, LinkError::Lost { .. }), "{said}");
        assert!(said.contains(MASTER) && said.contains("plug in") && said.contains("ip link"), "{said}");
    }

    /// A card that is deleted, or moved away, is lost: a read that waits without end, each call after it, and the motion that is under way
    /// end with the interface's name. Closing ends, and the same link opens when the card is back.
    #[test]
    fn a_card_that_is_gone_is_lost() {
        for is_deleted in [true, false] {
            let rig = Rig::new("drive*2", "nic_gone");
            let elsewhere = Elsewhere::new();
            let (link, ecm) = in_op("nic:veth0?priority=20", 2);
            let (waits, ended) = mpsc::channel();
            let reader = Arc::clone(&link);
            thread::spawn(move || {
                let mut report = Frame::new();
                let failed = loop {
                    if let Err(failed) = reader.read(&mut report, Wait::Forever) {
                        break failed;
                    }
                };
                waits.send(failed)
            });
            let mut stream = ecm.stream(20).expect("a stream");
            let mut n = 0;
            let failed = loop {
                n += 1;
                if n == 100 {
                    match is_deleted {
                        true => _ = support::succeed(Command::new("ip").args(["link", "del", MASTER])),
                        false => elsewhere.take(MASTER),
                    }
                }
                assert!(n < 100_000, "the motion goes on");
                if let Err(failed) = stream.csp(1, 10 * n).and_then(|()| stream.step().map(|_| ())) {
                    break failed;
                }
            };
            let EcmError::Link(failed) = &failed else { panic!("{failed}") };
            is_lost(failed);
            is_lost(&ended.recv_timeout(Duration::from_secs(60)).expect("a read ends"));
            is_lost(&link.check().expect_err("it is lost"));
            is_lost(&link.write(&Frame::new(), Wait::Forever).expect_err("it is lost"));
            drop(stream);
            let closed: Result<(), Failure> = ecm.close(ecmsk::ecm::Close::Hold).map_err(Failure::from);
            assert!(closed.is_err(), "the axes could not be brought to rest");
            link.close();
            if !is_deleted {
                elsewhere.give_back(MASTER);
                let (again, ecm) = in_op("nic:veth0?priority=20", 2);
                drop(ecm);
                again.close();
            }
            drop(rig);
        }
    }

    /// NIC-3.2 One of two cards is gone: the motion goes on by the other one to its end, and the broken ring is counted (exactly, in virtual
    /// time: `engine::nic_gone`); with the second one gone, too, the board is lost, and both are named.
    #[test]
    fn a_ring_goes_on_by_the_other_card() {
        for [gone, other] in [[SECOND_MASTER, MASTER], [MASTER, SECOND_MASTER]] {
            let _rig = Rig::ring("drive*4", "nic_gone_ring");
            let elsewhere = Elsewhere::new();
            let (link, ecm) = in_op(&format!("nic:{MASTER}?second={SECOND_MASTER}&priority=20"), 4);
            let mut stream = ecm.stream(20).expect("a stream");
            let stepped = (1..=600).try_for_each(|n| {
                if n == 150 {
                    elsewhere.take(gone);
                }
                (1..=4_u8).try_for_each(|slave| stream.csp(slave, 10 * i32::from(slave) * n.min(560)))?;
                stream.step().map(|_| ())
            });
            let ended = stepped.and_then(|()| stream.finish().map(|_| ()));
            link.check().expect("the board is there");
            let counters = link.stats().board.expect("a board of this process");
            assert!(counters.ring_broken > 50, "{counters:?}");
            match ended {
                // A busy machine may be late, and then loses slaves, which is counted.
                Err(failed) => assert!(counters.for_lost > 0 || counters.answers_lost > 0, "{failed} {counters:?}"),
                Ok(()) => {
                    let snapshot = ecm.snapshot().expect("a report");
                    for slave in 1..=4 {
                        let position = snapshot.position(slave).expect("a drive");
                        assert!((position - 5600 * i32::from(slave)).abs() <= 4, "slave {slave}: {position}");
                    }
                }
            }
            elsewhere.take(other);
            let failed = loop {
                if let Err(failed) = link.read(&mut Frame::new(), Wait::For(Duration::from_secs(60))) {
                    break failed;
                }
            };
            is_lost(&failed);
            assert!(failed.to_string().contains(SECOND_MASTER), "{failed}");
            drop(ecm);
            link.close();
        }
    }
}
