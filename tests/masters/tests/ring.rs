//! Two interfaces at the ends of the slaves, which close a ring: where raw frames come back.
#![cfg(target_os = "linux")]

mod needs_network_namespace {
    use std::process::Command;
    use std::time::{Duration, Instant};

    use ecmsk::ethercat::{
        Command as Datagram, DatagramHeader, ETHERTYPE, FRAME_LEN_MAX, Frame, FrameHeader, FrameWriter,
    };
    use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
    use masters::{MASTER, Rig, SECOND_MASTER, SLAVES};

    /// The longest time of a frame, and of a change of the cables, on a busy machine.
    const LIMIT: Duration = Duration::from_secs(20);
    /// A frame that goes out while a link dies may be lost: after this time another one is sent.
    const PATIENCE: Duration = Duration::from_millis(200);

    /// The master's ends of the cables.
    struct Ends {
        sockets: [EthernetSocket; 2],
        index: u8,
    }

    impl Ends {
        fn open() -> Self {
            let open = |name| {
                let interface = check(name, DefaultRoute::Allowed).expect("it is there");
                EthernetSocket::open(&interface, ETHERTYPE).expect("these tests run as root")
            };
            Self { sockets: [MASTER, SECOND_MASTER].map(open), index: 0 }
        }

        /// Sends a broadcast by that end; returns the end by which it comes back, and its working counter.
        fn send(&mut self, end: usize) -> (usize, u16) {
            self.try_send(end, LIMIT).expect("the frame comes back")
        }

        /// The same; `None`: it cannot be sent, or does not come back within that time.
        fn try_send(&mut self, end: usize, limit: Duration) -> Option<(usize, u16)> {
            self.index = self.index.wrapping_add(1);
            let mut frame = [0; FRAME_LEN_MAX];
            let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([0x10, 0, 0, 0, 0, 7])).expect("room");
            writer.push(DatagramHeader::register(Datagram::Brd, self.index, 0, 0x0130), &[0; 2]).expect("room");
            self.sockets[end].send(writer.finish()).ok()?;
            let begin = Instant::now();
            let mut buffer = [0; FRAME_LEN_MAX];
            while begin.elapsed() < limit {
                for (back, socket) in self.sockets.iter().enumerate() {
                    // An interface that was switched off reports that once.
                    let Ok(Some(len)) = socket.take(&mut buffer) else { continue };
                    let decoded = Frame::decode(&buffer[..len]).expect("a frame");
                    let datagram = decoded.datagrams().expect("datagrams").next().expect("one").expect("whole");
                    if datagram.header.index == self.index {
                        return Some((back, datagram.working_counter));
                    }
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            None
        }

        /// Sends by that end until frames come back as wanted.
        fn until(&mut self, end: usize, wanted: (usize, u16)) {
            let begin = Instant::now();
            loop {
                let found = self.try_send(end, PATIENCE);
                if found == Some(wanted) {
                    return;
                }
                assert!(begin.elapsed() < LIMIT, "{found:?}, and not {wanted:?}");
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }

    fn ip(words: &[&str]) {
        support::succeed(Command::new("ip").args(words));
    }

    /// ECAT-15.25 In a whole ring a frame passes all slaves and comes out at the other end, and one from there passes them
    /// untouched. Where the cable is cut, frames from both ends turn round, and each slave works on those that reach it. A dead
    /// link is such a cut before the first slave, or behind the last one. ECAT-15.23 An interface that is switched off and on
    /// works again.
    #[test]
    fn a_second_interface_closes_a_ring() {
        let rig = Rig::ring("drive*3,io*2", "ring");
        let mut ends = Ends::open();
        ends.until(0, (1, 5));
        assert_eq!(ends.send(1), (0, 0), "against the order nobody works on it");
        rig.happen("cut 3");
        ends.until(0, (0, 2));
        assert_eq!(ends.send(1), (1, 3));
        rig.happen("heal");
        ends.until(0, (1, 5));
        ip(&["link", "set", SECOND_MASTER, "down"]);
        ends.until(0, (0, 5));
        ip(&["link", "set", SECOND_MASTER, "up"]);
        ends.until(0, (1, 5));
        ip(&["link", "set", MASTER, "down"]);
        ends.until(1, (1, 5));
        ip(&["link", "set", MASTER, "up"]);
        ends.until(0, (1, 5));
        for _ in 0..2 {
            ip(&["link", "set", SLAVES, "down"]);
            ends.until(1, (1, 5));
            ip(&["link", "set", SLAVES, "up"]);
            ends.until(0, (1, 5));
        }
        let said = rig.end();
        for line in ["veth1 and veth3 close a ring", "no ring: veth3 has no link", "no ring: veth1 has no link"] {
            assert!(said.iter().any(|said| said == line), "no `{line}`: {said:?}");
        }
    }
}
