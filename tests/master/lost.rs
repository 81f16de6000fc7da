//! Slaves that are lost and come back, while others go on.

use ecmsk::ethercat::registers::AlStatusRegister;
use ecmsk::ethercat::{AlState, AlStatus, SlaveSet};
use ecmsk::master::Event;
use ecmsk::sk::DriveSync;
use ecmsk::slave::esc::Chain;

use super::rig::{CYCLE, MS, Rig, SECOND, kinds, slave};

/// The reported events except emergencies, by slave.
fn events(rig: &mut Rig) -> Vec<Event> {
    let mut events: Vec<Event> = std::iter::from_fn(|| rig.master.take_event()).collect();
    events.retain(|event| !matches!(event, Event::Emergency { .. }));
    events.sort_by_key(|event| match event {
        Event::Emergency { slave, .. }
        | Event::Lost { slave }
        | Event::Returned { slave }
        | Event::PowerCycled { slave }
        | Event::Status { slave, .. } => *slave,
    });
    events
}

fn set(slaves: &[u8]) -> SlaveSet {
    slaves.iter().copied().collect()
}

/// MASTER-7.1 A cable that is cut loses the slaves behind it: they are named within three cycles, the others stay in OP and
/// keep exchanging. When it is whole again, slaves that lacked outputs for too long are brought back by a request.
#[test]
fn a_cut_cable_is_repaired() {
    let kinds = kinds(5);
    let mut rig = Rig::in_op(&kinds);
    rig.net.chain.connect(3, false);
    rig.run_for(3 * CYCLE);
    assert_eq!(rig.master.missing(), set(&[4, 5]));
    assert_eq!((rig.last.working_counter, rig.last.expected_working_counter, rig.last.present), (9, 15, Some(3)));
    assert_eq!(events(&mut rig), [Event::Lost { slave: 4 }, Event::Lost { slave: 5 }]);
    rig.run_for(500 * MS);
    assert_eq!(events(&mut rig), []);
    for n in 0..3 {
        assert_eq!(rig.net.chain.slave(n).state(), AlState::Op);
    }
    rig.net.chain.connect(3, true);
    rig.run_for(20 * MS);
    let status = AlStatusRegister(0x14);
    let expected =
        [4, 5].map(|slave| [Event::Returned { slave }, Event::Status { slave, status, code: AlStatus::WATCHDOG }]);
    assert_eq!(events(&mut rig), expected.as_flattened());
    assert!(rig.master.missing().is_empty());
    assert_eq!(rig.request(set(&[4, 5]), AlState::Op), Ok(()));
    rig.run_for(3 * CYCLE);
    assert!(rig.last.all_in_op && rig.last.working_counter == 15);
}

/// A slave that was without power for however long gets its address back and is configured again while the others
/// stay in OP.
#[test]
fn a_slave_that_lost_power_is_configured_again() {
    for off_ns in [0, 3 * MS, 300 * MS, 5 * SECOND] {
        let kinds = ["drive", "io", "hsp", "drive"];
        let mut rig = Rig::in_op(&kinds);
        let now = rig.net.now;
        rig.net.chain.power(3, false, now);
        rig.run_for(off_ns);
        let now = rig.net.now;
        rig.net.chain.power(3, true, now);
        rig.run_for(100 * MS);
        assert_eq!(
            events(&mut rig),
            [Event::Lost { slave: 4 }, Event::Returned { slave: 4 }, Event::PowerCycled { slave: 4 }],
            "{off_ns}"
        );
        assert!(rig.master.missing().is_empty());
        assert_eq!(rig.request(set(&[4]), AlState::PreOp), Ok(()));
        rig.map(4, "drive", DriveSync::FreeRun);
        assert_eq!(rig.request(set(&[4]), AlState::Op), Ok(()));
        rig.run_for(3 * CYCLE);
        assert!(rig.last.all_in_op && rig.last.working_counter == 12, "{:?}", rig.last);
        assert_eq!((0..3).map(|n| rig.net.chain.slave(n).state()).collect::<Vec<_>>(), [AlState::Op; 3]);
        assert_eq!(events(&mut rig), []);
    }
}

