//! Invariants for every program and every fault: random programs on random machines with random faults, on a bus that
//! the runner paces and on late ones, writers of a served board that die, and a long day.
//!
//! - `program.rs`, `path.rs`, `machine.rs`: a random program with its faults, its wishes for a slave, the board on
//!   which it runs
//! - `paced.rs` with `books.rs`, `watch.rs`, `tap.rs`: the invariants on a bus that the runner paces, and their
//!   observation
//! - `late.rs`, `late/`: the same over a bus that takes outputs ahead and answers late
//! - `followed.rs`, `followed/`: programs whose slaves obey within a cycle, and the invariants on any bus; used by
//!   - `chip.rs`, `chip/`: a board behind an ECM-XF, with every fault of that chip and its wires
//!   - `wires.rs`, `wires/`: a board on a network card, with every fault of the cable
//! - `ends.rs`, `day.rs`: writers that die, and the long day
//! - `stalls.rs`, `stalls/`: programs and boards whose process stalls
//!
//! `cargo xtask soak` runs many more of them. To repeat one schedule: `ECMSK_SOAK_FIRST=<seed> ECMSK_SOAK_SCHEDULES=1`.

mod books;
mod chip;
mod day;
mod ends;
mod followed;
mod late;
mod machine;
mod paced;
mod path;
mod program;
mod stalls;
mod tap;
mod watch;
mod wires;

use std::fmt::Debug;
use std::ops::AddAssign;

use machine::Machine;
use paced::Paced;
use program::{Done, Program};
use support::schedules;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 300;
/// Cycles of a schedule in OP, about.
const CYCLES: u64 = 1500;

fn schedule(seed: u64) -> Done {
    let machine = Machine::new(seed);
    let paced = Paced::new(&machine);
    let mut program = Program::new(seed, machine, paced);
    program.run(CYCLES);
    program.done()
}

/// [`schedules::run_all`] for the tests here.
fn run_all<D: AddAssign + Debug + Default>(test: &str, usual: u64, schedule: impl Fn(u64) -> D) -> (u64, D) {
    schedules::run_all("invariants", test, usual, schedule)
}

/// SK-4.44 SK-5.4 SK-5.7 SK-7.16 SK-7.17 SK-7.18: every CSP, CSV and CST accepted is executed once and in order or is
/// in a counter; no shaft jumps; states change by legal transitions; free and held entries are 160.
#[test]
fn random_schedules() {
    let (schedules, all) = run_all("random_schedules", SCHEDULES, schedule);
    if schedules >= SCHEDULES {
        all.assert_enough(schedules);
    }
}
