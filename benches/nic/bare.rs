//! The bare loop: sleeps until its time, sends the frame with the process data, and waits until it is back.

use std::time::Duration;

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

use super::bench::{MEASURED, PRIORITY, WARM_UP};
use super::drives::Master;
use super::processor;
use super::wire::Interface;

pub struct Bare {
    master: Master,
    frame: Vec<u8>,
}

impl Bare {
    /// 40 drives, switched on.
    pub fn new(interface: &str) -> Self {
        let mut master = Master::new(Interface::open(interface));
        master.bring_to_op();
        Self { master, frame: super::drives::with_clock_and_states() }
    }

    /// The processor's time of a cycle.
    pub fn processor_ns(&mut self, cycle: Duration) -> f64 {
        self.in_a_thread(move |bare| {
            bare.cycles(WARM_UP, cycle);
            let before = processor::of_this_thread();
            bare.cycles(MEASURED, cycle);
            (processor::of_this_thread() - before) as f64 / MEASURED as f64
        })
    }

    /// Goes on for that long once it has settled; how many cycles were lost by what counts as lost of ours.
    pub fn run(&mut self, settling: Duration, time: Duration, cycle: Duration) -> u64 {
        let cycles = |time: Duration| (time.as_nanos() / cycle.as_nanos()) as u64;
        self.in_a_thread(move |bare| {
            bare.cycles(cycles(settling), cycle);
            bare.cycles(cycles(time), cycle)
        })
    }

    fn in_a_thread<T: Send>(&mut self, run: impl FnOnce(&mut Self) -> T + Send) -> T {
        std::thread::scope(|scope| {
            let thread = scope.spawn(|| {
                processor::with_priority(PRIORITY);
                run(self)
            });
            thread.join().expect("no panic")
        })
    }

    /// How many of them were lost: left out, or with an answer that is back later than ours is waited for.
    fn cycles(&mut self, count: u64, cycle: Duration) -> u64 {
        let mut lost = 0;
        let mut due = Duration::try_from(clock_gettime(ClockId::Monotonic)).expect("a time");
        for _ in 0..count {
            due += cycle;
            let until = Timespec::try_from(due).expect("a time");
            clock_nanosleep_absolute(ClockId::Monotonic, &until).expect("it sleeps");
            self.master.exchange(&self.frame);
            let back = Duration::try_from(clock_gettime(ClockId::Monotonic)).expect("a time");
            lost += u64::from(back > due + cycle * 3 / 4);
            // As ours it leaves cycles out that it is too late for.
            while due + cycle + cycle / 2 < back {
                due += cycle;
                lost += 1;
            }
        }
        lost
    }
}
