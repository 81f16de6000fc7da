//! The simulated bus: process data, lost slaves, cut cables, faults.

use ecmsk::cia402::{Controlword, DriveState, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{
    AlState, BusConfig, BusError, Cleared, Configured, Fieldbus, Job, JobDone, Ns, Pacing, Role, SlaveSet,
};
use ecmsk::slave::{AlStatus, DeviceFault, Drive, DriveConfig, Fault, Slave};
use support::fieldbus_rig::{Bench, MS, SECOND, configure, sdo, set, state};

use AlState::*;

/// The working counter: 3 for a slave in OP, 1 in SafeOP, 0 below.
#[test]
fn working_counter() {
    for (state, each) in [(Init, 0), (PreOp, 0), (SafeOp, 1), (Op, 3)] {
        let mut bench = Bench::in_state(3, state);
        let done = bench.poll().unwrap();
        assert_eq!((done.working_counter, done.expected_working_counter), (3 * each, 3 * each), "{state:?}");
        assert_eq!(done.next_deadline, None);
    }
}

/// Inputs are valid in SafeOP and OP, outputs are taken only in OP.
#[test]
fn process_data_by_state() {
    let mut bench = Bench::in_state(1, PreOp);
    bench.poll();
    assert_eq!(bench.position(1), 0, "no inputs in PreOP");
    let mut bench = Bench::in_state(1, SafeOp);
    bench.command(Controlword::SHUTDOWN);
    bench.cycles(100);
    assert_eq!((bench.position(1), bench.drive_state(1)), (1000, DriveState::SwitchOnDisabled));
    bench.reach(Op, 1);
    bench.cycles(2);
    assert_eq!(bench.drive_state(1), DriveState::ReadyToSwitchOn);
}

/// One set of outputs is taken at a time; without a new one the last is repeated.
#[test]
fn outputs_are_taken_one_at_a_time() {
    let mut bench = Bench::enabled(1);
    assert_eq!((bench.bus.pacing(), bench.bus.room()), (Pacing::Runner, 1));
    let sent = bench.cycle().outputs;
    *bench.target(1) += 10;
    bench.bus.push(&bench.outputs).unwrap();
    assert_eq!((bench.bus.room(), bench.bus.push(&bench.outputs)), (0, Err(BusError::Full)));
    bench.bus.clear_ahead(0);
    assert_eq!((bench.bus.room(), bench.bus.poll_clear(0)), (1, Some(Cleared { newest_sent: sent })));
    bench.cycle();
    for _ in 0..200 {
        assert_eq!(bench.poll().map(|done| done.outputs), Some(None));
    }
    assert_eq!((bench.position(1), bench.drive_state(1)), (1010, DriveState::OperationEnabled));
}

/// A cycle is a poll at a later time; its inputs were measured at the end of the previous one.
#[test]
fn a_cycle_is_a_poll_at_a_later_time() {
    let mut bench = Bench::enabled(1);
    let now = bench.now;
    assert_eq!(bench.bus.poll(now, &mut bench.inputs), None);
    assert_eq!(bench.bus.poll(now - 1, &mut bench.inputs), None);
    *bench.target(1) += 5000;
    let shaft = |bench: &Bench| bench.handle.shaft(1, 0).unwrap();
    let before = shaft(&bench);
    bench.cycle();
    assert_eq!(i64::from(bench.position(1)), before);
    let moved = shaft(&bench);
    assert!(moved > before);
    assert_eq!(bench.handle.shafts().at, bench.now);
    bench.cycle();
    assert_eq!(i64::from(bench.position(1)), moved);
}

/// Forty drives each follow their own target.
#[test]
fn forty_drives_move() {
    let mut bench = Bench::enabled(40);
    for _ in 0..500 {
        for slave in 1..=40 {
            *bench.target(slave) += i32::from(slave) * 5 - 100;
        }
        let done = bench.cycle();
        assert_eq!((done.working_counter, done.expected_working_counter), (120, 120));
    }
    bench.cycles(300);
    for slave in 1..=40 {
        let expected = i32::from(slave) * 1000 + 500 * (i32::from(slave) * 5 - 100);
        assert_eq!(bench.position(slave), expected, "slave {slave}");
        assert_eq!(bench.handle.shaft(slave, 0), Some(expected.into()));
    }
    assert_eq!(bench.handle.shaft(1, 1), None);
    assert_eq!((bench.handle.shaft(0, 0), bench.handle.shaft(41, 0), bench.handle.shaft(1, 2)), (None, None, None));
}

/// A cable cut after a slave: the slaves behind it are lost and keep their values, the others go on. After repair the
/// lost ones stay lost until a change of state brings them back.
#[test]
fn a_cut_cable() {
    let mut bench = Bench::enabled(4);
    bench.handle.cut_after(2);
    *bench.target(1) += 500;
    *bench.target(3) += 500;
    let done = bench.cycle();
    assert_eq!((done.working_counter, done.expected_working_counter), (6, 12));
    assert_eq!(bench.inputs.lost, set(&[3, 4]));
    bench.cycles(300);
    assert_eq!([1, 2, 3, 4].map(|slave| bench.position(slave)), [1500, 2000, 3000, 4000]);
    assert_eq!(bench.drive_state(3), DriveState::OperationEnabled, "its last value");

    bench.handle.heal();
    let done = bench.cycle();
    assert_eq!((done.working_counter, bench.inputs.lost), (6, set(&[3, 4])));
    bench.reach(Op, 4);
    bench.command(Controlword::DISABLE_VOLTAGE);
    let done = bench.cycle();
    assert_eq!((done.working_counter, bench.inputs.lost), (12, SlaveSet::EMPTY));
    assert_eq!(bench.drive_state(3), DriveState::SwitchOnDisabled, "its watchdog has switched it off");
    assert_eq!(bench.position(3), 3000);
}

/// A slave behind a cut that is repaired before its watchdog ends OP is lost too, and returns directly to OP.
#[test]
fn a_short_cut() {
    let mut bench = Bench::enabled(2);
    bench.handle.cut_after(1);
    bench.cycle();
    bench.handle.heal();
    bench.cycles(5);
    assert_eq!(bench.inputs.lost, set(&[2]));
    let (done, took) = bench.run(state(Op, 2));
    assert_eq!((done, took / MS), (JobDone::State(Ok(())), 22));
    assert_eq!(bench.cycle().working_counter, 6);
}

/// With a cut before the first slave the bus is silent, while time goes on in the slaves; after plugging in again, all
/// of them are lost.
#[test]
fn a_silent_bus() {
    let mut bench = Bench::enabled(2);
    for slave in [1, 2] {
        *bench.target(slave) += 100;
    }
    bench.handle.cut_after(0);
    assert_eq!((bench.bus.room(), bench.bus.push(&bench.outputs)), (0, Err(BusError::Down)));
    let before = bench.inputs.clone();
    for _ in 0..300 {
        assert_eq!(bench.poll(), None);
    }
    assert_eq!((bench.inputs.slaves, bench.inputs.lost), (before.slaves, before.lost), "inputs are left alone");
    assert_eq!(bench.handle.shafts().at, bench.now, "time goes on");
    bench.handle.heal();
    assert_eq!(bench.bus.room(), 1);
    let done = bench.cycle();
    assert_eq!((done.working_counter, done.expected_working_counter), (0, 6));
    assert_eq!(bench.inputs.lost, set(&[1, 2]));
    bench.reach(Op, 2);
    assert_eq!(bench.cycle().working_counter, 6);
    assert_eq!(bench.drive_state(1), DriveState::SwitchOnDisabled);
}

/// A silent slave is lost, while its time goes on: it coasts or brakes, and its watchdog ends OP.
#[test]
fn a_silent_slave() {
    let mut bench = Bench::enabled(3);
    for _ in 0..200 {
        for slave in 1..=3 {
            *bench.target(slave) += 600;
        }
        bench.cycle();
    }
    let seen = bench.position(2);
    bench.handle.silence(2, true);
    let done = bench.cycle();
    assert_eq!((done.working_counter, bench.inputs.lost), (6, set(&[2])));
    bench.cycles(400);
    assert_eq!(bench.position(2), seen, "its last value");
    let stopped = bench.handle.shaft(2, 0).unwrap();
    assert!(stopped > i64::from(seen), "it went on to its target");
    bench.cycles(50);
    assert_eq!(bench.handle.shaft(2, 0), Some(stopped));
    bench.handle.silence(2, false);
    bench.reach(Op, 3);
    bench.cycle();
    assert_eq!((bench.inputs.lost, i64::from(bench.position(2))), (SlaveSet::EMPTY, stopped));
}

/// A slave that falls to a lower AL state by itself is lost, and its inputs keep their values.
#[test]
fn a_slave_that_falls_is_lost() {
    /// A drive that falls to SafeOP some time after it has entered OP.
    struct Falling(Drive, Ns);

    impl Slave for Falling {
        fn name(&self) -> &str {
            "falling"
        }
        fn state(&self) -> AlState {
            self.0.state()
        }
        fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
            self.0.enter(target)
        }
        fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
            self.0.read(object, scope, value)
        }
        fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
            self.0.write(object, scope, value)
        }
        fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
            self.0.set_sync_managers(outputs, inputs);
        }
        fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
            self.0.exchange(outputs, inputs);
        }
        fn step(&mut self, dt_ns: Ns) {
            self.0.step(dt_ns);
            if self.0.state() == Op {
                self.1 = self.1.saturating_sub(dt_ns);
                if self.1 == 0 {
                    self.0.enter(SafeOp).expect("down is open");
                }
            }
        }
    }

    let drive = || Drive::new(DriveConfig { position: 77, ..DriveConfig::default() });
    let slaves: Vec<Box<dyn Slave>> = vec![Box::new(Falling(drive(), 10 * MS)), Box::new(drive())];
    let mut bench = Bench { bus: SimBus::new(slaves), ..Bench::new(0) };
    bench.done(Job::Scan);
    bench.reach(PreOp, 2);
    bench.done(configure(Role::Drive(Mode::Csp)));
    bench.reach(Op, 2);
    bench.cycles(10);
    assert_eq!(bench.inputs.lost, SlaveSet::EMPTY);
    bench.inputs.slaves[0][0].position = -1;
    let done = bench.cycle();
    assert_eq!((done.working_counter, done.expected_working_counter, bench.inputs.lost), (3, 6, set(&[1])));
    assert_eq!([1, 2].map(|slave| bench.position(slave)), [-1, 77]);
}

