//! `wire_rtt_p50`, `wire_rtt_p99`: from a frame that a master sends on a network interface to the frame that comes back, with
//! one LRW through 40 drives in OP, switched on, as `ecmsk serve ethercat` simulates them. The baseline is a bare loop that sends each
//! frame back, on another pair of virtual interfaces in the same network namespace. Both take frames of the same length.
//!
//! Needs Linux, root and `ip`: otherwise it says so and is left out.

#[cfg(target_os = "linux")]
mod common;
#[cfg(target_os = "linux")]
#[path = "common/places.rs"]
mod places;
#[cfg(target_os = "linux")]
#[path = "common/wire.rs"]
mod wire;

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("wire_rtt: left out: network namespaces need Linux");
}

#[cfg(target_os = "linux")]
fn main() {
    bench::run();
}

#[cfg(target_os = "linux")]
mod bench {
    use std::process::Command;
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    use ecmsk::engine::RealTime;
    use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, SmControl, SyncManager};
    use ecmsk::ethercat::{
        Command as Wire, DATAGRAM_HEADER_LEN, DATAGRAM_OVERHEAD, DatagramHeader, FRAME_HEADER_LEN, FRAME_LEN_MAX,
        FrameHeader, FrameWriter,
    };
    use ecmsk::link::slaves;
    use ecmsk::port::ethercat::{Options, Server};

    use super::common::{self, Demand};
    use super::places::Places;
    use super::wire::Interface;

    const DRIVES: u16 = 40;
    /// Bytes of a drive's outputs and inputs, by its PDOs at power-on.
    const OUTPUTS: u16 = 6;
    const INPUTS: u16 = 10;
    /// The ends of the two pairs: the master's, and that of the slaves or of the bare loop.
    const PAIRS: [(&str, &str); 2] = [("master0", "slaves0"), ("master1", "loop1")];
    const CALLS: usize = 2000;
    const BLOCKS: usize = 15;
    /// The word by which the program knows that it runs in its own network namespace.
    const INSIDE: &str = "inside-a-namespace";

    pub fn run() {
        if std::env::args().any(|word| word == INSIDE) {
            return measure();
        }
        let this = std::env::current_exe().expect("the program that runs");
        if let Some(reason) = missing() {
            eprintln!("wire_rtt: left out: {reason}");
            return;
        }
        let ended = Command::new("unshare").arg("--net").arg(this).arg(INSIDE).status().expect("it was there");
        assert!(ended.success(), "{ended}");
    }

    /// Why there can be no pairs of interfaces here.
    fn missing() -> Option<String> {
        let tried = Command::new("unshare").args(["--net", "ip", "link", "add", "type", "veth"]).output();
        match tried {
            Ok(tried) if tried.status.success() => None,
            Ok(tried) => Some(format!("it runs as root: {}", String::from_utf8_lossy(&tried.stderr).trim())),
            Err(error) => Some(format!("it needs unshare (util-linux) and ip (iproute2): {error}")),
        }
    }

    fn measure() {
        for (near, far) in PAIRS {
            ip(&["link", "add", near, "type", "veth", "peer", "name", far]);
            // The system's own frames, of IPv6, would come between.
            for end in [near, far] {
                let _ = std::fs::write(format!("/proc/sys/net/ipv6/conf/{end}/disable_ipv6"), "1");
                ip(&["link", "set", end, "up"]);
            }
        }
        let places = Places::find();
        let server = places.server(|| serve(PAIRS[0].1));
        places.server(|| send_back(PAIRS[1].1));
        let mut master = Master::new(Interface::open(PAIRS[0].0));
        let cyclic = master.bring_to_op();
        let mut echo = Master::new(Interface::open(PAIRS[1].0));
        for (name, share, target) in [("wire_rtt_p50", 50, 1.3), ("wire_rtt_p99", 99, 1.5)] {
            let against = Some("a bare loop of AF_PACKET");
            let demand = Demand { name, target: Some(target), allowance: None, against };
            let of = |master: &mut Master| common::percentile(CALLS, share, || master.exchange(&cyclic));
            common::pair_of_blocks(demand, BLOCKS, || of(&mut master), || of(&mut echo));
        }
        master.exchange(&cyclic);
        master.assert_enabled();
        server.stop().expect("it has not ended by itself");
    }

    fn ip(arguments: &[&str]) {
        let ended = Command::new("ip").args(arguments).status().expect("it was there");
        assert!(ended.success(), "ip {arguments:?}");
    }

    fn serve(interface: &str) -> Server {
        Server::start(Options {
            interface: interface.to_owned(),
            second: None,
            slaves: slaves::parse(&format!("drive*{DRIVES}")).expect("a list"),
            script: None,
            record: None,
            allow_default_route: false,
            drift_ppm: 0,
            real_time: RealTime::default(),
            tell: Arc::new(|_| {}),
            failed: Arc::new(|| {}),
        })
        .expect("the slaves are served")
    }

    /// The bare loop.
    fn send_back(interface: &str) {
        let interface = Interface::open(interface);
        std::thread::spawn(move || {
            let mut frame = [0; FRAME_LEN_MAX];
            loop {
                let len = interface.take(&mut frame);
                interface.send(&frame[..len]);
            }
        });
    }

    /// A master that has one frame under way.
    struct Master {
        interface: Interface,
        answer: [u8; FRAME_LEN_MAX],
        len: usize,
    }

    impl Master {
        const fn new(interface: Interface) -> Self {
            Self { interface, answer: [0; FRAME_LEN_MAX], len: 0 }
        }

        fn exchange(&mut self, frame: &[u8]) {
            self.interface.send(frame);
            self.len = self.interface.take(&mut self.answer);
        }

        /// The working counter of the newest frame, which had one datagram.
        fn counter(&self) -> u16 {
            let data: usize = DatagramHeader::decode(
                self.answer[FRAME_HEADER_LEN..].first_chunk::<DATAGRAM_HEADER_LEN>().expect("a datagram"),
            )
            .len
            .into();
            let at = FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN + data;
            u16::from_le_bytes([self.answer[at], self.answer[at + 1]])
        }

        fn write(&mut self, header: DatagramHeader, data: &[u8]) {
            self.exchange(&frame(header, data));
            assert!(self.counter() > 0, "{header:?} was taken");
        }

        fn write_all(&mut self, ado: u16, data: &[u8]) {
            self.write(DatagramHeader::register(Wire::Bwr, 0, 0, ado), data);
        }

        /// Brings all drives to OP; the frame with their process data.
        fn bring_to_op(&mut self) -> Vec<u8> {
            for (manager, registers) in [
                (0, SyncManager::enabled(0x1000, 128, SmControl::MAILBOX_OUT)),
                (1, SyncManager::enabled(0x1080, 128, SmControl::MAILBOX_IN)),
                (2, SyncManager::enabled(0x1100, OUTPUTS, SmControl::OUTPUTS)),
                (3, SyncManager::enabled(0x1200, INPUTS, SmControl::INPUTS)),
            ] {
                self.write_all(registers::sync_manager(manager), &registers.encode());
            }
            for n in 0..DRIVES {
                let logical = u32::from(n * (OUTPUTS + INPUTS));
                for (fmmu, registers) in [
                    (0, Fmmu::bytes(logical, OUTPUTS, 0x1100, FmmuDirections::WRITE)),
                    (1, Fmmu::bytes(logical + u32::from(OUTPUTS), INPUTS, 0x1200, FmmuDirections::READ)),
                ] {
                    let header = DatagramHeader::register(Wire::Apwr, 0, n.wrapping_neg(), registers::fmmu(fmmu));
                    self.write(header, &registers.encode());
                }
            }
            // They get nothing while the bare loop is measured.
            self.write_all(registers::WATCHDOG_PROCESS_DATA, &[0, 0]);
            for state in [2, 4, 8] {
                self.write_all(registers::AL_CONTROL, &[state, 0]);
            }
            // Switched on, and held where they stand.
            for controlword in [0x06, 0x07, 0x0F] {
                let until = Instant::now() + Duration::from_millis(300);
                while Instant::now() < until {
                    self.exchange(&cyclic(controlword));
                }
            }
            self.assert_enabled();
            cyclic(0x0F)
        }

        /// All drives are in OP and switched on, by the newest frame.
        fn assert_enabled(&self) {
            assert_eq!(self.counter(), 3 * DRIVES, "all drives are in OP");
            let images = self.answer[FRAME_HEADER_LEN + DATAGRAM_HEADER_LEN..].chunks((OUTPUTS + INPUTS).into());
            let statuswords = images.map(|image| image[usize::from(OUTPUTS)]).take(DRIVES.into());
            assert!(statuswords.into_iter().all(|statusword| statusword & 0x6F == 0x27), "all drives are switched on");
        }
    }

    /// One LRW with the process data of all drives: this controlword, and 0 as the target.
    fn cyclic(controlword: u8) -> Vec<u8> {
        let mut image = vec![0; (DRIVES * (OUTPUTS + INPUTS)).into()];
        image.chunks_mut((OUTPUTS + INPUTS).into()).for_each(|image| image[0] = controlword);
        frame(DatagramHeader::new(Wire::Lrw, 0, 0), &image)
    }

    /// A frame with one datagram.
    fn frame(header: DatagramHeader, data: &[u8]) -> Vec<u8> {
        let mut buffer = [0; FRAME_LEN_MAX];
        let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x10; 6])).expect("room");
        frame.push(header, data).expect("room");
        let len = frame.finish().len();
        assert!(len >= FRAME_HEADER_LEN + DATAGRAM_OVERHEAD + data.len());
        buffer[..len].to_vec()
    }
}
