//! The row `loss`: when a slave that is lost is named.

use ecmsk::sk::MasterState;

use crate::drives;
use crate::machine::Behind;

/// Milliseconds until a lost slave is named: the most of some moments. The last one is lost, whose state is read last.
fn named_after(behind: Behind, drives: usize) -> usize {
    let mut machine = drives::on(behind, drives);
    let mut most = 0;
    for moment in 0..6 {
        machine.fresh().rest(17 * moment + 1);
        machine.network.lose(drives as u8);
        most = most.max(machine.until("the loss", |machine| machine.answer().state.is_failed()));
        machine.network.find(drives as u8);
        machine.go(MasterState::Op).settle();
    }
    most
}

/// XF-20.6 A board names a lost slave in the next cycle; behind a chip the states of all slaves are read first, one by one.
#[test]
fn a_lost_slave_is_named_later() {
    for (drives, most) in [(2, 12), (8, 25), (40, 80)] {
        let board = named_after(Behind::Board, drives);
        assert!(board <= 2, "{drives} drives: {board}");
        let chip = named_after(Behind::CHIP, drives);
        assert!(chip <= most, "{drives} drives: {chip} ms");
    }
}
