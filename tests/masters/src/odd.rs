//! A line of slaves with an implementation of their own ([`support::odd_line`]) at a network interface, on the real clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecmsk::ethercat::{ETHERTYPE, FRAME_LEN_MAX};
use ecmsk::fieldbus::nic::NicWires as _;
use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
use ecmsk::master::Wire as _;
use support::odd_line::{OddLine, OddSlave};

use crate::{MASTER, SLAVES, enter_namespace, make_pair};

/// The interval at which the line polls for frames.
const LOOK: Duration = Duration::from_micros(20);
/// The line's own time passes in such steps until the answer to a frame is back, ns. It takes some microseconds.
const ANSWER_NS: u64 = 1_000_000;

/// Odd slaves that answer in a network namespace of the calling thread, until this is dropped.
pub struct OddRig {
    line: OddLine,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl OddRig {
    /// Moves this thread into a network namespace of its own, where these slaves answer at [`SLAVES`].
    ///
    /// # Panics
    /// The system refuses something.
    pub fn new(slaves: impl IntoIterator<Item = OddSlave>) -> Self {
        enter_namespace();
        make_pair(MASTER, SLAVES);
        let interface = check(SLAVES, DefaultRoute::Allowed).expect("an interface");
        let socket = EthernetSocket::open(&interface, ETHERTYPE).expect("root");
        let (line, is_over) = (OddLine::new(slaves), Arc::new(AtomicBool::new(false)));
        let thread = std::thread::spawn({
            let (line, is_over) = (line.clone(), Arc::clone(&is_over));
            move || answer(line, &socket, &is_over)
        });
        Self { line, is_over, thread: Some(thread) }
    }

    /// Runs `action` on a slave, counted from 1.
    pub fn slave<R>(&self, slave: usize, action: impl FnOnce(&mut OddSlave) -> R) -> R {
        self.line.slave(slave, action)
    }
}

impl Drop for OddRig {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().expect("no panic");
        }
    }
}

/// Answers frames. The line's time follows the real clock; the answer to a frame is sent at once.
fn answer(mut line: OddLine, socket: &EthernetSocket, is_over: &AtomicBool) {
    let (begin, zero) = (Instant::now(), line.now());
    let mut frame = [0; FRAME_LEN_MAX];
    while !is_over.load(Ordering::Relaxed) {
        line.wait(zero + begin.elapsed().as_nanos() as u64);
        while let Ok(Some(len)) = socket.take(&mut frame) {
            let Some(sent) = frame.get(..len) else { continue };
            line.send(sent).expect("the line is up");
            line.wait(line.now() + ANSWER_NS);
            if let Some(len) = line.receive(&mut frame) {
                // A frame that cannot be sent is lost, as on a pulled cable.
                let _ = socket.send(&frame[..len]);
            }
        }
        std::thread::sleep(LOOK);
    }
}
