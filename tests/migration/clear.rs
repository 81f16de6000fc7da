//! The row `clear`: how long SET_FIFO clear takes.

use ecmsk::sk::{FifoAction, MasterCommand};

use crate::drives;
use crate::machine::{Behind, Machine};

/// Targets sent behind a clear in the middle of a motion, and reports until a target that follows the clear at once is
/// executed: the maximum over several moments.
fn clear(behind: Behind, drives: usize) -> (i32, usize) {
    let all: Vec<_> = (0..6).map(|moment| clear_at(behind, drives, moment)).collect();
    let most = |of: fn(&(i32, usize)) -> usize| all.iter().map(of).max().unwrap_or_default();
    (most(|(sent, _)| *sent as usize) as i32, most(|(_, reports)| *reports))
}

fn clear_at(behind: Behind, drives: usize, moment: usize) -> (i32, usize) {
    let mut machine = drives::on(behind, drives);
    drives::fill(&mut machine, 1..=drives, 1, 140);
    machine.read_some(40 + moment);
    let newest = |machine: &Machine| machine.log.newest(1).expect("it moves").axes[0].target;
    let at = newest(&machine);
    machine.fresh().master(MasterCommand::SetFifo(FifoAction::Clear));
    drives::targets(&mut machine, 1..=drives, 1000);
    let reports = machine.until("the next target", |machine| newest(machine) == 1000);
    let sent = machine.log.take();
    let last = sent.iter().filter_map(|row| row[0].map(|took| took.axes[0].target)).filter(|target| *target < 1000);
    let last = last.max().expect("it moved");
    machine.settle();
    assert_eq!(newest(&machine), 1000, "nothing that was cleared comes later");
    (last - at, reports)
}

/// XF-20.5 Cleared targets are never sent, on either bus. Behind a chip the clear takes some cycles, and targets sent
/// until then count as executed.
#[test]
fn a_clear_takes_some_cycles() {
    for (drives, most) in [(2, (6, 12)), (40, (6, 12))] {
        let (sent, reports) = clear(Behind::Board, drives);
        assert!(sent <= 2 && reports <= 2, "{sent}, {reports}");
        let (sent, reports) = clear(Behind::CHIP, drives);
        assert!(sent <= most.0 && reports <= most.1, "{drives} drives: {sent} sent, {reports} reports");
    }
}
