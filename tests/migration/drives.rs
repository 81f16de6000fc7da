//! Machines of nothing but drives in CSP, on which the rows of the table are measured: the figures of docs/MIGRATION.md.

use ecmsk::sk::{FifoAction, MasterCommand, Motion, SlaveCommand, SlotSize};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::machine::{Behind, Machine};

pub fn models(drives: usize) -> Vec<Box<dyn Slave>> {
    (0..drives).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

/// That many drives in CSP, in OP with a cycle of 1 ms.
pub fn in_op(behind: Behind, drives: usize) -> Machine {
    let mut machine = Machine::new(behind, SlotSize::Bytes12, models(drives));
    machine.drives_in_op(drives, 1000);
    machine
}

/// The same, all switched on.
pub fn on(behind: Behind, drives: usize) -> Machine {
    let mut machine = in_op(behind, drives);
    switch_on(&mut machine, drives);
    machine
}

pub fn switch_on(machine: &mut Machine, drives: usize) {
    machine.servo_on(&(1..=drives).collect::<Vec<_>>()).settle();
    machine.log.take();
}

/// A frame with a target for each of these drives.
pub fn targets(machine: &mut Machine, slaves: std::ops::RangeInclusive<usize>, target: i32) {
    machine.send(|frame, size| {
        slaves.for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(target)).into()));
    });
}

/// Fills the FIFO with that many targets of these drives, each one count further, starting at this one. All begin
/// together with the last one.
pub fn fill(machine: &mut Machine, slaves: std::ops::RangeInclusive<usize>, from: i32, frames: i32) {
    let free = 160 - frames as u32 + 1;
    machine.fresh().master(MasterCommand::SetFifo(FifoAction::Threshold(free)));
    for n in 0..frames {
        targets(machine, slaves.clone(), from + n);
    }
}

/// The largest number of cycles from 0 to `most` that passes the test; all smaller numbers pass, too.
pub fn most(most: u64, passes: impl Fn(u64) -> bool) -> u64 {
    assert!(passes(0), "it does not hold without any");
    let (mut good, mut bad) = (0, most + 1);
    while good + 1 < bad {
        let middle = (good + bad) / 2;
        if passes(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}
