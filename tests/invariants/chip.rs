//! Random programs on a board behind an ECM-XF while anything goes wrong that can: on the wires between driver and chip, with
//! the chip itself, with slaves and cable, with the host. Which chip, which packets, how many sets ahead and which cycle is
//! another with every seed. What must hold says `followed`.

mod how;
mod line;

use crate::followed;
use crate::run_all;
pub use how::How;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 40;

fn schedule(seed: u64) -> followed::Done {
    followed::schedule(seed, &How::random(seed))
}

/// XF-19.11 XF-19.12 XF-19.13: whatever goes wrong behind a chip, every CSP accepted reaches its slave once and in order or is
/// counted, nothing jumps or comes on by itself, and a SET_STATE brings the board back.
#[test]
fn random_schedules_behind_a_chip() {
    let (schedules, all) = run_all("random_schedules_behind_a_chip", SCHEDULES, schedule);
    if schedules >= SCHEDULES {
        all.assert_enough(schedules);
    }
}
