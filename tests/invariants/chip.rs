//! Random programs on a board behind an ECM-XF while anything goes wrong that can: on the wires between driver and chip, with
//! the chip itself, with slaves and cable, with the host. Which chip, which packets, how many sets ahead and which cycle is
//! another with every seed.
//!
//! Every target and every mark in a module's outputs is one of its own, and rises, so that each that comes is known. Slaves
//! obey within a cycle (`follower`). Of each slave, in the order in which things happen at its end (`books`):
//!
//! - **order**: an enabled axis is sent where it is, or a target that was accepted, has not come yet and is newer than all that
//!   have come. The same holds for marks. So nothing comes twice, late, or without a command.
//! - **no jump**: an axis that becomes enabled is sent where it is. It may have been pushed 300 cycles before, not later.
//! - **nothing by itself**: what switches an axis on is an SV_ON that was accepted, and if the axis was off or its slave below
//!   OP since then, one that may still have been held then. A module's outputs that were off come on by a newer mark alone.
//!
//! And whenever all is at rest, since the last time:
//!
//! - frames queued = executed + cleared, exactly;
//! - commands accepted and not got are in the frames cleared (`cleared`), in the sets lost (`outputs_lost`, each with one frame
//!   at most), or counted one by one (`for_lost`, `discarded_before_enabled`, `rejected`). What is counted may be more: the sets
//!   of an exchange whose end nobody knows are counted as lost and may have arrived, and sets without a command count as well;
//! - no frame counts as cleared that has come, but for as many as sets were lost;
//! - if nothing went wrong no set was lost.
//!
//! In the end everything is mended: a SET_STATE brings the board back to OP, and 200 targets arrive without a loss.

mod books;
mod follower;
mod how;
mod line;
mod program;

use std::ops::AddAssign;

use crate::run_all;
use books::Account;
use how::How;
use program::Program;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 40;
/// Cycles between two rests, and how many rests.
const CYCLES: u64 = 700;
const RESTS: usize = 3;

/// What schedules did, so that none passes for lack of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Done {
    pub cycles: u64,
    pub in_op: u64,
    pub faults: u64,
    pub on_wires: u64,
    pub full: u64,
    pub clears: u64,
    pub accepted: u64,
    pub got: u64,
    pub cleared: u64,
    pub sets_lost: u64,
    pub single: u64,
    pub enabled: u64,
}

impl Done {
    fn numbers(&mut self) -> [&mut u64; 12] {
        let Self { cycles, in_op, faults, on_wires, full, clears, accepted, got, cleared, sets_lost, single, enabled } =
            self;
        [cycles, in_op, faults, on_wires, full, clears, accepted, got, cleared, sets_lost, single, enabled]
    }

    fn account(&mut self, account: &Account) {
        let Account { accepted, got, cleared, sets_lost, single, enabled } = *account;
        *self = Self { accepted, got, cleared, sets_lost, single, enabled, ..*self };
    }

    /// Schedules that do little prove little.
    fn assert_enough(&self, schedules: u64) {
        let least = [
            ("cycles in OP", self.in_op, 1000),
            ("targets accepted", self.accepted, 500),
            ("targets got", self.got, 300),
            ("axes switched on", self.enabled, 2),
            ("faults", self.faults, 2),
        ];
        for (what, n, each) in least {
            assert!(n >= each * schedules, "{what}: only {n} in {schedules} schedules");
        }
        let some = [self.on_wires, self.full, self.clears, self.cleared, self.sets_lost, self.single];
        assert!(some.iter().all(|n| *n > 0), "{self:?}");
    }
}

impl AddAssign for Done {
    fn add_assign(&mut self, mut other: Self) {
        for (all, one) in self.numbers().into_iter().zip(other.numbers()) {
            *all += *one;
        }
    }
}

/// Says how a schedule's chip is used, if it fails there.
struct ToldOnPanic(How);

impl Drop for ToldOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("with {:?}", self.0);
        }
    }
}

fn schedule(seed: u64) -> Done {
    let how = How::random(seed);
    let _told = ToldOnPanic(how);
    let mut program = Program::new(seed, how);
    for _ in 0..RESTS {
        program.run(CYCLES);
        program.rest();
    }
    program.comes_back();
    program.done()
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
