//! The cable to the first slave cut below OP: reports go on.

use MasterState::{Init, Op, PreOp, SafeOp};
use ecmsk::engine::EngineConfig;
use ecmsk::sk::{MasterCommand, MasterState};

use crate::network_rig::{Net, buses, set, two_buses};

const PERIOD: u64 = 1_000_000;

/// SK-9.8 SK-9.9 A report every default cycle in Init, PreOP and SafeOP, with the cable to the first slave cut and after it
/// is plugged again. SK-9.12 SK-4.59 Silence is for OP alone. SK-8.2 LIO_RD answers whether or not the network runs.
#[test]
fn reports_go_on() {
    for how in buses() {
        for state in [Init, PreOp, SafeOp] {
            let mut net = Net::new(how, 2);
            net.host.go(state).cycles(30);
            net.network.cut_after(0);
            for n in 0..200u8 {
                if n == 150 {
                    net.network.heal();
                }
                let (reports, now) = (net.host.reports, net.host.board.now());
                net.host.cycle();
                let passed = net.host.board.now() - now;
                assert_eq!((net.host.reports - reports, passed), (1, PERIOD), "{how:?} {state}: cycle {n}");
                net.host.board.engine_mut().set_local_inputs(n & 0x3F);
                net.host.master(MasterCommand::LocalRead).cycle();
                let answer = net.host.answer();
                assert_eq!((answer.id, answer.result), (0x21, u32::from(n & 0x3F)), "{how:?} {state}");
            }
        }
    }
}

/// SK-4.61 SK-4.62 In SafeOP no slave answers then: 0x10 | 4, also when the cable is whole again, until the next
/// SET_STATE. SK-4.55 In Init and PreOP no process data are exchanged that would be missed.
#[test]
fn slaves_that_are_missed_and_others() {
    for how in two_buses() {
        for (state, shown) in [(Init, 1), (PreOp, 2), (SafeOp, 0x14)] {
            let mut net = Net::new(how, 2);
            net.host.go(state).cycles(30);
            net.network.cut_after(0);
            net.host.cycles(100);
            assert_eq!(net.host.state().0, shown, "{how:?} {state}");
            let lost = if state == SafeOp { set(&[1, 2]) } else { set(&[]) };
            assert_eq!(net.lost(), lost, "{how:?} {state}");
            net.network.heal();
            net.host.cycles(100);
            assert_eq!(net.host.state().0, shown, "{how:?} {state}");
            net.host.go(if state == Init { PreOp } else { Op });
        }
    }
}

/// SK-4.55 SK-9.8 A change under way when the cable is cut: the reports show its failure.
#[test]
fn a_change_that_fails_is_seen() {
    let config = EngineConfig { state_timeout_ns: 500_000_000, ..EngineConfig::default() };
    for how in two_buses() {
        let mut net = Net::with_config(how, 2, config);
        net.host.master(MasterCommand::SetState(Op)).cycles(100);
        net.network.cut_after(0);
        net.until_state(0x12);
        net.network.heal();
        net.host.go(Op);
    }
}
