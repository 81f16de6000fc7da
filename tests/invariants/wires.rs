//! Random programs on a board at the end of a network card, over slave controllers and the software master, with random
//! faults: frames that are lost, late or doubled on their way out or back, or come back in another order or with wrong
//! working counters, frames of other protocols and of another master, a card that is down, a late runner, and faults of slaves and cable. The seed
//! chooses whether a runner waits for the time of each cycle, the number of drives and the cycle. `followed` has the
//! invariants.
//!
//! On their way out frames keep their order, as on a cable: a late frame delays those behind it.

mod how;
mod line;

use crate::followed;
use crate::run_all;
use how::How;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 40;

fn schedule(seed: u64) -> followed::Done {
    followed::schedule(seed, &How::random(seed))
}

/// NIC-2.3: whatever goes wrong on the cable, every CSP accepted reaches its slave once and in order or is counted,
/// nothing jumps or comes on by itself, and a SET_STATE brings the board back.
#[test]
fn random_schedules_on_a_network_card() {
    let (schedules, all) = run_all("random_schedules_on_a_network_card", SCHEDULES, schedule);
    if schedules >= SCHEDULES {
        all.assert_enough(schedules);
    }
}
