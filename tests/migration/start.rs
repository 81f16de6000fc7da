//! The row `start`: how long the way to OP takes.

use ecmsk::cia402::Mode;
use ecmsk::migrate::{Network, time_to_op_ns};
use ecmsk::sk::{MasterState, SlaveKind, SlotSize};

use crate::drives;
use crate::machine::{Behind, Machine};

/// Milliseconds from SET_STATE to OP, with so many drives and as many more that are declared none.
fn start_ms(behind: Behind, drives: usize, none: usize) -> u64 {
    let mut machine = Machine::new(behind, SlotSize::Bytes12, drives::models(drives + none));
    machine.declare(&vec![SlaveKind::Drive; drives], &vec![Some(Mode::Csp); drives], 1000);
    let from = machine.now_ns();
    machine.go(MasterState::Op);
    (machine.now_ns() - from) / 1_000_000
}

/// XF-20.9 The way to OP takes longer behind a chip, the more slaves there are.
#[test]
fn the_way_to_op_takes_longer() {
    for (drives, most) in [(2, 700), (8, 1400), (40, 5200)] {
        let [board, chip] = Behind::BOTH.map(|behind| start_ms(behind, drives, 0));
        assert!(board <= 950 && board < chip && chip <= most, "{drives} drives: {board} and {chip} ms");
    }
}

/// XF-20.9 TOOL-201 What `migrate` tells of the way to OP is what the model of a chip takes, but for a tenth.
#[test]
fn the_estimate_is_what_the_model_takes() {
    for (drives, none) in [(2, 0), (8, 0), (40, 0), (6, 2), (8, 8)] {
        let mut network = Network { found: drives + none, ..Network::default() };
        network.kinds[..drives].fill(Some(SlaveKind::Drive));
        let (told, model) = (time_to_op_ns(&network) / 1_000_000, start_ms(Behind::CHIP, drives, none).cast_signed());
        assert!((told - model).abs() * 10 <= model, "{drives} drives, {none} none: {told} and {model} ms");
    }
}
