//! The board on a network card, and a program that streams targets to it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::ecm::{Close, Config, Ecm, Stream};
use ecmsk::engine::Counters;
use ecmsk::link::{self, Link, Share};
use ecmsk::sk::MasterState;

use super::bench::{MEASURED, PRIORITY, WARM_UP};
use super::drives::DRIVES;
use super::processor;
use super::sniffer::SETTLING;

/// The thread of the runner.
const THREAD: &str = "ecmsk-board";
/// Frames that the program is ahead.
const DEPTH: u16 = 40;
/// How far a target is from the one before, and the cycles after which the axes turn back.
const STEP: i32 = 20;
const STROKE: u64 = 1000;

/// 40 drives, switched on.
pub struct OnCard {
    link: Arc<dyn Link>,
    ecm: Ecm,
    target: i32,
}

impl OnCard {
    pub fn open(interface: &str, cycle: Duration) -> Self {
        let link = link::open(&format!("nic:{interface}?priority={PRIORITY}"), Share::ByUri).expect("it opens");
        let ecm = Ecm::over(Arc::clone(&link), Default::default()).expect("it talks");
        let cycle_us = cycle.as_micros() as u32;
        ecm.configure(&Config { cycle_us, ..Config::drives(DRIVES.into()) }).expect("40 drives");
        ecm.set_state(MasterState::Op).expect("OP");
        ecm.servo_on(&(1..=DRIVES as u8).collect::<Vec<_>>()).expect("on");
        Self { link, ecm, target: 0 }
    }

    fn counters(&self) -> Counters {
        self.link.stats().board.expect("a board of this process")
    }

    /// The processor's time of a cycle.
    pub fn processor_ns(mut self) -> f64 {
        let mut stream = self.ecm.stream(DEPTH).expect("a stream");
        (0..WARM_UP).for_each(|n| step(&mut stream, &mut self.target, n));
        let (before, reports) = (processor::of_threads(std::process::id(), Some(THREAD)), self.counters().reports);
        (0..MEASURED).for_each(|n| step(&mut stream, &mut self.target, n));
        let (after, cycles) =
            (processor::of_threads(std::process::id(), Some(THREAD)), self.counters().reports - reports);
        drop(stream);
        self.ecm.close(Close::ServoOff).expect("it closes");
        (after - before) as f64 / cycles as f64
    }

    /// Streams for that long; how many cycles were lost, once cycles follow the clock of the slaves.
    pub fn run(&mut self, time: Duration) -> u64 {
        let lost = |counters: Counters| counters.cycles_left_out + counters.answers_lost;
        let mut before = None;
        let mut stream = self.ecm.stream(DEPTH).expect("a stream");
        let begin = Instant::now();
        let mut n = 0;
        while begin.elapsed() < SETTLING + time {
            step(&mut stream, &mut self.target, n);
            n += 1;
            if begin.elapsed() >= SETTLING {
                before.get_or_insert(lost(self.link.stats().board.expect("a board of this process")));
            }
        }
        drop(stream);
        lost(self.counters()) - before.unwrap_or_default()
    }
}

fn step(stream: &mut Stream<'_>, target: &mut i32, n: u64) {
    *target += if n % (2 * STROKE) < STROKE { STEP } else { -STEP };
    for slave in 1..=DRIVES as u8 {
        stream.csp(slave, *target).expect("a target");
    }
    stream.step().expect("a step");
}