/// A slave below SafeOP is lost only while it does not answer.
#[test]
fn a_slave_in_preop_is_lost_while_it_does_not_answer() {
    let mut bench = Bench::in_state(3, PreOp);
    bench.handle.cut_after(1);
    bench.poll();
    assert_eq!(bench.inputs.lost, set(&[2, 3]));
    bench.handle.heal();
    bench.poll();
    assert_eq!(bench.inputs.lost, SlaveSet::EMPTY);
}

/// Back in OP a drive does not act on outputs sent before it left.
#[test]
fn old_outputs_do_not_come_back() {
    let mut bench = Bench::enabled(1);
    bench.reach(PreOp, 1);
    bench.reach(Op, 1);
    for _ in 0..500 {
        bench.poll();
    }
    assert_eq!(bench.drive_state(1), DriveState::SwitchOnDisabled);
    assert_eq!(bench.transferred(sdo(1, 0x6040, None)), Ok(0));
}

/// A fault raised from outside shows in the process data of that slave.
#[test]
fn faults_from_outside() {
    let mut bench = Bench::enabled(3);
    let fault = DeviceFault { code: 0x4210, resettable: true };
    bench.handle.apply_fault(2, Fault::Alarm { axis: 0, fault });
    for (slave, axis) in [(0, 0), (4, 0), (1, 1)] {
        bench.handle.apply_fault(slave, Fault::Alarm { axis, fault });
    }
    bench.cycles(3);
    assert_eq!([1, 2, 3].map(|slave| bench.inputs.slaves[slave - 1][0].error_code), [0, 0x4210, 0]);
    assert_eq!(bench.drive_state(2), DriveState::Fault);
    assert_eq!(bench.drive_state(1), DriveState::OperationEnabled);
    bench.command(Controlword(Controlword::FAULT_RESET));
    bench.cycles(3);
    assert_eq!(bench.drive_state(2), DriveState::SwitchOnDisabled);
}

