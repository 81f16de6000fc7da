//! The row `clear`, of SET_STATE: entries in the FIFO when it requests a lower state.

use ecmsk::cia402::Controlword;
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::master::Settings;
use ecmsk::sk::{MasterCommand, MasterState, SlaveCommand, SlotSize, StateByte};

use crate::drives::{fill, models, on, switch_on};
use crate::machine::{Behind, Machine};
use crate::tap::Log;

/// Drives that are on, at the end of a wire.
fn on_wire(drives: usize) -> Machine {
    let (log, network) = (Log::default(), SimHandle::default());
    let wires = ChainWires::new(log.tapped(models(drives)), network.clone()).expect("they have an EEPROM");
    let bus = Box::new(NicBus::new(wires, Settings::default()));
    let mut machine = Machine::over(SlotSize::Bytes12, bus, network, log);
    machine.drives_in_op(drives, 1000);
    switch_on(&mut machine, drives);
    machine
}

/// Sends that many targets, SV_OFF behind them and SET_STATE to PreOP at once: the newest target and controlword that the first
/// slave had, and the targets that were left out.
fn leave(machine: &mut Machine, waiting: i32) -> (i32, Controlword, usize) {
    machine.fresh();
    fill(machine, 1..=1, 1, waiting);
    machine.slave(1, SlaveCommand::ServoOff).master(MasterCommand::SetState(MasterState::PreOp));
    machine.until("PreOP", |machine| machine.answer().state == StateByte::reached(MasterState::PreOp));
    let sent: Vec<_> = machine.log.take().iter().filter_map(|row| row[0]).map(|took| took.axes[0]).collect();
    let last = sent.iter().filter(|axis| axis.target > 0).map(|axis| axis.target).max().unwrap_or_default();
    let left_out = (1..=last).filter(|target| !sent.iter().any(|axis| axis.target == *target)).count();
    let mut off = sent.iter().filter(|axis| axis.controlword.0 & 0x000F != 0);
    (last, off.next_back().map_or(Controlword::default(), |axis| axis.controlword), left_out)
}

/// XF-20.16 SV_OFF behind the end of a motion, and SET_STATE to a lower state at once: on every bus the targets are
/// sent and the axis is switched off before OP is left, within the time that a board takes for the change.
#[test]
fn what_waits_is_sent_before_op_is_left() {
    for ahead in [1, 4, 20] {
        for waiting in [1, 6, 12, 16] {
            for mut machine in [on(Behind::Board, 2), on(Behind::Chip { ahead }, 2), on_wire(2)] {
                let (last, word, left_out) = leave(&mut machine, waiting);
                assert_eq!((last, word.0 & 0x0F, left_out), (waiting, 6, 0), "ahead {ahead}, {waiting} waiting");
            }
        }
    }
}

/// XF-20.16 Entries that wait longer are cleared, and counted: a full FIFO does not keep the network in OP. Behind a
/// chip it is unknown which outputs still reach slaves that leave OP: they are executed, and count as lost for these
/// slaves.
#[test]
fn what_waits_for_too_long_is_counted() {
    for (mut machine, most, may_reach) in
        [(on(Behind::Board, 2), 25, 0), (on(Behind::CHIP, 2), 80, 40), (on_wire(2), 25, 0)]
    {
        let before = machine.counters();
        let (last, _, left_out) = leave(&mut machine, 150);
        assert!((20..=most).contains(&last), "{last}");
        assert_eq!(left_out, 0);
        let counters = machine.counters();
        // The targets, and the frames of SET_FIFO, SV_OFF and SET_STATE.
        assert_eq!(counters.executed - before.executed + counters.cleared, 153, "{last}: {counters:?}");
        assert!(counters.for_lost <= may_reach, "{last}: {counters:?}");
        assert!(counters.executed - before.executed <= last as u64 + 1 + counters.for_lost, "{last}: {counters:?}");
    }
}
