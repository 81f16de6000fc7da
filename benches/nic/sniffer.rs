//! When frames of a cycle have come, by the kernel's time stamps.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use ecmsk::ethercat::{Command, FRAME_HEADER_LEN, FRAME_LEN_MAX};

use super::wire::Interface;

/// What does not count at the beginning: cycles come to follow the clock of the slaves.
pub const SETTLING: Duration = Duration::from_secs(5);
/// Times that are as near as that to each other are one, ns.
const BIN_NS: u64 = 1000;
/// A frame is taken for early, not late, by at most that part of a cycle.
const EARLY: u64 = 5;

pub struct Sniffer {
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<Vec<u64>>,
}

impl Sniffer {
    /// Looks at an interface from now on.
    pub fn start(interface: &str) -> Self {
        let interface = Interface::open_stamped(interface);
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let is_over = Arc::clone(&is_over);
            move || {
                super::processor::with_priority(1);
                let (mut frame, mut times) = ([0; FRAME_LEN_MAX], Vec::with_capacity(1 << 22));
                while !is_over.load(Ordering::Relaxed) {
                    let Some(at) = interface.take_stamped(&mut frame) else { continue };
                    // A frame of a cycle begins with the clock.
                    if frame[FRAME_HEADER_LEN] == Command::Frmw.code() {
                        times.push(at);
                    }
                }
                times
            }
        });
        Self { is_over, thread }
    }

    /// How late frames were that should come each `cycle`: what `share` of 1000 do not exceed, ns. Those are in time that come
    /// when most of them come.
    pub fn late_ns(self, cycle: Duration, share: usize) -> f64 {
        self.is_over.store(true, Ordering::Relaxed);
        let times = self.thread.join().expect("no panic");
        let cycle_ns = cycle.as_nanos() as u64;
        let settling = SETTLING.as_nanos() as u64 / cycle_ns;
        let phases: Vec<u64> = times.iter().skip(settling as usize).map(|at| at % cycle_ns).collect();
        let mut often = vec![0_u32; (cycle_ns / BIN_NS) as usize + 1];
        phases.iter().for_each(|phase| often[(phase / BIN_NS) as usize] += 1);
        let most = often.iter().zip(0..).max().expect("it runs for longer than it settles").1 * BIN_NS;
        // A frame may be early, too, by less than a cycle.
        let early = cycle_ns / EARLY;
        let mut late: Vec<u64> = phases.iter().map(|phase| (phase + cycle_ns + early - most) % cycle_ns).collect();
        late.sort_unstable();
        late[late.len() * share / 1000] as f64 - early as f64
    }
}
