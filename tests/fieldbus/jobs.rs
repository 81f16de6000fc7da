//! The simulated bus: its jobs, their timing, and how they fail.

use ecmsk::cia402::{Controlword, Mode, Statusword};
use ecmsk::coe::{AbortCode, SdoSize};
use ecmsk::fieldbus::pdo::{IMAGE_BYTES_MAX, ProcessData};
use ecmsk::fieldbus::sim::{SimBus, Timing};
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, Busy, Configured, Fieldbus, Job, JobDone, Ns, Role, SlaveSet};
use ecmsk::sk::{CycleTime, DriveSync};
use ecmsk::slave::{AlStatus, Channels, Dp3cl, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use support::fieldbus_rig::{Bench, MS, SECOND, configure, refused, sdo, set, state};

use AlState::*;

/// A scan counts the slaves that the cable reaches, at most 40, and leaves them in Init.
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

/// A slave in a higher state than the others does not go down to wait for them.
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

/// SK-6.15 An SDO runs in parallel with a change of state, and with no other job; each of the two is aborted
/// separately.
#[test]
fn an_sdo_beside_a_change_of_state() {
    let mut bench = Bench::in_state(2, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    bench.bus.start(state(SafeOp, 2), bench.now).unwrap();
    assert_eq!(bench.bus.start(state(SafeOp, 2), bench.now), Err(Busy));
    assert_eq!(bench.transferred(sdo(1, 0x1000, None)), Ok(0x0002_0192));
    bench.bus.start_sdo(sdo(1, 0x1000, None), bench.now).unwrap();
    assert_eq!(bench.bus.start_sdo(sdo(2, 0x1000, None), bench.now), Err(Busy));
    bench.bus.cancel_sdo();
    bench.now += SECOND;
    assert_eq!(bench.bus.poll_job(bench.now), Some(JobDone::State(Ok(()))));
    assert_eq!((bench.bus.poll_job(bench.now), bench.bus.poll_sdo(bench.now)), (None, None));

    bench.bus.start_sdo(sdo(1, 0x1000, None), bench.now).unwrap();
    for job in [Job::Scan, configure(Role::Drive(Mode::Csp))] {
        assert_eq!(bench.bus.start(job, bench.now), Err(Busy));
    }
    bench.bus.start(state(PreOp, 2), bench.now).unwrap();
    bench.bus.cancel_job();
    bench.now += SECOND;
    assert_eq!(bench.bus.poll_sdo(bench.now), Some(Ok(0x0002_0192)));
    assert_eq!((bench.bus.poll_sdo(bench.now), bench.bus.poll_job(bench.now)), (None, None));
}

/// A bus does one job at a time; an aborted job never ends.
#[test]
fn one_job_at_a_time() {
    let mut bench = Bench::in_state(1, PreOp);
    bench.bus.start(Job::Scan, bench.now).unwrap();
    assert_eq!(bench.bus.start_sdo(sdo(1, 0x1000, None), bench.now), Err(Busy));
    bench.bus.cancel_job();
    bench.now += 10 * SECOND;
    assert_eq!(bench.bus.poll_job(bench.now), None);
    assert_eq!(bench.transferred(sdo(1, 0x1000, None)), Ok(0x0002_0192));
}

/// The caller can choose the durations.
#[test]
fn timing_can_be_chosen() {
    let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
    let timing = Timing { scan_ns: 7 * MS, scan_slave_ns: MS, sdo_ns: 12 * MS, ..Timing::default() };
    let mut bench = Bench { bus: SimBus::new(vec![drive(), drive()]).with_timing(timing), ..Bench::new(0) };
    assert_eq!(bench.run(Job::Scan), (JobDone::Scan { found: 2 }, 9 * MS));
    bench.reach(PreOp, 2);
    assert_eq!(bench.transfer(sdo(1, 0x1000, None)).1, 12 * MS);
}

/// SK-4.58 A slave that does not match its declared kind is named with its AL status.
#[test]
fn configure_names_the_slave_that_refuses() {
    let mut bench = Bench::in_state(3, PreOp);
    assert_eq!(bench.done(configure(Role::Io)), JobDone::Configure(refused(1, 0x001D)));
    let Job::Configure(mut config) = configure(Role::Drive(Mode::Csv)) else { unreachable!() };
    config.slaves[2].role = Role::Io;
    assert_eq!(bench.done(Job::Configure(config)), JobDone::Configure(refused(3, 0x001D)));
    config.slaves[2].role = Role::Unused;
    assert_eq!(bench.run(Job::Configure(config)), (JobDone::Configure(Ok(Configured::default())), 30 * MS));
    bench.handle.silence(2, true);
    assert_eq!(bench.done(Job::Configure(config)), JobDone::Configure(refused(2, 0)), "it said nothing");
}

/// A successful Configure, with these slaves as modules of two channels.
fn configured(second_axes: &[u8]) -> JobDone {
    JobDone::Configure(Ok(Configured { second_axes: set(second_axes), ..Configured::default() }))
}

/// SK-3.22 Configure reports which pulse modules have a second axis, whatever their role.
#[test]
fn configure_tells_modules_of_two_channels() {
    let hsp = |channels| Box::new(Hsp::new(HspConfig::with(channels))) as Box<dyn Slave>;
    let slaves = vec![hsp(Channels::Two), hsp(Channels::One), Box::<Io>::default(), hsp(Channels::Two)];
    let mut bench = Bench::of(slaves);
    bench.done(Job::Scan);
    bench.reach(PreOp, 4);
    let Job::Configure(mut config) = configure(Role::Hsp(Mode::Csv)) else { unreachable!() };
    config.slaves[2].role = Role::Io;
    assert_eq!(bench.done(Job::Configure(config)), configured(&[1, 4]));
    config.slaves[3].role = Role::Unused;
    assert_eq!(bench.done(Job::Configure(config)), configured(&[1]));
}

/// SK-4.56 SK-4.57 Missing slaves are no error, and a slave outside the set keeps its state.
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

/// SDO transfers take about 3 ms and end with the value, or with the slave's abort code.
#[test]
fn sdo_transfers() {
    let mut bench = Bench::in_state(2, PreOp);
    assert_eq!(bench.transfer(sdo(2, 0x6064, None)), (Ok(2000), 3 * MS));
    let write = Some((SdoSize::Two, 0x1234));
    assert_eq!(bench.transferred(sdo(1, 0x6066, write)), Ok(0x1234));
    assert_eq!(bench.transferred(sdo(1, 0x6066, None)), Ok(0x1234));
    assert_eq!(bench.transferred(sdo(2, 0x6066, None)), Ok(10), "the other has its own");
    assert_eq!(bench.transferred(sdo(1, 0x6041, write)), Err(AbortCode::READ_ONLY));
    assert_eq!(bench.transferred(sdo(1, 0x7000, None)), Err(AbortCode::NO_OBJECT));
}

/// behind a cut.
#[test]
fn sdo_timeouts() {
    let timeout = (Err(AbortCode::TIMEOUT), SECOND);
    let mut bench = Bench::in_state(2, PreOp);
    for absent in [0, 3, 40, 255] {
        assert_eq!(bench.transfer(sdo(absent, 0x1000, None)), timeout, "slave {absent}");
    }
    bench.handle.silence(1, true);
    assert_eq!(bench.transfer(sdo(1, 0x1000, None)), timeout, "silent");
    bench.handle.silence(1, false);
    bench.handle.cut_after(1);
    assert_eq!(bench.transfer(sdo(2, 0x1000, None)), timeout, "cut off");
    assert_eq!(bench.transferred(sdo(1, 0x1000, None)), Ok(0x0002_0192), "before the cut");
    bench.handle.heal();
    assert_eq!(bench.transferred(sdo(2, 0x1000, None)), Ok(0x0002_0192), "healed");
    let mut bench = Bench::in_state(1, Init);
    assert_eq!(bench.transfer(sdo(1, 0x1000, None)), timeout, "in Init");
}

/// An answer after its time is late, even without a poll in between.
#[test]
fn late_is_late() {
    let mut bench = Bench::in_state(1, PreOp);
    bench.done(configure(Role::Drive(Mode::Csp)));
    bench.handle.delay_sdo(1, 2 * SECOND);
    let short = Job::State { target: SafeOp, slaves: SlaveSet::first(1), timeout_ns: 100 * MS };
    bench.bus.start_sdo(sdo(1, 0x1000, None), bench.now).unwrap();
    bench.now += 10 * SECOND;
    assert_eq!(bench.bus.poll_sdo(bench.now), Some(Err(AbortCode::TIMEOUT)));
    bench.bus.start(short, bench.now).unwrap();
    bench.now += 10 * SECOND;
    assert_eq!(bench.bus.poll_job(bench.now), Some(JobDone::State(refused(1, 0))));
}

/// Transfers can be made slow, late or failing.
#[test]
fn sdo_faults() {
    let mut bench = Bench::in_state(2, PreOp);
    bench.handle.delay_sdo(1, 500 * MS);
    assert_eq!(bench.transfer(sdo(1, 0x1000, None)), (Ok(0x0002_0192), 503 * MS));
    assert_eq!(bench.transfer(sdo(2, 0x1000, None)).1, 3 * MS);
    bench.handle.delay_sdo(1, 2 * SECOND);
    assert_eq!(bench.transfer(sdo(1, 0x6066, Some((SdoSize::Two, 1)))), (Err(AbortCode::TIMEOUT), SECOND));
    bench.handle.delay_sdo(1, 0);
    assert_eq!(bench.transferred(sdo(1, 0x6066, None)), Ok(10), "nothing was written");
    bench.handle.abort_sdo(1, Some(AbortCode::HARDWARE));
    assert_eq!(bench.transferred(sdo(1, 0x6066, Some((SdoSize::Two, 1)))), Err(AbortCode::HARDWARE));
    bench.handle.abort_sdo(1, None);
    assert_eq!(bench.transferred(sdo(1, 0x6066, None)), Ok(10), "nothing was written");
    bench.handle.delay_sdo(0, MS);
    bench.handle.delay_sdo(41, MS);
}

/// SK-7.54 The board's writes that map process data and set the mode, in their order.
#[test]
fn downloads_of_each_role() {
    let written = |role, second| -> Vec<(u16, u8, u8, u32)> {
        let data = ProcessData::of(role, second).expect("the role has process data");
        let downloads = data.downloads(DriveSync::DcSync).into_iter();
        downloads.map(|to| (to.object.index, to.object.sub, to.size.bytes(), to.value)).collect()
    };
    let clear = [(0x1C12, 0, 1, 0), (0x1C13, 0, 1, 0)];
    let sync = [(0x1C32, 1, 2, 2), (0x1C33, 1, 2, 2)];
    let drive_inputs = [
        (0x1A00, 0, 1, 0),
        (0x1A00, 1, 4, 0x6041_0010),
        (0x1A00, 2, 4, 0x6064_0020),
        (0x1A00, 3, 4, 0x6077_0010),
        (0x1A00, 4, 4, 0x603F_0010),
        (0x1A00, 0, 1, 4),
        (0x1C13, 1, 2, 0x1A00),
        (0x1C13, 0, 1, 1),
    ];
    for (mode, pdo, target) in
        [(Mode::Csp, 0x1600, 0x607A_0020), (Mode::Csv, 0x1601, 0x60FF_0020), (Mode::Cst, 0x1602, 0x6071_0010)]
    {
        let mode_and_outputs = [
            (0x6060, 0, 1, mode.code().into()),
            (pdo, 0, 1, 0),
            (pdo, 1, 4, 0x6040_0010),
            (pdo, 2, 4, target),
            (pdo, 0, 1, 2),
            (0x1C12, 1, 2, pdo.into()),
            (0x1C12, 0, 1, 1),
        ];
        let expected = [&clear[..], &drive_inputs, &mode_and_outputs, &sync].concat();
        assert_eq!(written(Role::Drive(mode), false), expected, "{mode}");
    }
    assert_eq!(written(Role::Step(Mode::Csp), false), written(Role::Drive(Mode::Csp), false));
    let hsp = written(Role::Hsp(Mode::Csv), true);
    for download in [
        (0x1A10, 3, 4, 0x68FD_0020),
        (0x1C13, 2, 2, 0x1A10),
        (0x1C13, 0, 1, 2),
        (0x6860, 0, 1, 9),
        (0x1611, 2, 4, 0x68FF_0020),
        (0x1611, 3, 4, 0x68FE_0120),
        (0x1C12, 2, 2, 0x1611),
        (0x1C12, 0, 1, 2),
    ] {
        assert!(hsp.contains(&download), "{download:04X?}");
    }
    let io = written(Role::Io, false);
    assert!(io.contains(&(0x1600, 1, 4, 0x7000_0110)) && io.contains(&(0x1A00, 1, 4, 0x6000_0110)));
    assert!(!io.iter().any(|(index, ..)| *index == 0x6060), "no mode");
}

/// SK-7.1 SK-7.3 SK-7.4 SK-7.5 SK-7.7 Words are read from an image as they were written, at the bytes of the tables.
#[test]
fn images_of_each_role() {
    let out =
        |n: i32| AxisOut { controlword: Controlword(0x0F + n as u16), outputs: 0xA5C3 - n as u16, target: -7 - n };
    let outputs = [out(0), out(1)];
    let image = |role, second| {
        let data = ProcessData::of(role, second).expect("the role has process data");
        let mut image = [0; IMAGE_BYTES_MAX];
        let sent = data.put_outputs(&outputs, &mut image).to_vec();
        (sent.clone(), data.take_outputs(&sent))
    };
    let (sent, back) = image(Role::Drive(Mode::Csp), false);
    assert_eq!((sent, back[0]), (vec![0x0F, 0, 0xF9, 0xFF, 0xFF, 0xFF], AxisOut { outputs: 0, ..out(0) }));
    let (sent, back) = image(Role::Drive(Mode::Cst), false);
    assert_eq!((sent, back[0].target), (vec![0x0F, 0, 0xF9, 0xFF], -7));
    let (sent, back) = image(Role::Hsp(Mode::Csp), true);
    assert_eq!(sent[10..], [0x10, 0, 0xF8, 0xFF, 0xFF, 0xFF, 0xC2, 0xA5, 0, 0]);
    assert_eq!((sent.len(), back), (20, outputs));
    let (sent, back) = image(Role::Io, false);
    assert_eq!((sent, back[0].outputs), (vec![0xC3, 0xA5], 0xA5C3));

    let seen =
        AxisIn { statusword: Statusword(0x1637), torque: -3, position: -70_000, error_code: 0x8611, inputs: 0xBEEF };
    for (role, expected) in [
        (Role::Drive(Mode::Csp), AxisIn { inputs: 0, ..seen }),
        (Role::Hsp(Mode::Csv), AxisIn { torque: 0, error_code: 0, ..seen }),
        (Role::Io, AxisIn { inputs: seen.inputs, ..AxisIn::default() }),
    ] {
        let data = ProcessData::of(role, false).expect("the role has process data");
        let mut image = [0; IMAGE_BYTES_MAX];
        data.put_inputs(&[seen; 2], &mut image);
        let mut taken = [seen; 2];
        data.take_inputs(&image[..data.input_bytes()], &mut taken);
        assert_eq!(taken, [expected, seen], "{role:?}: the second axis is left alone");
    }
}

/// DP3CL-10.3 A DP3CL that has lost its power restarts: unsaved values are lost, its mapping is that of power-on.
#[test]
fn a_slave_that_was_switched_off_begins_anew() {
    let mut bench = Bench::of(vec![Box::<Dp3cl>::default()]);
    assert_eq!(bench.done(Job::Scan), JobDone::Scan { found: 1 });
    assert_eq!(bench.done(state(PreOp, 1)), JobDone::State(Ok(())));
    let value = |bench: &mut Bench, index| bench.transferred(sdo(1, index, None)).expect("it is read");
    assert_eq!(bench.transferred(sdo(1, 0x2005, Some((SdoSize::Two, 60)))), Ok(60));
    assert_eq!(bench.transferred(sdo(1, 0x1600, Some((SdoSize::One, 1)))), Ok(1));
    assert_eq!((value(&mut bench, 0x2005), value(&mut bench, 0x1600), value(&mut bench, 0x3200)), (60, 1, 1));
    bench.handle.lose(1);
    bench.poll();
    bench.handle.find(1);
    bench.poll();
    assert_eq!(bench.done(Job::Scan), JobDone::Scan { found: 1 });
    assert_eq!(bench.done(state(PreOp, 1)), JobDone::State(Ok(())));
    assert_eq!((value(&mut bench, 0x2005), value(&mut bench, 0x1600), value(&mut bench, 0x3200)), (100, 3, 2));
}

/// DP3CL-10.2 The cycle of the bus is that of SYNC0; in free run any cycle is valid.
#[test]
fn a_dp3cl_has_four_cycles() {
    for (cycle_us, sync, answer) in [
        (250, DriveSync::DcSync, Err(0x0035)),
        (500, DriveSync::DcSync, Ok(())),
        (4000, DriveSync::DcSync, Ok(())),
        (8000, DriveSync::DcSync, Err(0x0035)),
        (8000, DriveSync::FreeRun, Ok(())),
    ] {
        let mut bench = Bench::of(vec![Box::<Dp3cl>::default()]);
        bench.done(Job::Scan);
        assert_eq!(bench.done(state(PreOp, 1)), JobDone::State(Ok(())));
        let Job::Configure(mut config) = configure(Role::Step(Mode::Csp)) else { panic!("it is a configuration") };
        config.cycle = CycleTime::from_us(cycle_us).expect("a cycle of the board");
        config.slaves.iter_mut().for_each(|slave| slave.sync = sync);
        assert_eq!(bench.done(Job::Configure(config)), JobDone::Configure(Ok(Configured::default())));
        let expected = answer.map_or_else(|status| JobDone::State(refused(1, status)), |()| JobDone::State(Ok(())));
        assert_eq!(bench.done(state(Op, 1)), expected, "{cycle_us} {sync:?}");
    }
}
