//! Random programs whose slaves obey within a cycle, on any bus, with random faults: of the path to the slaves ([`Ends`]),
//! of slaves and cable, of the host.
//!
//! Every target and every mark in a module's outputs is unique and rises, so that each one is recognised. Slaves obey within
//! a cycle (`follower`). Invariants of each slave, in the order of events at its end (`books`):
//!
//! - **order**: the target of an enabled axis is its position, or an accepted target that has not come yet and is newer than
//!   all that have come. The same holds for marks. So no value comes late, without a command, or again after another one.
//! - **no jump**: the target of an axis that becomes enabled is its position. It may have been pushed 300 cycles before, not
//!   later.
//! - **nothing by itself**: only an accepted SV_ON switches an axis on; if the axis was off or its slave below OP since
//!   then, only one that may still have been held then. A module's outputs that were off come on only by a newer mark.
//!
//! And at each rest, since the last one:
//!
//! - frames queued = executed + cleared, exactly;
//! - commands that were accepted and did not arrive are in the frames cleared (`cleared`), in the sets lost (`outputs_lost`,
//!   each with one frame at most), or counted one by one (`for_lost`, `discarded_before_enabled`, `rejected`). The counters
//!   may be higher: the sets of an exchange with an unknown end are counted as lost and may have arrived, and sets without a
//!   command count as well;
//! - no frame that has arrived counts as cleared, except as many as sets were lost;
//! - without a fault no set was lost.
//!
//! In the end everything is healed: a SET_STATE brings the board back to OP, and 200 targets arrive without a loss.

mod books;
mod follower;
mod program;

use std::fmt::Debug;
use std::ops::AddAssign;

use ecmsk::engine::Board;
use ecmsk::fieldbus::{Fieldbus, Ns};
use ecmsk::sk::Frame;
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use support::dice::Dice;

use books::Account;
use program::Program;

/// Cycles between two rests, and how many rests.
const CYCLES: u64 = 700;
const RESTS: usize = 3;

/// The bus of a schedule and how it is used.
pub trait Setting {
    /// The faults of the bus while it runs.
    type Ends: Ends;

    /// Drives behind the module of digital outputs.
    fn drives(&self) -> usize;

    fn cycle_us(&self) -> u32;

    fn state_timeout_ns(&self) -> Ns;

    /// Whether its slaves have an identity, as those behind slave controllers must.
    fn have_identity(&self) -> bool;

    /// The bus to these slaves, which `network` reaches.
    fn bus(&self, seed: u64, slaves: Vec<Box<dyn Slave>>, network: SimHandle) -> (Box<dyn Fieldbus>, Self::Ends);
}

/// Faults between the board and its slaves, which a schedule sets at any time.
pub trait Ends {
    /// Makes one of 16 faults; 7 to 12 are those of slaves and cable, which are not used here.
    fn fault(&mut self, what: u64, cycle_us: u32, dice: &mut Dice);

    /// Whether slaves are silent now and then that pass the others' frames.
    fn has_silent_slaves(&self) -> bool {
        true
    }

    /// Ends all faults.
    fn mend(&mut self);

    /// The number of faults so far.
    fn faults(&self) -> u64;

    /// Runs a cycle of the board.
    fn cycle(&mut self, board: &mut Board, report: &mut dyn FnMut(&Frame, Ns)) {
        board.cycle(report);
    }
}

/// Prints the setting of a schedule if the schedule fails.
struct ToldOnPanic<'a, S: Debug>(&'a S);

impl<S: Debug> Drop for ToldOnPanic<'_, S> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("with {:?}", self.0);
        }
    }
}

/// Runs the schedule of a seed.
pub fn schedule<S: Setting + Debug>(seed: u64, setting: &S) -> Done {
    let _told = ToldOnPanic(setting);
    let mut program = Program::new(seed, setting);
    for _ in 0..RESTS {
        program.run(CYCLES);
        program.rest();
    }
    program.comes_back();
    program.done()
}

/// Totals of the schedules, so that none passes without events.
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

    /// Asserts that the schedules had enough events.
    pub fn assert_enough(&self, schedules: u64) {
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
