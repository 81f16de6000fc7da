//! Frames that are lost, late or doubled.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ecmsk::coe::SdoScope;
use ecmsk::ethercat::{AlState, Command, SlaveSet};
use ecmsk::slave::esc::Chain;
use support::blob::{BLOB, Blob, bytes};
use support::lying_wire::{Answer, Lies};

use super::rig::{CYCLE, Faults, MS, Rig, SECOND, kinds};

/// Frames that are lost, late or doubled are counted and sent again; the scan and the way to OP succeed
/// all the same.
#[test]
fn slaves_reach_op_though_frames_are_lost() {
    for seed in 0..10 {
        let kinds = kinds(6);
        let mut rig = Rig::line(&kinds);
        rig.net.faults = Faults::all(seed, 60);
        assert_eq!(rig.scan(), 6, "{seed}");
        rig.bring_to_op(&kinds);
        rig.run_for(500 * MS);
        rig.net.faults = Faults::NONE;
        rig.run_for(20 * CYCLE);
        let counters = rig.master.counters();
        assert!(counters.lost > 0 && counters.late > 0 && counters.doubled > 0, "{seed}: {counters:?}");
        assert_eq!((counters.mismatched, counters.foreign, counters.malformed), (0, 0, 0));
        assert!(rig.last.all_in_op && rig.last.working_counter == 18, "{seed}: {:?}", rig.last);
        assert!(rig.master.missing().is_empty());
    }
}

/// MASTER-1.3 With lost, late and doubled frames each value is read whole, and written exactly once.
#[test]
fn nothing_is_written_twice() {
    for seed in 0..30 {
        let writes = Arc::default();
        let blob = Blob { writes: Arc::clone(&writes), ..Blob::of(400) };
        let mut rig = Rig::of(Chain::line([blob.slave()]));
        rig.scan();
        rig.reach(AlState::PreOp);
        rig.net.faults = Faults::all(seed, 25);
        let mut lost = 0;
        for n in 0..40 {
            let value = bytes(1 + 17 * n);
            let before = writes.load(Ordering::Relaxed);
            let id = rig.master.download(1, BLOB, SdoScope::Entry, &value, SECOND);
            let ended = rig.wait(id);
            let written = writes.load(Ordering::Relaxed) - before;
            assert!(written <= 1, "{seed} {n}: written {written} times");
            if ended.is_err() {
                lost += 1;
                continue;
            }
            assert_eq!(written, 1, "{seed} {n}");
            if let Ok(read) = rig.upload(1, BLOB.index, 0) {
                assert_eq!(read, value, "{seed} {n}");
            }
        }
        assert!(lost <= 4, "{seed}: {lost} transfers have failed");
        assert!(rig.master.counters().lost > 10);
    }
}

/// Frames of another master are counted and reported, and do no harm; other foreign frames do no harm, either.
#[test]
fn another_master_is_noticed() {
    let mut rig = Rig::in_op(&["drive"]);
    rig.net.hostile = Some(Box::new(|frame| frame[6..12].copy_from_slice(&[0x02, 1, 2, 3, 4, 5])));
    rig.run_for(2 * CYCLE);
    rig.net.hostile = Some(Box::new(|frame| frame[6] = 0x10));
    rig.run_for(2 * CYCLE);
    rig.net.hostile = Some(Box::new(|frame| frame[12] = 0x08));
    rig.run_for(2 * CYCLE);
    rig.net.hostile = Some(Box::new(|frame| frame[16] ^= 0x01));
    rig.run_for(2 * CYCLE);
    rig.net.hostile = None;
    rig.run_for(20 * CYCLE);
    let counters = rig.master.counters();
    assert!(counters.foreign >= 2 && counters.unpassed >= 2 && counters.malformed >= 2 && counters.mismatched >= 2);
    assert_eq!(rig.master.other_master(), Some([0x02, 1, 2, 3, 4, 5]));
    assert!(rig.last.all_in_op);
}

/// A cycle whose frames are lost is reported without naming a slave; the inputs do not change.
#[test]
fn a_lost_cycle_is_no_lost_slave() {
    let mut rig = Rig::in_op(&["drive", "io"]);
    let inputs = [1, 2].map(|slave| rig.master.inputs(slave).expect("inputs").to_vec());
    rig.net.faults = Faults { lost_back: 1, ..Faults::NONE };
    rig.run_for(2 * CYCLE);
    assert_eq!((rig.last.lost, rig.last.working_counter, rig.last.present), (1, 0, None));
    assert_eq!(rig.last.short.len(), 2);
    assert_eq!([1, 2].map(|slave| rig.master.inputs(slave).expect("inputs").to_vec()), inputs);
    rig.net.faults = Faults::NONE;
    rig.run_for(20 * CYCLE);
    assert!(rig.last.all_in_op && rig.last.short.is_empty() && rig.master.missing().is_empty());
    assert_eq!(rig.master.take_event(), None);
}

