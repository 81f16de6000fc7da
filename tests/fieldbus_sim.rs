//! The simulated bus: jobs and their timing, process data, lost slaves, cut cables, faults.
#![cfg(feature = "sim")]

use ecmsk::cia402::{Controlword, DriveState, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::sim::{SimBus, SimHandle, Timing};
use ecmsk::fieldbus::{
    AlState, BusConfig, BusError, Busy, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns, Outputs, Pacing,
    Refusal, Role, SdoRequest, SlaveConfig, SlaveIn, SlaveOut, SlaveSet,
};
use ecmsk::sk::{CycleTime, DriveSync};
use ecmsk::slave::{AlStatus, DeviceFault, Drive, DriveConfig, SdoValue, Slave};

use AlState::*;

const MS: Ns = 1_000_000;
const SECOND: Ns = 1_000 * MS;

/// A bus with its master, which polls once a millisecond.
struct Bench {
    bus: SimBus,
    handle: SimHandle,
    now: Ns,
    outputs: Outputs,
    inputs: Inputs,
}

impl Bench {
    /// Drives whose shafts stand at 1000, 2000, ...
    fn new(drives: u8) -> Self {
        let slaves = (1..=drives).map(|n| {
            let position = i64::from(n) * 1000;
            Box::new(Drive::new(DriveConfig { position, ..DriveConfig::default() })) as Box<dyn Slave>
        });
        let bus = SimBus::new(slaves.collect());
        let handle = bus.handle();
        Self { bus, handle, now: 0, outputs: Outputs::default(), inputs: Inputs::default() }
    }

    fn in_state(drives: u8, state: AlState) -> Self {
        let mut bench = Self::new(drives);
        bench.done(Job::Scan);
        if state >= PreOp {
            bench.reach(PreOp, drives);
        }
        if state >= SafeOp {
            assert_eq!(bench.done(configure(Role::Drive(Mode::Csp))), JobDone::Configure(Ok(())));
            bench.reach(state, drives);
        }
        bench
    }

    /// All drives in OP and Operation enabled.
    fn enabled(drives: u8) -> Self {
        let mut bench = Self::in_state(drives, Op);
        for word in [Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION] {
            bench.command(word);
            for _ in 0..60 {
                bench.hold();
                bench.cycle();
            }
        }
        for slave in 1..=drives {
            assert_eq!(bench.drive_state(slave), DriveState::OperationEnabled);
        }
        bench
    }

    fn command(&mut self, word: Controlword) {
        for slave in &mut self.outputs.slaves {
            slave[0].controlword = word;
        }
    }

    /// Targets are where the shafts are.
    fn hold(&mut self) {
        for (out, input) in self.outputs.slaves.iter_mut().zip(&self.inputs.slaves) {
            out[0].target = input[0].position;
        }
    }

    /// One cycle with outputs; the bus is up.
    fn cycle(&mut self) -> CycleDone {
        self.outputs.id += 1;
        self.bus.push(&self.outputs).expect("the bus is up and empty");
        let id = self.outputs.id;
        let done = self.poll().expect("the bus is up");
        assert_eq!((done.outputs, done.at), (Some(id), self.now));
        done
    }

    fn cycles(&mut self, n: u32) {
        for _ in 0..n {
            self.cycle();
        }
    }

    fn poll(&mut self) -> Option<CycleDone> {
        self.now += MS;
        self.bus.poll(self.now, &mut self.inputs)
    }

    /// How a job ends, and after what time.
    fn run(&mut self, job: Job) -> (JobDone, Ns) {
        let start = self.now;
        self.bus.start(job, self.now).expect("no other job is under way");
        loop {
            assert!(self.now - start < 100 * SECOND, "the job does not end");
            self.poll();
            if let Some(done) = self.bus.poll_job(self.now) {
                assert_eq!(self.bus.poll_job(self.now), None, "a job ends once");
                return (done, self.now - start);
            }
        }
    }

    fn done(&mut self, job: Job) -> JobDone {
        self.run(job).0
    }

    fn reach(&mut self, target: AlState, drives: u8) {
        assert_eq!(self.done(state(target, drives)), JobDone::State(Ok(())));
    }

    fn drive_state(&self, slave: u8) -> DriveState {
        self.inputs.slaves[usize::from(slave) - 1][0].statusword.state().expect("a defined statusword")
    }

    fn position(&self, slave: u8) -> i32 {
        self.inputs.slaves[usize::from(slave) - 1][0].position
    }

    fn target(&mut self, slave: u8) -> &mut i32 {
        &mut self.outputs.slaves[usize::from(slave) - 1][0].target
    }
}

fn state(target: AlState, drives: u8) -> Job {
    Job::State { target, slaves: SlaveSet::first(drives), timeout_ns: 10 * SECOND }
}

fn configure(role: Role) -> Job {
    let slave = SlaveConfig { role, sync: DriveSync::DcSync };
    Job::Configure(BusConfig { cycle: CycleTime::DEFAULT, slaves: [slave; MAX_SLAVES] })
}

fn sdo(slave: u8, index: u16, write: Option<(SdoSize, u32)>) -> Job {
    Job::Sdo(SdoRequest { slave, object: ObjectAddress::new(index, 0), write, timeout_ns: SECOND })
}

fn set(slaves: &[u8]) -> SlaveSet {
    let mut set = SlaveSet::EMPTY;
    for slave in slaves {
        set.insert(*slave);
    }
    set
}

fn refused(slave: u8, al_status: u16) -> Result<(), Refusal> {
    Err(Refusal { slave, al_status, abort: None })
}

/// A scan counts the slaves the cable reaches, 40 at most, and leaves them in Init.
#[test]
fn scan() {
    for (drives, found) in [(0, 0), (1, 1), (3, 3), (40, 40), (41, 40)] {
        let mut bench = Bench::new(drives);
        let (done, took) = bench.run(Job::Scan);
        assert_eq!(done, JobDone::Scan { found });
        assert_eq!(took, (200 + 5 * Ns::from(found)) * MS);
    }
    let mut bench = Bench::in_state(3, Op);
    bench.handle.cut_after(2);
    bench.poll();
    assert_eq!(bench.inputs.lost, set(&[3]));
    assert_eq!(bench.done(Job::Scan), JobDone::Scan { found: 2 });
    bench.poll();
    assert_eq!(bench.inputs.lost, SlaveSet::EMPTY, "the third was not found");
    assert_eq!(bench.done(state(SafeOp, 2)), JobDone::State(refused(1, 0x001D)), "what was configured is forgotten");
    bench.handle.cut_after(0);
    assert_eq!(bench.done(Job::Scan), JobDone::Scan { found: 0 });
}

/// SK-4.53 A change of state takes many cycles, PreOP to SafeOP the longest.
#[test]
fn changes_take_their_time() {
    for drives in [1, 40] {
        let mut bench = Bench::in_state(drives, Init);
        let mut took = [PreOp, SafeOp, Op].map(|target| {
            if target == SafeOp {
                bench.done(configure(Role::Drive(Mode::Csp)));
            }
            let (done, took) = bench.run(state(target, drives));
            assert_eq!(done, JobDone::State(Ok(())));
            took / MS
        });
        let slaves = 2 * Ns::from(drives);
        assert_eq!(took, [50 + slaves, 300 + slaves, 50 + slaves]);
        took.sort_unstable();
        assert!(took[0] > 10, "many cycles");
        let (_, down) = bench.run(state(Init, drives));
        assert_eq!(down / MS, 20 + slaves, "down at once, not step by step");
    }
}

/// From PreOP to OP goes through SafeOP; slaves that are at different states go together, the lowest first.
#[test]
fn a_change_of_several_states() {
    let mut bench = Bench::in_state(2, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    let (done, took) = bench.run(state(Op, 2));
    assert_eq!((done, took / MS), (JobDone::State(Ok(())), 300 + 50 + 2 * 4));
    assert_eq!(bench.done(state(PreOp, 1)), JobDone::State(Ok(())));
    assert_eq!(bench.done(state(SafeOp, 2)), JobDone::State(Ok(())), "one up, one down");
    let done = bench.poll().unwrap();
    assert_eq!((done.working_counter, done.expected_working_counter), (2, 2));
}

/// A slave that is further up than the others does not go down to wait for them.
#[test]
fn nobody_goes_down_on_the_way_up() {
    let mut bench = Bench::in_state(2, SafeOp);
    assert_eq!(bench.done(Job::State { target: Init, slaves: set(&[2]), timeout_ns: SECOND }), JobDone::State(Ok(())));
    bench.bus.start(state(Op, 2), bench.now).unwrap();
    let done = loop {
        assert_eq!(bench.poll().map(|done| done.working_counter), Some(1));
        if let Some(done) = bench.bus.poll_job(bench.now) {
            break done;
        }
    };
    assert_eq!(done, JobDone::State(refused(2, 0x001D)), "Init took its configuration");
}

/// A bus does one job at a time; a job that is given up never ends.
#[test]
fn one_job_at_a_time() {
    let mut bench = Bench::in_state(1, PreOp);
    bench.bus.start(Job::Scan, bench.now).unwrap();
    assert_eq!(bench.bus.start(sdo(1, 0x1000, None), bench.now), Err(Busy));
    bench.bus.cancel_job();
    bench.now += 10 * SECOND;
    assert_eq!(bench.bus.poll_job(bench.now), None);
    assert_eq!(bench.done(sdo(1, 0x1000, None)), JobDone::Sdo(Ok(0x0002_0192)));
}

/// Durations are the caller's to choose.
#[test]
fn timing_can_be_chosen() {
    let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
    let timing = Timing { scan_ns: 7 * MS, scan_slave_ns: MS, sdo_ns: 12 * MS, ..Timing::default() };
    let mut bench = Bench { bus: SimBus::new(vec![drive(), drive()]).with_timing(timing), ..Bench::new(0) };
    assert_eq!(bench.run(Job::Scan), (JobDone::Scan { found: 2 }, 9 * MS));
    bench.reach(PreOp, 2);
    assert_eq!(bench.run(sdo(1, 0x1000, None)).1, 12 * MS);
}

/// SK-4.58 A slave that cannot be what it is declared as is named with its AL status.
#[test]
fn configure_names_the_slave_that_refuses() {
    let mut bench = Bench::in_state(3, PreOp);
    assert_eq!(bench.done(configure(Role::Io)), JobDone::Configure(refused(1, 0x001D)));
    let Job::Configure(mut config) = configure(Role::Drive(Mode::Csv)) else { unreachable!() };
    config.slaves[2].role = Role::Hsp(Mode::Csp);
    assert_eq!(bench.done(Job::Configure(config)), JobDone::Configure(refused(3, 0x001D)));
    config.slaves[2].role = Role::Unused;
    assert_eq!(bench.run(Job::Configure(config)), (JobDone::Configure(Ok(())), 30 * MS));
    bench.handle.silence(2, true);
    assert_eq!(bench.done(Job::Configure(config)), JobDone::Configure(refused(2, 0)), "it said nothing");
}

/// SK-4.56 SK-4.57 Slaves that are not there are no error, and one that is not in the set stays where it is.
#[test]
fn only_the_slaves_asked_for_change() {
    let mut bench = Bench::in_state(3, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    let job = Job::State { target: Op, slaves: set(&[1, 3, 17, 40]), timeout_ns: 10 * SECOND };
    assert_eq!(bench.done(job), JobDone::State(Ok(())));
    let done = bench.cycle();
    assert_eq!((done.working_counter, done.expected_working_counter), (6, 6));
    assert_eq!(bench.inputs.lost, SlaveSet::EMPTY);
    assert_eq!([1, 2, 3].map(|slave| bench.position(slave)), [1000, 0, 3000]);
}

/// A change fails with the slave that refuses, at once, or with the one that says nothing, after the timeout; the
/// others have changed.
#[test]
fn changes_that_fail() {
    let mut bench = Bench::in_state(3, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    bench.handle.refuse(2, Some((SafeOp, AlStatus(0x0032))));
    let (done, took) = bench.run(state(Op, 3));
    assert_eq!((done, took / MS), (JobDone::State(refused(2, 0x0032)), 306));
    bench.poll();
    assert_eq!([1, 2, 3].map(|slave| bench.position(slave)), [1000, 0, 3000], "two in SafeOP");
    bench.handle.refuse(2, None);
    bench.reach(Op, 3);

    bench.reach(SafeOp, 3);
    bench.handle.silence(3, true);
    let job = Job::State { target: Op, slaves: SlaveSet::first(3), timeout_ns: 500 * MS };
    assert_eq!(bench.run(job), (JobDone::State(refused(3, 0)), 500 * MS));
    // It answers in time.
    bench.bus.start(job, bench.now).unwrap();
    bench.now += 300 * MS;
    assert_eq!(bench.bus.poll_job(bench.now), None);
    bench.handle.silence(3, false);
    bench.now += 100 * MS;
    assert_eq!(bench.bus.poll_job(bench.now), Some(JobDone::State(Ok(()))));
}

/// SDO transfers take some 3 ms and end with the value, or with the slave's abort code.
#[test]
fn sdo_transfers() {
    let mut bench = Bench::in_state(2, PreOp);
    assert_eq!(bench.run(sdo(2, 0x6064, None)), (JobDone::Sdo(Ok(2000)), 3 * MS));
    let write = Some((SdoSize::Two, 0x1234));
    assert_eq!(bench.done(sdo(1, 0x6066, write)), JobDone::Sdo(Ok(0x1234)));
    assert_eq!(bench.done(sdo(1, 0x6066, None)), JobDone::Sdo(Ok(0x1234)));
    assert_eq!(bench.done(sdo(2, 0x6066, None)), JobDone::Sdo(Ok(10)), "the other has its own");
    assert_eq!(bench.done(sdo(1, 0x6041, write)), JobDone::Sdo(Err(AbortCode::READ_ONLY)));
    assert_eq!(bench.done(sdo(1, 0x7000, None)), JobDone::Sdo(Err(AbortCode::NO_OBJECT)));
}

/// SK-6.7 A slave that does not answer ends the transfer in a timeout, when its time is over: absent, in Init, silent,
/// behind a cut.
#[test]
fn sdo_timeouts() {
    let timeout = (JobDone::Sdo(Err(AbortCode::TIMEOUT)), SECOND);
    let mut bench = Bench::in_state(2, PreOp);
    for absent in [0, 3, 40, 255] {
        assert_eq!(bench.run(sdo(absent, 0x1000, None)), timeout, "slave {absent}");
    }
    bench.handle.silence(1, true);
    assert_eq!(bench.run(sdo(1, 0x1000, None)), timeout, "silent");
    bench.handle.silence(1, false);
    bench.handle.cut_after(1);
    assert_eq!(bench.run(sdo(2, 0x1000, None)), timeout, "cut off");
    assert_eq!(bench.done(sdo(1, 0x1000, None)), JobDone::Sdo(Ok(0x0002_0192)), "before the cut");
    bench.handle.heal();
    assert_eq!(bench.done(sdo(2, 0x1000, None)), JobDone::Sdo(Ok(0x0002_0192)), "healed");
    let mut bench = Bench::in_state(1, Init);
    assert_eq!(bench.run(sdo(1, 0x1000, None)), timeout, "in Init");
}

/// What comes after its time is late, also if nobody asked in between.
#[test]
fn late_is_late() {
    let mut bench = Bench::in_state(1, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    bench.handle.delay_sdo(1, 2 * SECOND);
    let short = Job::State { target: SafeOp, slaves: SlaveSet::first(1), timeout_ns: 100 * MS };
    for (job, done) in
        [(sdo(1, 0x1000, None), JobDone::Sdo(Err(AbortCode::TIMEOUT))), (short, JobDone::State(refused(1, 0)))]
    {
        bench.bus.start(job, bench.now).unwrap();
        bench.now += 10 * SECOND;
        assert_eq!(bench.bus.poll_job(bench.now), Some(done));
    }
}

/// Transfers can be made slow, late or failing.
#[test]
fn sdo_faults() {
    let mut bench = Bench::in_state(2, PreOp);
    bench.handle.delay_sdo(1, 500 * MS);
    assert_eq!(bench.run(sdo(1, 0x1000, None)), (JobDone::Sdo(Ok(0x0002_0192)), 503 * MS));
    assert_eq!(bench.run(sdo(2, 0x1000, None)).1, 3 * MS);
    bench.handle.delay_sdo(1, 2 * SECOND);
    assert_eq!(bench.run(sdo(1, 0x6066, Some((SdoSize::Two, 1)))), (JobDone::Sdo(Err(AbortCode::TIMEOUT)), SECOND));
    bench.handle.delay_sdo(1, 0);
    assert_eq!(bench.done(sdo(1, 0x6066, None)), JobDone::Sdo(Ok(10)), "nothing was written");
    bench.handle.abort_sdo(1, Some(AbortCode::HARDWARE));
    assert_eq!(bench.done(sdo(1, 0x6066, Some((SdoSize::Two, 1)))), JobDone::Sdo(Err(AbortCode::HARDWARE)));
    bench.handle.abort_sdo(1, None);
    assert_eq!(bench.done(sdo(1, 0x6066, None)), JobDone::Sdo(Ok(10)), "nothing was written");
    bench.handle.delay_sdo(0, MS);
    bench.handle.delay_sdo(41, MS);
}

/// The working counter: 3 for a slave in OP, 1 in SafeOP, nothing below.
#[test]
fn working_counter() {
    for (state, each) in [(Init, 0), (PreOp, 0), (SafeOp, 1), (Op, 3)] {
        let mut bench = Bench::in_state(3, state);
        let done = bench.poll().unwrap();
        assert_eq!((done.working_counter, done.expected_working_counter), (3 * each, 3 * each), "{state:?}");
        assert_eq!(done.next_deadline, None);
    }
}

/// Inputs come in SafeOP and OP, outputs are taken in OP alone.
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
    assert_eq!((bench.bus.pacing(), bench.bus.room(), bench.bus.held()), (Pacing::Runner, 1, 0));
    *bench.target(1) += 10;
    bench.bus.push(&bench.outputs).unwrap();
    assert_eq!((bench.bus.room(), bench.bus.held()), (0, 1));
    assert_eq!(bench.bus.push(&bench.outputs), Err(BusError::Full { held: 1 }));
    assert_eq!(bench.bus.discard_ahead(), 1);
    assert_eq!((bench.bus.room(), bench.bus.held(), bench.bus.discard_ahead()), (1, 0, 0));
    bench.cycle();
    for _ in 0..200 {
        assert_eq!(bench.poll().map(|done| done.outputs), Some(None));
    }
    assert_eq!((bench.position(1), bench.drive_state(1)), (1010, DriveState::OperationEnabled));
}

/// A cycle is a poll at a later time; its inputs were measured at the end of the one before.
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

/// Forty drives follow forty targets of their own.
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

/// A cable cut after a slave: those behind are lost and keep their values, the others go on. Healed, the lost stay lost
/// until a change of state brings them back.
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

/// A cut that heals before a slave's watchdog ends OP loses it all the same, and it comes back without a detour.
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

/// Cut before the first slave the bus is silent, while time goes on in the slaves; plugged again, all of them are lost.
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

/// A silent slave is lost, and time goes on in it: it coasts or brakes, and its watchdog ends OP.
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
        fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal> {
            self.0.configure(config)
        }
        fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
            self.0.upload(object)
        }
        fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
            self.0.download(object, size, value)
        }
        fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
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

/// A slave below SafeOP is lost while it does not answer, and no longer.
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

/// Back in OP a drive does not act on what was sent before it left.
#[test]
fn old_outputs_do_not_come_back() {
    let mut bench = Bench::enabled(1);
    bench.reach(PreOp, 1);
    bench.reach(Op, 1);
    for _ in 0..500 {
        bench.poll();
    }
    assert_eq!(bench.drive_state(1), DriveState::SwitchOnDisabled);
    assert_eq!(bench.done(sdo(1, 0x6040, None)), JobDone::Sdo(Ok(0)));
}

/// A fault raised from outside shows in the process data of that slave.
#[test]
fn faults_from_outside() {
    let mut bench = Bench::enabled(3);
    let fault = DeviceFault { code: 0x4210, resettable: true };
    bench.handle.raise_fault(2, 0, fault);
    for (slave, axis) in [(0, 0), (4, 0), (1, 1)] {
        bench.handle.raise_fault(slave, axis, fault);
    }
    bench.cycles(3);
    assert_eq!([1, 2, 3].map(|slave| bench.inputs.slaves[slave - 1][0].error_code), [0, 0x4210, 0]);
    assert_eq!(bench.drive_state(2), DriveState::Fault);
    assert_eq!(bench.drive_state(1), DriveState::OperationEnabled);
    bench.command(Controlword(Controlword::FAULT_RESET));
    bench.cycles(3);
    assert_eq!(bench.drive_state(2), DriveState::SwitchOnDisabled);
}

/// After a long pause one poll makes up for all of it.
#[test]
fn a_long_pause() {
    let mut bench = Bench::enabled(2);
    *bench.target(2) += 100_000;
    bench.now += 5 * SECOND;
    bench.cycle();
    bench.cycle();
    assert_eq!((bench.position(2), bench.drive_state(2)), (102_000, DriveState::OperationEnabled));
}

/// A cycle allocates nothing: 40 drives in OP, all moving, with a lost slave and a fault on the way.
#[test]
fn a_cycle_allocates_nothing() {
    let mut bench = Bench::enabled(40);
    bench.handle.raise_fault(7, 0, DeviceFault { code: 0x4210, resettable: true });
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
