//! Differences of SET_STATE over an ECM-XF: slaves that are silent or refuse, many slaves of two channels, long cycles.
//! Each has a row in the table of docs/MIGRATION.md.

use ecmsk::engine::{EngineConfig, StateFailure};
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::fieldbus::{AlState, Ns, SlaveSet};
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveKind, StateByte};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{AlStatus, Slave};
use support::chip_line::xf_bus_reached_by;

use crate::host::Host;
use crate::probe::drives;

use MasterState::{Op, PreOp, SafeOp};

const SECOND: Ns = 1_000_000_000;

fn board(slaves: Vec<Box<dyn Slave>>, state_timeout_ns: Ns) -> (Host, SimHandle) {
    let handle = SimHandle::default();
    let config = EngineConfig { state_timeout_ns, ..EngineConfig::default() };
    (Host::new(config, xf_bus_reached_by(slaves, handle.clone(), XfBusOptions::DEFAULT)), handle)
}

/// XF-20.9 SK-4.55 A slave that is silent ends SET_STATE when the chip asks it for its process data, or when an SDO to it has
/// timed out, and not after the 10 s of a board.
#[test]
fn a_silent_slave_fails_sooner() {
    for cycles in [0, 30] {
        let (mut host, network) = board(drives(2), 10 * SECOND);
        host.declare_drives(2).cycle();
        let asked = host.board.now();
        host.master(MasterCommand::SetState(SafeOp)).cycles(cycles);
        network.silence(2, true);
        host.until("the failure", |host| host.state() == StateByte::failed(Some(PreOp)));
        let took = host.board.now() - asked;
        assert!(took < 2 * SECOND, "{took} ns");
        assert_eq!(host.board.engine().state_failure(), Some(StateFailure::Silent { slave: 2 }));
        network.silence(2, false);
        host.go(Op);
    }
}

/// XF-20.9 SK-4.57 The chip lays out the process data of all slaves, also of one that is declared none: while that is silent
/// the others do not go to OP.
#[test]
fn a_silent_slave_declared_none_is_missed() {
    let (mut host, network) = board(drives(3), 10 * SECOND);
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[1] = SlaveKind::None;
    host.master(MasterCommand::SetAxis { group: 0, kinds }).cycle();
    network.silence(2, true);
    host.master(MasterCommand::SetState(Op))
        .until("the failure", |host| host.state() == StateByte::failed(Some(PreOp)));
    assert_eq!(host.board.engine().state_failure(), Some(StateFailure::Silent { slave: 2 }));
    network.silence(2, false);
    host.go(Op);
}

/// XF-20.9 SK-4.57 Slaves that are declared none do not prevent the others from reaching SafeOP, to which all go by one
/// command: with six of 40 it takes hardly longer than without. The others go to OP one by one, and are there long
/// before SET_STATE times out.
#[test]
fn slaves_declared_none_keep_nobody_back() {
    let way = |none: &[usize]| {
        let (mut host, _) = board(drives(40), 10 * SECOND);
        for group in 0..5u8 {
            let kind =
                |k| if none.contains(&(usize::from(group) * 8 + k + 1)) { SlaveKind::None } else { SlaveKind::Drive };
            host.master(MasterCommand::SetAxis { group, kinds: std::array::from_fn(kind) });
        }
        [SafeOp, Op].map(|state| {
            let asked = host.board.now();
            host.go(state);
            (host.board.now() - asked) / 1_000_000
        })
    };
    let [all, others] = [way(&[]), way(&[5, 12, 19, 26, 33, 40])];
    assert!(others[0] < all[0] + 200, "{all:?} and {others:?}");
    assert!(all[1] < 500 && (1500..2500).contains(&others[1]), "{all:?} and {others:?}");
}

/// XF-20.7 SK-4.74 Of three slaves that were lost together one refuses PreOP: the others do not come back until it does.
#[test]
fn one_that_refuses_keeps_the_others_back() {
    let (mut host, network) = board(drives(3), 10 * SECOND);
    host.op(3);
    [1, 2, 3].into_iter().for_each(|slave| network.lose(slave));
    host.until("the losses", |host| host.board.engine().lost() == SlaveSet::first(3));
    [1, 2, 3].into_iter().for_each(|slave| network.find(slave));
    network.refuse(1, Some((AlState::PreOp, AlStatus(0x0011))));
    host.master(MasterCommand::SetState(Op)).cycles(15_000);
    assert_eq!((host.state().0, host.board.engine().lost()), (0x18, SlaveSet::first(3)));
    network.refuse(1, None);
    host.go(Op);
}

/// XF-20.1 SK-4.11 A cycle of 128 ms is accepted, and ends OP: the watchdog of a slave expires before the next outputs
/// come.
#[test]
fn a_cycle_longer_than_the_watchdog_ends_op() {
    for (us, state) in [(64_000, 0x08), (128_000, 0x18)] {
        let (mut host, _) = board(drives(1), 10 * SECOND);
        let cycle = CycleTime::from_us(us).unwrap();
        host.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto }).op(1).cycles(40);
        assert_eq!((host.state().0, host.counters().rejected_total()), (state, 0), "{us} us");
    }
}
