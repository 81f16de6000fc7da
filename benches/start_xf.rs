//! How long the start of a program takes behind the model of an ECM-XF, in the board's time, so that each run gives the same.
//!
//! `start_xf_9`, `start_xf_40`, `start_xf_40_mixed`: from SET_STATE to SafeOP, with a chip as its link has it by default, against the
//! same start on the simulated bus: 9 drives, 40, and 40 slaves of all kinds of which one is declared none. The program declares them
//! and rests for 2.5 s.
//!
//! `start_xf_9_at_once`: reports until SafeOP if it rests nowhere, of the 1000 after which the vendor's samples give up;
//! `start_xf_40_op`, `start_xf_40_mixed_op`: how long OP takes then.

mod common;

use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use support::chip_line::xf_bus;
use support::start::{Start, Took, times};

const REST_MS: u64 = 2500;

fn main() {
    let mixed = Start::of_forty_mixed().without(&[20]);
    let rested = [
        ("start_xf_9", Start::of_drives(9)),
        ("start_xf_40", Start::of_drives(40)),
        ("start_xf_40_mixed", mixed.clone()),
    ];
    for (name, start) in rested {
        let start = start.resting(REST_MS);
        let [chip, _] = behind_chip(&start);
        let [board, _] = times(&start, SimBus::new(start.slaves()));
        let demand = common::Demand { name, target: Some(1.2), allowance: None, against: Some("the simulated bus") };
        common::pair_of_blocks(demand, 1, || chip.ns as f64, || board.ns as f64);
    }
    let [at_once, _] = behind_chip(&Start::of_drives(9));
    common::limited("start_xf_9_at_once", at_once.reports as f64, "reports", 1000.0);
    for (name, start) in [("start_xf_40_op", Start::of_drives(40)), ("start_xf_40_mixed_op", mixed)] {
        let ns: u64 = behind_chip(&start).iter().map(|took| took.ns).sum();
        common::limited(name, ns as f64 / 1e6, "ms", 6000.0);
    }
}

fn behind_chip(start: &Start) -> [Took; 2] {
    times(start, xf_bus(start.slaves(), XfBusOptions::DEFAULT))
}
