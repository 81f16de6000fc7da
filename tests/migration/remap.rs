//! The row `remap`: slaves that return while others are in OP.

use ecmsk::sk::MasterState;

use crate::drives;
use crate::machine::Behind;

/// Milliseconds until that many lost slaves have returned.
fn back_ms(behind: Behind, drives: usize, lost: usize) -> u64 {
    let mut machine = drives::on(behind, drives);
    (1..=lost as u8).for_each(|slave| machine.network.lose(slave));
    machine.until("the loss", |machine| machine.answer().state.is_failed());
    machine.rest(100);
    (1..=lost as u8).for_each(|slave| machine.network.find(slave));
    let from = machine.fresh().now_ns();
    machine.go(MasterState::Op);
    assert!(machine.word(drives).is_enabled(), "the others stay in OP");
    (machine.now_ns() - from) / 1_000_000
}

/// XF-20.7 Slaves return one by one behind a chip, and together on a board; the others stay in OP.
#[test]
fn slaves_come_back_one_by_one() {
    for (drives, lost, most) in [(2, 1, 550), (8, 3, 1520), (40, 1, 950)] {
        let [board, chip] = Behind::BOTH.map(|behind| back_ms(behind, drives, lost));
        assert!(board <= 450 && chip <= most, "{lost} of {drives}: {board} and {chip} ms");
    }
}
