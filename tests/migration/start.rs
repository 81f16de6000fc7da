//! The row `start`: how long the way to OP takes.

use ecmsk::cia402::Mode;
use ecmsk::sk::{MasterState, SlaveKind, SlotSize};

use crate::drives;
use crate::machine::{Behind, Machine};

/// Milliseconds from SET_STATE to OP.
fn start_ms(behind: Behind, drives: usize) -> u64 {
    let mut machine = Machine::new(behind, SlotSize::Bytes12, drives::models(drives));
    machine.declare(&vec![SlaveKind::Drive; drives], &vec![Some(Mode::Csp); drives], 1000);
    let from = machine.now_ns();
    machine.go(MasterState::Op);
    (machine.now_ns() - from) / 1_000_000
}

/// XF-20.9 The way to OP takes longer behind a chip, the more slaves there are.
#[test]
fn the_way_to_op_takes_longer() {
    for (drives, most) in [(2, 700), (8, 1400), (40, 5200)] {
        let [board, chip] = Behind::BOTH.map(|behind| start_ms(behind, drives));
        assert!(board <= 950 && board < chip && chip <= most, "{drives} drives: {board} and {chip} ms");
    }
}
