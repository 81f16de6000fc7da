//! The two firmware profiles side by side: the same frames, and reports that differ where the rules say so only.

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::sk::{FifoAction, MasterCommand, MasterState, RawSlot, SdoCommand, SlaveCommand, SlotSize};

use crate::host::Host;
use crate::probe::{Bench, drives};

/// What 1.5 shows otherwise is taken out of a report: byte 1 of slot 0 (SK-2.6) and of slaves' slots (SK-3.5), the full
/// count (SK-5.8), and the CRC over it all.
fn common(host: &Host) -> Vec<RawSlot> {
    let size = host.size;
    let slots = (0..size.slots()).map(|n| {
        let slot = host.slot(n);
        match n {
            0 => RawSlot { index: 0, parm: slot.parm & 0xFF, data2: slot.data2 & 0xFFFF, ..slot },
            n if n == size.sdo_slot() => slot,
            _ => RawSlot { index: 0, ..slot },
        }
    });
    slots.collect()
}

/// SK-3.10 But for SK-2.6, SK-3.5, SK-3.8, SK-3.9 and SK-5.8 the profiles are the same: a program without homing gets the
/// same answers, cycle by cycle, and the same counts.
#[test]
fn profiles_differ_where_the_rules_say_so_only() {
    for slot in SlotSize::ALL {
        let mut boards = [Firmware::V17, Firmware::V15]
            .map(|firmware| Bench::new(EngineConfig { slot, firmware, ..EngineConfig::default() }, drives(3)).host);
        let mut both = |act: &dyn Fn(&mut Host), cycles: usize| {
            boards.iter_mut().for_each(act);
            for _ in 0..cycles {
                let [new, old] = &mut boards;
                assert_eq!(new.cycle(), old.cycle());
                assert_eq!(common(new), common(old), "{slot:?}");
            }
            let [new, old] = &boards;
            assert_eq!(new.counters(), old.counters(), "{slot:?}");
        };
        both(&|host| drop_it(host.declare_drives(2)), 5);
        both(&|host| drop_it(host.raw(0, RawSlot { id: 0x77, ..RawSlot::ZERO })), 5);
        both(&|host| drop_it(host.master(MasterCommand::SetState(MasterState::Op))), 3000);
        both(&|host| drop_it(host.slave(1, SlaveCommand::ServoOn)), 300);
        both(&|host| drop_it(host.sdo(SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1000, 0) })), 50);
        both(&|host| (0..40).for_each(|n| drop_it(host.csp(1, n * 10))), 100);
        both(&|host| drop_it(host.slave(1, SlaveCommand::GoHome).slave(2, SlaveCommand::AbortHome)), 20);
        both(&|host| (0..200).for_each(|_| drop_it(host.idle())), 20);
        both(&|host| drop_it(host.master(MasterCommand::SetFifo(FifoAction::Clear))), 20);
        both(&|host| drop_it(host.slave(1, SlaveCommand::ServoOff)), 300);
        both(&|host| drop_it(host.master(MasterCommand::SetState(MasterState::PreOp))), 500);
    }
}

/// Ends a chain of calls.
fn drop_it(_: &mut Host) {}
