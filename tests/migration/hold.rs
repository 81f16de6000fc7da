//! The row `hold`: outputs in the chip's FIFO while an axis is switched on.

use std::sync::atomic::Ordering;

use ecmsk::sk::{Motion, SlaveCommand};
use ecmsk::xf::DataSize;

use crate::drives;
use crate::judge;
use crate::machine::Machine;
use crate::stall;

/// Cycles in which the moving axis 1 gets a repeated target, with a stall of that many cycles while axis 2 is being
/// switched on; `ahead=20`.
fn repeats(size: Option<DataSize>, cycles: u64) -> Vec<usize> {
    let (mut machine, stood) = stall::machine(20, 2, size);
    machine.servo_on(&[1]).settle();
    machine.log.take();
    drives::fill(&mut machine, 1..=1, 1, 40);
    machine.send(|frame, size| {
        frame.put_slave(size, 1, &SlaveCommand::Csp(Motion::to(41)).into());
        frame.put_slave(size, 2, &SlaveCommand::ServoOn.into());
    });
    (42..=150).for_each(|target| drives::targets(&mut machine, 1..=1, target));
    // It is on some 60 ms later.
    let begins = |machine: &Machine| machine.log.newest(2).is_some_and(|took| took.axes[0].controlword.0 != 0);
    machine.until("the first step", begins);
    machine.read_some(20);
    assert!(!machine.word(2).is_enabled());
    stood.fetch_add(cycles * 1_000_000, Ordering::Relaxed);
    machine.settle();
    assert!(machine.word(2).is_enabled());
    judge::repeats(&machine.log.take(), 1, 0)
}

/// XF-20.4 SK-12.3 While an axis is switched on during a motion, the chip's FIFO is nearly empty, so that the axis is
/// held at its position. A stall of 2 cycles is bridged then, and none of more than 4, for any `ahead=`. Without a
/// stall the motion goes on.
#[test]
fn hardly_anything_lies_in_the_chip_while_an_axis_is_switched_on() {
    let bridged = drives::most(19, |cycles| repeats(stall::SMALL, cycles).is_empty());
    assert!((2..=4).contains(&bridged), "{bridged}");
}

/// XF-20.4 Packets of 1024 bytes take longer than those few sets last: a moving axis then repeats a target every sixth
/// cycle or less often, until the other one is on.
#[test]
fn large_packets_are_too_slow_for_so_few() {
    let repeats = repeats(stall::LARGE, 0);
    let [first, last] = [repeats.first(), repeats.last()].map(|cycle| cycle.copied().unwrap_or_default());
    assert!(last - first <= 60 && 6 * repeats.len() <= last - first + 12, "{repeats:?}");
}
