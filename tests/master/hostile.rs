//! Slaves with random answers: nothing panics, and every job ends.

use ecmsk::coe::{ObjectAddress, ObjectListType, SdoScope};
use ecmsk::ethercat::{AlState, FRAME_HEADER_LEN, SlaveSet, each_datagram};
use ecmsk::master::{Pace, SyncSignals};
use support::dice::Dice;

use super::rig::{CYCLE, Faults, Hostile, MS, Rig, SECOND, kinds};

/// Changes data and working counters, one byte in that many; the master accepts such frames as answers.
fn liar(seed: u64, one_in: u64) -> Hostile {
    let mut dice = Dice(seed);
    Box::new(move |frame| {
        let changed = each_datagram(frame, |mut datagram| {
            if dice.one_in(one_in) {
                datagram.count(dice.below(5) as u16);
            }
            for byte in datagram.data.iter_mut() {
                if dice.one_in(one_in) {
                    *byte = dice.pick(&[0, 1, 8, 0x14, 0x7F, 0x80, 0xFF, *byte ^ 1]);
                }
            }
        });
        assert!(changed.is_ok());
    })
}

/// Changes any bytes behind the headers, and the length of frames.
fn vandal(seed: u64, one_in: u64) -> Hostile {
    let mut dice = Dice(seed);
    Box::new(move |frame| {
        for byte in &mut frame[FRAME_HEADER_LEN - 2..] {
            if dice.one_in(one_in) {
                *byte = dice.roll() as u8;
            }
        }
        if dice.one_in(one_in) {
            frame.truncate(dice.below(frame.len() as u64) as usize);
        }
    })
}

/// Starts everything that a user can start, whatever the result; each job has to end.
fn use_everything(rig: &mut Rig, dice: &mut Dice) {
    let scan = rig.master.scan();
    let _ = rig.wait(scan);
    rig.master.set_pace(Some(Pace { cycle_ns: CYCLE, phase_ns: dice.below(CYCLE) }));
    for _ in 0..12 {
        let slave = dice.below(5) as u8;
        let slaves = SlaveSet::from_bits(dice.below(1 << rig.master.slaves().len().min(8)));
        let object = ObjectAddress::new(dice.pick(&[0x1000, 0x1008, 0x1018, 0x1C12, 0x6041]), dice.below(3) as u8);
        let id = match dice.below(8) {
            0..3 => {
                let target = dice.pick(&[AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op]);
                rig.master.request_state(slaves, target, SECOND).id()
            }
            3 => rig.master.upload(slave, object, SdoScope::Entry, 50 * MS).id(),
            4 => rig.master.download(slave, object, SdoScope::Complete, &[1, 2, 3, 4, 5, 6], 50 * MS).id(),
            5 => rig.master.object_list(slave, ObjectListType::All, 50 * MS).id(),
            6 => rig.master.read_file(slave, b"name", 0, 50 * MS).id(),
            _ => {
                let _ = rig.master.configure(slave, dice.below(30) as u16, dice.below(30) as u16);
                let _ = rig
                    .master
                    .set_sync(slave, dice.one_in(2).then_some(SyncSignals::sync0(dice.below(2_000_000) as u32, -5)));
                continue;
            }
        };
        rig.next_cycle = dice.one_in(2).then_some(rig.net.now);
        if dice.one_in(8) {
            rig.run_for(dice.below(10 * MS));
            rig.master.cancel(id);
        } else {
            rig.wait_for_end(id);
        }
        while rig.master.take_event().is_some() {}
    }
}

/// Slaves with random answers, with right and with wrong headers, cause no panic, and every job ends.
#[test]
fn nothing_panics_and_everything_ends() {
    for seed in 0..60 {
        let mut dice = Dice(seed);
        let mut rig = Rig::line(&kinds(1 + seed as usize % 4));
        let one_in = dice.pick(&[3, 20, 200, 2_000]);
        rig.net.hostile = Some(if seed % 3 == 0 { vandal(seed, one_in) } else { liar(seed, one_in) });
        if seed % 5 == 0 {
            rig.net.faults = Faults::all(seed, 10);
        }
        use_everything(&mut rig, &mut dice);
        // With honest answers again they are brought to OP as usual.
        (rig.net.hostile, rig.net.faults) = (None, Faults::NONE);
        rig.next_cycle = None;
        rig.run_for(20 * MS);
        assert_eq!(rig.master.ended().next(), None);
        let now = rig.net.now;
        (0..rig.net.chain.len()).for_each(|n| rig.net.chain.slave_mut(n).power_on(now));
        rig.scan();
        rig.bring_to_op(&kinds(1 + seed as usize % 4));
        assert!(rig.last.all_in_op, "{seed}");
    }
}
