//! The row `latency`: how many reports pass until one answers a command.

use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::sk::{Motion, SlaveCommand};

use crate::drives;
use crate::machine::{Behind, Machine};
use crate::stall;

/// Reports until the slot of slave 1 shows the command with that index.
fn reports(machine: &mut Machine, index: u8) -> usize {
    machine.fresh();
    machine.send(|frame, size| {
        frame.put_slave(size, 1, &SlaveCommand::Csp(Motion::to(0)).with_index(index));
    });
    machine.until("the answer", |machine| machine.slot(1).index == index)
}

/// The maximum of several measurements, at different times within a cycle.
fn latency(mut machine: Machine, drives: usize) -> usize {
    drives::switch_on(&mut machine, drives);
    let once = |index: u8| {
        machine.sleep(std::time::Duration::from_micros(u64::from(index) * 170));
        reports(&mut machine, index % 3 + 1)
    };
    (1..=30).map(once).max().expect("some")
}

/// XF-20.2 An answer comes with the next report of a board; with slaves behind a chip some reports later, and a program of 40
/// drives does not wait much longer than one of two. How many it is depends on where in the chip's cycle the exchanges fall.
#[test]
fn an_answer_comes_some_reports_later() {
    for (drives, size, most) in [(2, None, 6), (2, stall::LARGE, 9), (8, None, 6), (8, stall::LARGE, 9), (40, None, 8)]
    {
        assert_eq!(latency(drives::in_op(Behind::Board, drives), drives), 1, "{drives} drives");
        let later = latency(stall::machine(XfBusOptions::DEFAULT.ahead, drives, size).0, drives);
        assert!((2..=most).contains(&later), "{drives} drives, {size:?}: {later}");
    }
}
