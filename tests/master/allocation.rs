//! A running program causes no allocation, once slaves were found.

use allocation_counter::measure;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, SlaveSet};
use ecmsk::master::{Event, Job, MailboxError, SdoError, StateReason};
use ecmsk::sk::DriveSync;
use ecmsk::slave::{DeviceFault, Fault};

use super::rig::{CYCLE, Faults, MS, Rig, SECOND, kinds};

#[track_caller]
fn allocates_nothing(what: &str, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{what}: {counted:?}");
}

fn set(slaves: &[u8]) -> SlaveSet {
    slaves.iter().copied().collect()
}

fn read(rig: &mut Rig, slave: u8, index: u16) -> Job<Result<u32, SdoError>> {
    rig.master.upload_number(slave, ObjectAddress::new(index, 0), SdoScope::Entry, SECOND)
}

fn write(rig: &mut Rig, slave: u8, index: u16, value: &[u8]) -> Job<Result<(), SdoError>> {
    rig.master.download(slave, ObjectAddress::new(index, 0), SdoScope::Entry, value, SECOND)
}

/// A change of state of any slaves allocates nothing, up or down, all at once or two beside each other, with clocks and without,
/// if frames are lost, if a slave refuses, and if it is given up.
#[test]
fn changes_of_state_allocate_nothing() {
    for sync in [DriveSync::FreeRun, DriveSync::DcSync] {
        let kinds = kinds(40);
        let mut rig = Rig::scanned(&kinds);
        let all = rig.all();
        allocates_nothing("Init to PreOP", || rig.reach(AlState::PreOp));
        // This is longer than the mapping.
        rig.master.configure(1, 40, 2).expect("it has sync managers");
        allocates_nothing("a refusal", || {
            let error = rig.request(set(&[1]), AlState::SafeOp).expect_err("it refuses");
            assert!(matches!(error.reason, StateReason::Refused { .. }), "{error}");
        });
        (1..).zip(&kinds).for_each(|(slave, kind)| rig.map(slave, kind, sync));
        allocates_nothing("PreOP to SafeOP", || rig.reach(AlState::SafeOp));
        rig.next_cycle = Some(rig.net.now);
        allocates_nothing("SafeOP to OP", || rig.reach(AlState::Op));
        rig.run_for(3 * CYCLE);
        allocates_nothing("some go down and up", || {
            let some = set(&[1, 2, 17, 39, 40]);
            for state in [AlState::SafeOp, AlState::Op, AlState::PreOp, AlState::Op] {
                assert_eq!(rig.request(some, state), Ok(()));
            }
        });
        allocates_nothing("a change that is given up", || {
            for state in [AlState::PreOp, AlState::Op, AlState::SafeOp] {
                let id = rig.master.request_state(all, state, 10 * SECOND);
                rig.run_for(CYCLE);
                rig.master.cancel(id);
                rig.run_for(20 * CYCLE);
            }
            rig.reach(AlState::Op);
        });
        allocates_nothing("frames that are lost", || {
            rig.net.faults = Faults { lost_out: 10, lost_back: 10, ..Faults::all(1, 0) };
            for state in [AlState::PreOp, AlState::Op, AlState::SafeOp] {
                // A slave that has not answered three times is named.
                let _ = rig.request(all, state);
            }
            rig.net.faults = Faults::NONE;
            rig.reach(AlState::Op);
        });
        rig.run_for(20 * CYCLE);
        assert!(rig.last.all_in_op && rig.last.lost == 0, "{sync:?}: {:?}", rig.last);
    }
}

