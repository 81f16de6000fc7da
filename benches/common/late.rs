//! How late the cycles of a board on the real clock begin.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::sync::{Arc, Mutex};
use std::time::Instant;

use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{CycleDone, Fieldbus, Inputs, Ns};
use support::hand_on;

/// Instants at which cycles began, each with the time at which it was due by its own clock.
pub type Begins = Arc<Mutex<Vec<(Instant, Ns)>>>;

/// A bus that notes when it is polled, as long as there is room in `begins`.
pub struct Watched {
    pub bus: SimBus,
    pub begins: Begins,
}

impl Fieldbus for Watched {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        let mut begins = self.begins.lock().expect("nobody panics");
        if begins.len() < begins.capacity() {
            begins.push((Instant::now(), now));
        }
        self.bus.poll(now, inputs)
    }
}

/// The lateness that 99 of 100 cycles do not exceed, nanoseconds, counted from the one that was least late.
pub fn p99_lateness(begins: impl Iterator<Item = (Instant, Ns)>) -> f64 {
    let mut begins = begins.peekable();
    let start = begins.peek().expect("cycles ran").0;
    let mut late: Vec<i64> = begins.map(|(at, due)| at.duration_since(start).as_nanos() as i64 - due as i64).collect();
    late.sort_unstable();
    (late[late.len() * 99 / 100] - late[0]) as f64
}