/// After a long pause one poll catches up completely.
#[test]
fn a_long_pause() {
    let mut bench = Bench::enabled(2);
    *bench.target(2) += 100_000;
    bench.now += 5 * SECOND;
    bench.cycle();
    bench.cycle();
    assert_eq!((bench.position(2), bench.drive_state(2)), (102_000, DriveState::OperationEnabled));
}

/// A cycle allocates nothing: 40 drives in OP, all moving, with a lost slave and a fault meanwhile.
#[test]
fn a_cycle_allocates_nothing() {
    let mut bench = Bench::enabled(40);
    bench.handle.apply_fault(7, Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x4210, resettable: true } });
    let allocated = allocation_counter::measure(|| {
        for cycle in 0..100 {
            for slave in 1..=40 {
                *bench.target(slave) += i32::from(slave) * 5;
            }
            bench.handle.silence(9, cycle > 50);
            bench.cycle();
        }
    });
    assert_eq!((allocated.count_total, allocated.bytes_total), (0, 0));
    assert_eq!((bench.drive_state(7), bench.inputs.lost), (DriveState::Fault, set(&[9])));
}

/// A slave that loses its power falls to Init and is lost, the slaves behind it stay. After its power returns it stays
/// lost until it is configured and brought back, while the others go on.
#[test]
fn a_slave_without_power() {
    let mut bench = Bench::enabled(3);
    bench.handle.lose(2);
    for slave in [0, 4, 41, 255] {
        bench.handle.lose(slave);
    }
    let done = bench.cycle();
    assert_eq!((done.working_counter, bench.inputs.lost), (6, set(&[2])));
    bench.handle.find(2);
    bench.cycles(200);
    assert_eq!(bench.inputs.lost, set(&[2]));
    let back = |target| Job::State { target, slaves: set(&[2]), timeout_ns: 10 * SECOND };
    assert!(matches!(bench.done(back(Op)), JobDone::State(Err(_))), "its process data are not mapped");
    assert_eq!(bench.done(back(PreOp)), JobDone::State(Ok(())));
    let Job::Configure(config) = configure(Role::Drive(Mode::Csp)) else { unreachable!() };
    assert!(matches!(bench.done(Job::Configure(config)), JobDone::Configure(Err(_))), "the others are in OP");
    let selected = set(&[2]);
    assert_eq!(
        bench.run(Job::Configure(BusConfig { selected, ..config })),
        (JobDone::Configure(Ok(Configured::default())), 10 * MS)
    );
    bench.cycle();
    assert_eq!(bench.done(back(Op)), JobDone::State(Ok(())));
    assert_eq!((bench.cycle().working_counter, bench.inputs.lost), (9, SlaveSet::EMPTY));
}
