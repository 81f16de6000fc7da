//! Random programs on a board behind an ECM-XF with random faults: of the wires between driver and chip, of the chip
//! itself, of slaves and cable, of the host. The seed chooses the chip, the packets, the number of sets ahead and the
//! cycle. `followed` has the invariants.

mod how;
mod line;

use crate::followed;
use crate::run_all;
pub use how::How;
pub use line::Trouble;

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
