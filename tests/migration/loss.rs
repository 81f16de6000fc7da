//! The row `loss`: time until a lost slave is reported.

use std::time::Duration;

use ecmsk::sk::{MasterState, StateByte};

use crate::drives;
use crate::machine::Behind;

/// Milliseconds until a lost slave is reported: the maximum over several moments. The lost slave is the last one, whose
/// state is read last.
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

/// XF-20.6 A board reports a lost slave in the next cycle; behind a chip the states of all slaves are read first, one
/// by one.
#[test]
fn a_lost_slave_is_named_later() {
    for (drives, most) in [(2, 12), (8, 25), (40, 80)] {
        let board = named_after(Behind::Board, drives);
        assert!(board <= 2, "{drives} drives: {board}");
        let chip = named_after(Behind::CHIP, drives);
        assert!(chip <= most, "{drives} drives: {chip} ms");
    }
}

/// XF-20.6 A board sends no reports while the cable is cut before its first slave in OP. Behind a chip reports go on,
/// with all slaves lost. Both recover when the cable is plugged in again.
#[test]
fn a_cut_before_the_first_slave_is_no_silence() {
    let mut board = drives::on(Behind::Board, 2);
    board.fresh();
    board.network.cut_after(0);
    for _ in 0..3 {
        board.says_nothing(Duration::from_millis(1));
    }
    assert!(board.says_nothing(Duration::from_secs(2)));

    let mut chip = drives::on(Behind::CHIP, 2);
    chip.fresh();
    chip.network.cut_after(0);
    let named = chip.until("the loss", |machine| machine.answer().state.is_failed());
    assert!(named <= 12, "{named} ms");
    for _ in 0..2000 {
        assert_eq!(chip.read().answer().state, StateByte(0x18));
    }

    for mut machine in [board, chip] {
        machine.network.heal();
        machine.read_some(200);
        assert_eq!(machine.answer().state, StateByte(0x18));
        machine.go(MasterState::Op).settle();
        assert_eq!(machine.answer().state, StateByte(0x08));
    }
}