/// A transfer of up to 4 bytes allocates nothing, and neither does an upload of any length for a buffer of that size;
/// also if it is aborted, times out, loses frames or is given up, and if several run beside each other and beside
/// cycles.
#[test]
fn transfers_allocate_nothing() {
    let kinds = ["drive"; 8];
    let mut rig = Rig::in_op(&kinds);
    let name = rig.upload(1, 0x1008, 0).expect("it has a name");
    assert!(name.len() > 4);
    let first = u32::from_le_bytes(*name.first_chunk().expect("4 bytes"));
    let abort = |code| Err(SdoError::Abort(code));
    allocates_nothing("one after the other", || {
        let id = write(&mut rig, 1, 0x6065, &[1, 2, 3, 4]);
        assert_eq!(rig.wait(id), Ok(()));
        let id = read(&mut rig, 1, 0x6065);
        assert_eq!(rig.wait(id), Ok(0x0403_0201));
        let id = read(&mut rig, 1, 0x1008);
        assert_eq!(rig.wait(id), Ok(first));
        let id = read(&mut rig, 1, 0x5555);
        assert_eq!(rig.wait(id), abort(AbortCode::NO_OBJECT).map(|()| 0));
        let id = write(&mut rig, 1, 0x6041, &[0; 2]);
        assert_eq!(rig.wait(id), abort(AbortCode::READ_ONLY));
        let id = read(&mut rig, 9, 0x6065);
        assert_eq!(rig.wait(id), Err(MailboxError::NoMailbox.into()));
    });
    allocates_nothing("a slave that is silent", || {
        rig.net.chain.slave_mut(2).delay_sdo(3 * SECOND);
        let id = read(&mut rig, 3, 0x6065);
        assert_eq!(rig.wait(id), Err(MailboxError::TimeUp.into()));
        rig.net.chain.slave_mut(2).delay_sdo(0);
        rig.run_for(4 * SECOND);
    });
    allocates_nothing("eight at once, and again", || {
        for turn in 0..20 {
            let mut reads = [1, 2, 3, 4, 5, 6, 7, 8].map(|slave| Some(read(&mut rig, slave, 0x6065)));
            while reads.iter().any(Option::is_some) {
                rig.step();
                for job in &mut reads {
                    if let Some(value) = job.and_then(|job| rig.master.take(job)) {
                        assert!(value.is_ok(), "{turn}: {value:?}");
                        *job = None;
                    }
                }
            }
        }
    });
    allocates_nothing("some that are given up", || {
        for turn in 0..50 {
            let id = read(&mut rig, 1 + turn % 8, 0x6065);
            rig.run_for(u64::from(turn) * 50_000);
            rig.master.cancel(id);
            rig.run_for(10 * MS);
        }
    });
    allocates_nothing("frames that are lost", || {
        rig.net.faults = Faults { lost_out: 10, lost_back: 10, ..Faults::all(7, 0) };
        for _ in 0..50 {
            let id = write(&mut rig, 4, 0x6065, &[1, 0, 0, 0]);
            // It has ended in one way or another.
            let _ = rig.wait(id);
        }
        rig.net.faults = Faults::NONE;
    });
}

/// Neither do the watch over slaves and their mailboxes, an emergency, a cable that is cut, a slave that was without power, and the way
/// of all back to OP.
#[test]
fn what_happens_unasked_allocates_nothing() {
    let kinds = ["drive", "io", "hsp", "drive", "dp3cl", "step"];
    let mut rig = Rig::scanned(&kinds);
    rig.bring_to_op_with(&kinds, DriveSync::DcSync);
    let mut told = Vec::with_capacity(100);
    allocates_nothing("an emergency", || {
        let fault = DeviceFault { code: 0x2310, resettable: true };
        assert!(rig.net.chain.slave_mut(0).device_mut().apply_fault(Fault::Alarm { axis: 0, fault }));
        rig.run_for(50 * MS);
        told.extend(std::iter::from_fn(|| rig.master.take_event()));
    });
    assert!(matches!(told[..], [Event::Emergency { slave: 1, .. }]), "{told:?}");
    told.clear();
    allocates_nothing("a cable that is cut", || {
        rig.net.chain.connect(2, false);
        rig.run_for(500 * MS);
        rig.net.chain.connect(2, true);
        rig.run_for(50 * MS);
        assert_eq!(rig.request(set(&[3, 4, 5, 6]), AlState::Op), Ok(()));
        told.extend(std::iter::from_fn(|| rig.master.take_event()));
    });
    assert_eq!(told.iter().filter(|event| matches!(event, Event::Returned { .. })).count(), 4, "{told:?}");
    told.clear();
    allocates_nothing("a slave without power", || {
        let now = rig.net.now;
        rig.net.chain.power(3, false, now);
        rig.run_for(300 * MS);
        let now = rig.net.now;
        rig.net.chain.power(3, true, now);
        rig.run_for(200 * MS);
        told.extend(std::iter::from_fn(|| rig.master.take_event()));
        assert_eq!(rig.request(set(&[4]), AlState::PreOp), Ok(()));
        rig.map(4, "drive", DriveSync::DcSync);
        assert_eq!(rig.request(set(&[4, 5, 6]), AlState::Op), Ok(()));
        rig.run_for(10 * CYCLE);
    });
    assert!(told.iter().any(|event| matches!(event, Event::PowerCycled { slave: 4 })), "{told:?}");
    assert!(rig.last.all_in_op, "{:?}", rig.last);
}
