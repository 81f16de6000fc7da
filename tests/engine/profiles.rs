//! The two firmware profiles side by side: the same frames, and reports that differ only where the rules say so.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::sk::{
    DriveSync, FifoAction, MasterCommand, MasterState, RawSlot, SdoCommand, SlaveCommand, SlaveKind, SlotSize,
};

use crate::host::Host;
use crate::probe::{Bench, drives};

/// A report without the parts that differ in 1.5: byte 1 of slot 0 (SK-2.6) and of slaves' slots (SK-3.5), the full
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

/// SK-3.10 Except for SK-2.6, SK-3.5, SK-3.8, SK-3.9 and SK-5.8 the profiles are the same: a program without homing
/// gets the same answers, cycle by cycle, and the same counts.
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

/// SK-3.31 UG15 2.1.5 Profile 1.5: the answer to DRIVE_MODE is the mode; SK-3.5 of a slave declared as an IO slave, or as
/// none, byte 1 is 0. In 1.7 it is the index (SK-3.4).
#[test]
fn the_answer_to_drive_mode() {
    let kinds = [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::None, SlaveKind::Step];
    for (firmware, shown) in [(Firmware::V15, [9, 0, 9, 0, 9]), (Firmware::V17, [0x33; 5])] {
        let Bench { mut host, .. } = Bench::new(EngineConfig { firmware, ..EngineConfig::default() }, drives(5));
        let declared = std::array::from_fn(|k| kinds.get(k).copied().unwrap_or(SlaveKind::None));
        host.master(MasterCommand::SetAxis { group: 0, kinds: declared });
        host.build(|frame, size| {
            let csv = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync }.with_index(0x33);
            (1..=5).for_each(|slave| frame.put_slave(size, slave, &csv));
        });
        host.cycles(2);
        assert_eq!([1, 2, 3, 4, 5].map(|slave| (host.slot(slave).id, host.slot(slave).index)), shown.map(|n| (6, n)));
    }
}

/// Ends a chain of calls.
fn drop_it(_: &mut Host) {}
