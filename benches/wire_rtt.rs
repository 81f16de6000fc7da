//! `wire_rtt_p50`, `wire_rtt_p99`: from a frame that a master sends on a network interface to the frame that comes back, with
//! one LRW through 40 drives in OP, switched on, as `ecmsk serve ethercat` simulates them. The baseline is a bare loop that sends each
//! frame back, on another pair of virtual interfaces in the same network namespace. Both take frames of the same length.
//!
//! Needs Linux, root and `ip`: otherwise it says so and is left out.

#[cfg(target_os = "linux")]
mod common;
#[cfg(target_os = "linux")]
#[path = "common/drives.rs"]
mod drives;
#[cfg(target_os = "linux")]
#[path = "common/namespace.rs"]
mod namespace;
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
    namespace::run("wire_rtt", bench::measure);
}

#[cfg(target_os = "linux")]
mod bench {
    use ecmsk::engine::RealTime;
    use ecmsk::ethercat::FRAME_LEN_MAX;

    use super::common::{self, Demand};
    use super::drives::{self, Master};
    use super::namespace;
    use super::places::Places;
    use super::wire::Interface;

    /// The ends of the two pairs: the master's, and that of the slaves or of the bare loop.
    const PAIRS: [(&str, &str); 2] = [("master0", "slaves0"), ("master1", "loop1")];
    const CALLS: usize = 2000;
    const BLOCKS: usize = 15;

    pub fn measure() {
        PAIRS.iter().for_each(|(near, far)| namespace::make_pair(near, far));
        let places = Places::find();
        let server = places.server(|| drives::serve(PAIRS[0].1, RealTime::default()));
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
}
