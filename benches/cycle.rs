//! `cycle_40_csp`: a cycle of the modelled board with 40 drives in CSP: host frame decoded, FIFO, engine, simulated drives,
//! response with CRC. The baseline is what it cannot do without, in one plain loop: two CRCs, 40 slots copied, 40 plants
//! moved. Also memory with 40 drives in OP, and virtual cycles a second.
//!
//! `cycle_40_ahead`: the same over a bus that takes outputs ahead, 8 of them in hand, against the one over the simulated bus
//! itself. That bus is the simulated one behind queues; what they take is what any such bus would need.
//!
//! `cycle_40_csp_busy`: the same beside a thread that goes over more memory than the caches hold, on another processor.

mod common;
#[path = "common/board.rs"]
mod host;
#[path = "common/places.rs"]
mod places;

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use ecmsk::sk::{Frame, crc::frame_crc};
use ecmsk::slave::plant::{Motor, Servo, Setpoint};
use host::{Path, Program, SIZE, drives_in_op, drives_in_op_ahead};
use places::Places;
use support::ahead_bus::Ahead;

const DRIVES: usize = 40;
const CYCLE_NS: u64 = 1_000_000;
fn main() {
    let memory_before = resident_kib();
    let mut board = drives_in_op(DRIVES);
    common::fact("memory_40_drives_op", resident_kib() - memory_before, "KiB");

    let mut host = Program::new(&mut board, DRIVES);
    let mut ahead = drives_in_op_ahead(DRIVES, Ahead::kind(64, 2, 333_333, 0));
    let mut host_ahead = Program::new(&mut ahead, DRIVES);
    (0..8).for_each(|_| host_ahead.send());
    let mut plain = PlainLoop::new();
    common::pair("cycle_40_csp", 2.3, || host.cycle(), || plain.cycle());
    common::pair("cycle_40_ahead", 1.2, || host_ahead.cycle(), || host.cycle());
    host_ahead.assert_well();

    let cycles = 20_000;
    let start = Instant::now();
    (0..cycles).for_each(|_| host.cycle());
    common::fact("virtual_cycles_per_second_40_drives", f64::from(cycles) / start.elapsed().as_secs_f64(), "1/s");
    if thread::available_parallelism().is_ok_and(|processors| processors.get() > 1) {
        let busy = Busy::start();
        common::pair("cycle_40_csp_busy", 2.7, || host.cycle(), || plain.cycle());
        busy.end();
    }
    host.assert_well();
}

/// A program that keeps another processor and the caches busy.
struct Busy {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Busy {
    /// More than the last cache of today's machines holds, in numbers of 8 bytes: 256 MiB.
    const NUMBERS: usize = 32 << 20;

    /// Starts it, and stays on another processor from now on.
    fn start() -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let seen = ends.clone();
        let thread = Places::find().server(|| {
            thread::spawn(move || {
                let mut numbers = vec![1u64; Self::NUMBERS];
                while !seen.load(Ordering::Relaxed) {
                    for number in &mut numbers {
                        *number = number.wrapping_mul(3);
                    }
                    black_box(&mut numbers);
                }
            })
        });
        Self { ends, thread }
    }

    fn end(self) {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.join().expect("it only counts");
    }
}

struct PlainLoop {
    command: Frame,
    report: Frame,
    plants: Vec<Servo>,
    path: Path,
}

impl PlainLoop {
    fn new() -> Self {
        Self {
            command: Frame::new(),
            report: Frame::new(),
            plants: vec![Servo::new(&Motor::default(), 0); DRIVES],
            path: Path::default(),
        }
    }

    fn cycle(&mut self) {
        let from = self.path.target;
        self.path.advance();
        let by = f64::from(self.path.target - from);
        black_box(frame_crc(black_box(self.command.wire(SIZE))));
        for (n, plant) in self.plants.iter_mut().enumerate() {
            plant.run(Setpoint::Position { from: from.into(), fraction: 0.0, by }, CYCLE_NS);
            let at = (n + 1) * SIZE.bytes();
            self.report.bytes_mut()[at..at + 12].copy_from_slice(&self.command.bytes()[at..at + 12]);
        }
        let crc = frame_crc(self.report.wire(SIZE));
        self.report.bytes_mut()[3] = crc;
        black_box(&self.report);
    }
}

/// This process's memory, `VmRSS` of proc(5).
fn resident_kib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
    line.split_whitespace().next().and_then(|kib| kib.parse().ok()).unwrap_or_default()
}