/// Answers with a working counter above the sum of all slaves are discarded: of a register of one slave, of the states
/// of all, of the reference clock, and of process data. No slave is lost for them, and no input, state or time is taken
/// from them.
#[test]
fn what_comes_with_a_counter_that_is_too_high_is_not_believed() {
    let mut rig = Rig::in_op(&["drive", "io"]);
    let inputs = [1, 2].map(|slave| rig.master.inputs(slave).expect("inputs").to_vec());
    let statuses = [1, 2].map(|slave| rig.master.status(slave).expect("a status"));
    let lies = Lies::default();
    lies.tell(|answer: &mut Answer<'_>| {
        answer.data.fill(0x7D);
        answer.count = 41;
    });
    rig.net.hostile = Some(Box::new(move |frame| {
        let sent = frame.clone();
        lies.change(&sent, frame);
    }));
    rig.run_for(50 * CYCLE);
    assert!(rig.last.fresh.is_empty() && rig.last.doubtful.len() == 2, "{:?}", rig.last);
    assert_eq!((rig.last.reference_time, rig.last.all_in_op, rig.last.states), (None, false, 0));
    assert_eq!([1, 2].map(|slave| rig.master.inputs(slave).expect("inputs").to_vec()), inputs);
    assert_eq!([1, 2].map(|slave| rig.master.status(slave).expect("a status")), statuses);
    assert!(rig.master.missing().is_empty() && rig.master.mute().is_empty());
    assert_eq!(rig.master.take_event(), None);
    rig.net.hostile = None;
    rig.run_for(20 * CYCLE);
    assert!(rig.last.all_in_op && rig.last.doubtful.is_empty() && rig.last.fresh.len() == 2, "{:?}", rig.last);
}

/// The same below OP, where the master brings the time of the reference clock to the others without cycles: a time with
/// an impossible counter is not sent on.
#[test]
fn a_time_with_a_counter_that_is_too_high_is_not_sent_on() {
    let mut rig = Rig::scanned(&["drive", "drive"]);
    rig.reach(AlState::PreOp);
    let (lies, lied) = (Lies::default(), Arc::<AtomicU32>::default());
    let count = Arc::clone(&lied);
    lies.tell(move |answer: &mut Answer<'_>| {
        if answer.command == Command::Frmw && answer.data.len() == 8 {
            answer.data.fill(0x7D);
            answer.count = 40;
            count.fetch_add(1, Ordering::Relaxed);
        }
    });
    rig.net.hostile = Some(Box::new(move |frame| {
        let sent = frame.clone();
        lies.change(&sent, frame);
    }));
    let sent = Rc::new(RefCell::new(Vec::new()));
    let heard = Rc::clone(&sent);
    rig.net.heard = Some(Box::new(move |frame| heard.borrow_mut().extend_from_slice(frame)));
    rig.run_for(200 * CYCLE);
    assert!(lied.load(Ordering::Relaxed) > 5, "{lied:?}");
    assert!(!sent.borrow().windows(8).any(|bytes| bytes == [0x7D; 8]));
}

/// A working counter that is too low, while the states show no missing slave, makes the master read the inputs of each
/// slave alone. A slave that does not answer counts as one without inputs, and the inputs of others in its datagram are
/// used again. When its own come again they are used at once.
#[test]
fn a_slave_whose_inputs_do_not_come_is_found() {
    for lrw in [true, false] {
        let mut rig = Rig::in_op(&["drive", "drive", "io"]);
        rig.master.set_lrw(lrw);
        rig.run_for(5 * CYCLE);
        let all = SlaveSet::first(3);
        assert_eq!((rig.last.fresh, rig.last.doubtful), (all, SlaveSet::EMPTY));
        let lies = Lies::default();
        // The inputs of the second drive: 6 bytes of outputs and 10 of inputs for each.
        lies.tell(|answer: &mut Answer<'_>| answer.silence(16 + 6, 10));
        rig.net.hostile = Some(Box::new(move |frame| {
            let sent = frame.clone();
            lies.change(&sent, frame);
        }));
        rig.run_for(CYCLE);
        assert_eq!((rig.last.fresh, rig.last.doubtful), (SlaveSet::EMPTY, all), "{lrw}");
        rig.run_for(6 * CYCLE);
        let others: SlaveSet = [1, 3].into_iter().collect();
        assert_eq!((rig.last.fresh, rig.last.doubtful), (others, SlaveSet::EMPTY), "{lrw}");
        assert_eq!((rig.master.mute().iter().collect::<Vec<_>>(), rig.master.missing()), (vec![2], SlaveSet::EMPTY));
        rig.net.hostile = None;
        rig.run_for(CYCLE);
        assert_eq!((rig.last.fresh, rig.last.doubtful), (all, SlaveSet::EMPTY), "{lrw}");
        rig.run_for(10 * CYCLE);
        assert!(rig.master.mute().is_empty() && rig.last.all_in_op);
        assert_eq!(rig.master.take_event(), None, "nobody was lost");
    }
}
