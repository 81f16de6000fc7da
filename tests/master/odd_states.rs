//! Changes of state of slaves whose firmware takes its time, and shows more than the requested states.

use ecmsk::ethercat::registers::RequestedState;
use ecmsk::ethercat::{AlState, AlStatus, SlaveSet};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::StateReason;
use support::odd_line::{OddSlave, drive};

use super::odd_rig::Rig;
use super::rig::{CYCLE, MS, SECOND};

/// A drive whose firmware polls AL control that often.
fn polling(polls_ns: u64) -> OddSlave {
    drive().with(|slave| slave.states.polls_ns = polls_ns)
}

/// MASTER-3.2 MASTER-3.8 A controller takes no request until the device has read the one before, which takes it some
/// milliseconds. An error is acknowledged all the same, and the next request brings the slave to OP.
#[test]
fn devices_that_read_al_control_late() {
    for polls_ns in [300_000, 700_000, MS, 3_700_000, 10 * MS, 23 * MS] {
        let mut rig = Rig::in_op([polling(polls_ns), drive()]);
        for _ in 0..5 {
            rig.run_for(3 * CYCLE + 130_000);
            rig.line.slave(1, |slave| slave.fall(4, 0x001B));
            let begin = rig.line.now();
            rig.reach(AlState::Op);
            assert!(rig.line.now() - begin < 100 * MS + 4 * polls_ns, "{polls_ns}");
        }
        // A request that was given up is still unread when the next one comes.
        let id = rig.master.request_state(SlaveSet::first(2), AlState::SafeOp, SECOND);
        rig.run_for(MS / 4);
        rig.master.cancel(id);
        rig.reach(AlState::PreOp);
    }
}

/// MASTER-3.2 MASTER-3.8 A device that never reads AL control ends a change of state at its timeout.
#[test]
fn a_device_that_never_reads_al_control() {
    let mut rig = Rig::scanned([drive()]);
    rig.line.slave(1, |slave| slave.states.polls_ns = 1_000 * SECOND);
    rig.run_for(MS);
    let begin = rig.line.now();
    let error = rig.request(AlState::PreOp).expect_err("it reads nothing");
    assert_eq!(error.reason, StateReason::TimeUp { state: RequestedState::State(AlState::Init) });
    let error = rig.request(AlState::PreOp).expect_err("it reads nothing");
    assert_eq!(error.reason, StateReason::NotTaken(0));
    assert!((20 * SECOND..21 * SECOND).contains(&(rig.line.now() - begin)));
}

/// MASTER-2.8 A request of an earlier master that the device has not read when the scan begins does not keep the slave from
/// Init.
#[test]
fn a_request_that_is_unread_at_the_scan() {
    for polls_ns in [3 * MS, 10 * MS, 40 * MS] {
        let mut rig = Rig::in_preop(polling(polls_ns));
        let id = rig.master.write_registers(1, 0x0120, &[0x02]);
        assert_eq!(rig.wait(id), Ok(()));
        rig.scan();
        assert_eq!(rig.line.slave(1, |slave| slave.state()), 1, "{polls_ns}");
        rig.bring_to_op();
    }
}

/// MASTER-3.3 On its way down from OP a device may show SafeOP for a while, or its watchdog may expire before it reads the
/// request: it reaches the lower state in either case.
#[test]
fn devices_that_show_more_states_on_their_way_down() {
    for target in [AlState::PreOp, AlState::Init] {
        for (passes_safeop_ns, expires_first, polls_ns) in
            [(5 * MS, 0, 0), (0, 1, 0), (5 * MS, 0, 3 * MS), (0, 1, 3 * MS), (0, 2, 700_000)]
        {
            let mut rig = Rig::in_op([drive().with(|slave| {
                slave.states.passes_safeop_ns = passes_safeop_ns;
                slave.states.polls_ns = polls_ns;
            })]);
            rig.line.slave(1, |slave| slave.states.expires_first = expires_first);
            rig.next_cycle = None;
            rig.reach(target);
            // The sync managers of process data are off, as after each way down.
            assert_eq!(rig.line.slave(1, |slave| [slave.memory[0x0816], slave.memory[0x081E]]), [0, 0], "{target:?}");
            assert_eq!(rig.line.slave(1, |slave| slave.state()), target as u8);
            rig.bring_to_op();
        }
    }
}

/// MASTER-3.2 A device that refuses a lower state again and again is named with its code, and soon.
#[test]
fn a_device_that_refuses_a_lower_state() {
    let mut rig = Rig::in_op([drive()]);
    rig.line.slave(1, |slave| slave.states.refuses.push((2, 0x8001)));
    let begin = rig.line.now();
    let error = rig.request(AlState::PreOp).expect_err("it refuses");
    let state = RequestedState::State(AlState::Op);
    assert_eq!(error.reason, StateReason::Refused { state, code: AlStatus(0x8001) });
    assert!(rig.line.now() - begin < 100 * MS);
}
