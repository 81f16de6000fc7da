//! Frames that are lost, late or doubled.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ecmsk::coe::SdoScope;
use ecmsk::ethercat::AlState;
use ecmsk::master::JobDone;
use ecmsk::slave::esc::Chain;
use support::blob::{BLOB, Blob, bytes};

use super::rig::{CYCLE, Faults, MS, Rig, SECOND, kinds};

/// MASTER-1.1 MASTER-1.2 Frames that are lost, late or doubled are counted and sent again; the scan and the way to OP succeed
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

/// MASTER-1.3 Whatever is lost, late or doubled, each value is read whole, and written once and no second time.
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
            let JobDone::Download(ended) = ended else { panic!("{ended:?}") };
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

/// MASTER-4.4 A cycle whose frames are lost says so, and names no slave; the inputs stay as they were.
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