/// A slave in the middle takes those behind it along; each is known by its identity and gets its own address.
#[test]
fn all_slaves_behind_one_without_power_come_back() {
    let kinds = ["io", "drive", "hsp", "io", "step"];
    let mut rig = Rig::scanned(&kinds);
    rig.bring_to_op_with(&kinds, DriveSync::DcSync);
    let now = rig.net.now;
    for n in 1..5 {
        rig.net.chain.power(n, false, now);
    }
    rig.run_for(200 * MS);
    assert_eq!(rig.master.missing(), set(&[2, 3, 4, 5]));
    let now = rig.net.now;
    for n in 1..5 {
        rig.net.chain.power(n, true, now);
    }
    rig.run_for(500 * MS);
    assert!(rig.master.missing().is_empty(), "{:?}", events(&mut rig));
    assert_eq!(events(&mut rig).len(), 12);
    let back = set(&[2, 3, 4, 5]);
    assert_eq!(rig.request(back, AlState::PreOp), Ok(()));
    for slave in back.iter() {
        rig.map(slave, kinds[usize::from(slave) - 1], DriveSync::DcSync);
    }
    assert_eq!(rig.request(back, AlState::Op), Ok(()));
    rig.run_for(100 * MS);
    assert!(rig.last.all_in_op && rig.last.working_counter == 15);
    // Their clocks are set again.
    let now = rig.net.now;
    rig.net.chain.advance(now);
    let times: Vec<u64> = [1, 2, 4].map(|n| rig.net.chain.slave(n).controller().system_time_ns()).into();
    assert!(times.iter().all(|time| time.abs_diff(times[0]) < 1_000), "{times:?}");
}

/// MASTER-7.3 A slave that lets frames pass untouched is found among those that share its datagram.
#[test]
fn a_silent_slave_is_found() {
    let mut rig = Rig::in_op(&["drive", "drive", "drive"]);
    rig.net.chain.silence(1, true);
    rig.run_for(4 * CYCLE);
    assert_eq!((rig.master.missing(), rig.last.present), (set(&[2]), Some(2)));
    assert_eq!(rig.last.short, set(&[1, 2, 3]));
    rig.net.chain.silence(1, false);
    rig.run_for(10 * CYCLE);
    assert!(rig.master.missing().is_empty() && rig.last.all_in_op);
}

/// Without the cable to the first slave everything ends, and goes on when it is back.
#[test]
fn the_first_cable_is_cut() {
    let kinds = ["drive", "io"];
    let mut rig = Rig::in_op(&kinds);
    rig.net.chain.connect(0, false);
    assert!(rig.request(rig.all(), AlState::PreOp).is_err());
    rig.run_for(SECOND);
    assert_eq!((rig.last.lost, rig.last.present), (1, None));
    rig.net.chain.connect(0, true);
    rig.run_for(50 * MS);
    rig.reach(AlState::Op);
    rig.run_for(3 * CYCLE);
    assert!(rig.last.all_in_op && rig.master.missing().is_empty());
}

/// However many frames were lost while the cable was cut, each cycle is sent and answered from then on.
#[test]
fn cycles_go_on_at_once_when_the_cable_is_back() {
    let mut rig = Rig::in_op(&["drive"]);
    rig.next_cycle = None;
    let cycle = |rig: &mut Rig| {
        rig.net.now += 50_000;
        let now = rig.net.now;
        rig.master.cycle(now, &mut rig.net);
        rig.net.now += 50_000;
        let now = rig.net.now;
        rig.master.poll(now, &mut rig.net);
        rig.master.take_cycle()
    };
    rig.net.chain.connect(0, false);
    for _ in 0..2_000 {
        cycle(&mut rig);
    }
    assert!(rig.master.counters().lost > 1_900);
    rig.net.chain.connect(0, true);
    for n in 0..500 {
        let done = cycle(&mut rig).expect("it is answered");
        assert_eq!((done.lost, done.present), (0, Some(1)), "{n}");
    }
}

/// MASTER-7.5 The reference clock is the first one that answers; the time goes on when the first slave comes back without
/// having had power.
#[test]
fn the_reference_clock_is_lost() {
    let chain = Chain::line((0..3).map(|_| slave("drive", Default::default())));
    let mut rig = Rig::of(chain);
    rig.scan();
    rig.bring_to_op(&["drive"; 3]);
    rig.net.chain.silence(0, true);
    rig.run_for(10 * CYCLE);
    assert_eq!(rig.master.reference_clock(), Some(2));
    let time = rig.last.reference_time.expect("a time");
    let now = rig.net.now;
    rig.net.chain.slave_mut(0).power_on(now);
    rig.net.chain.silence(0, false);
    rig.run_for(200 * MS);
    assert_eq!(rig.request(set(&[1]), AlState::PreOp), Ok(()));
    rig.map(1, "drive", DriveSync::FreeRun);
    assert_eq!(rig.request(set(&[1]), AlState::Op), Ok(()));
    assert_eq!(rig.master.reference_clock(), Some(1));
    let begin = rig.net.now;
    rig.run_for(10 * CYCLE);
    let passed = rig.last.reference_time.expect("a time") - time;
    assert!(rig.last.all_in_op);
    assert!(passed.abs_diff(begin + 10 * CYCLE - now) < 2 * CYCLE, "{passed}");
}
