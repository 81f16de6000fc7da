//! Distributed clocks of controllers that lack a part of them.

use std::ops::Range;

use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::Features;
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{Master, Settings, SyncSignals};
use support::odd_line::{OddLine, OddSlave, drive};

use super::odd_rig::Rig;
use super::rig::{CYCLE, SECOND};

/// A drive whose controller lacks these registers.
fn lacking(blocks: &[Range<usize>]) -> OddSlave {
    drive().with(|slave| slave.lacks_registers = blocks.to_vec())
}

fn delay(rig: &Rig, slave: usize) -> u32 {
    let delay = rig.line.slave(slave, |slave| *slave.memory[0x0928..].first_chunk().expect("4 bytes"));
    u32::from_le_bytes(delay)
}

/// MASTER-6.9 A controller with receive times alone counts as one without a clock: it reaches OP, and the delays of the slaves
/// behind it are right. So does one with a clock that has no SYNC unit, or does not show its difference.
#[test]
fn controllers_that_lack_a_part_of_their_clock() {
    const SYNC: Range<usize> = 0x0980..0x0A00;
    let alone: &[Range<usize>] = &[0x0910..0x0918, 0x0920..0x0A00];
    for (lacks, has_clock) in [(alone, false), (std::slice::from_ref(&SYNC), true), (&[0x092C..0x0930, SYNC], true)] {
        for first in [false, true] {
            let mut slaves = vec![lacking(lacks), drive()];
            let (odd, last) = if first { (0, 1) } else { (1, 2) };
            if !first {
                slaves.insert(0, drive());
            }
            let mut rig = Rig::scanned(slaves);
            let clocks: Vec<bool> =
                rig.master.slaves().iter().map(|slave| slave.features.contains(Features::CLOCK)).collect();
            assert_eq!(clocks.iter().position(|clock| !clock), (!has_clock).then_some(odd));
            assert_eq!(delay(&rig, last + 1), if has_clock || !first { 300 * last as u32 } else { 0 });
            rig.reach(AlState::PreOp);
            rig.master.set_sync(last as u8 + 1, Some(SyncSignals::sync0(CYCLE as u32, 0))).expect("a slave");
            rig.bring_to_op();
            rig.next_cycle = None;
            rig.reach(AlState::PreOp);
            rig.bring_to_op();
            assert_eq!(rig.line.slave(last + 1, |slave| slave.memory[0x0981]), 3);
        }
    }
}

/// The time of the reference clock, which has 64 bits.
fn reference_time(rig: &mut Rig, slave: u8) -> u64 {
    let id = rig.master.read_registers(slave, 0x0910, 8);
    let bytes = rig.wait(id).expect("a time");
    u64::from_le_bytes(bytes.try_into().expect("8 bytes"))
}

/// MASTER-6.4 SYNC0 of a clock with 32 bits comes at a multiple of the cycle in the reference's 64 bits, however long the
/// clocks have run.
#[test]
fn sync0_of_clocks_with_32_bits() {
    const SHIFT: i32 = 250_000;
    for after in [1, 3, 5, 20, 100] {
        let short = || drive().with(|slave| slave.clock.as_mut().expect("one").is_short = true);
        let mut line = OddLine::new([drive(), short(), short()]);
        line.wait(line.now() + after * SECOND);
        let master = Master::new(Settings::default());
        let mut rig = Rig { master, line, next_cycle: None, last: Default::default() };
        rig.scan();
        rig.reach(AlState::PreOp);
        for slave in 1..=3 {
            rig.master.set_sync(slave, Some(SyncSignals::sync0(CYCLE as u32, SHIFT))).expect("a slave");
        }
        rig.bring_to_op();
        let now = reference_time(&mut rig, 1);
        for slave in 1..=3 {
            let start = rig.line.slave(slave, |slave| *slave.memory[0x0990..].first_chunk().expect("4 bytes"));
            let ahead = u32::from_le_bytes(start).wrapping_sub(now as u32).cast_signed();
            let start = now.wrapping_add_signed(ahead.into());
            assert_eq!(start % CYCLE, SHIFT as u64, "slave {slave} after {after} s");
        }
    }
}
