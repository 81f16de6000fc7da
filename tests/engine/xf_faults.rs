//! The board over an ECM-XF with faults: wires, the chip, slaves behind it, and jobs that are given up.

use std::sync::atomic::Ordering;

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::engine::{EngineConfig, EventKind};
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::fieldbus::{AlState, BusConfig, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Role, SlaveConfig, SlaveSet};
use ecmsk::sk::{CycleTime, DcShift, DriveSync, MasterCommand, MasterState, SdoCommand, StateByte};
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::SlaveModels;
use support::chip_line::{ChipLine, xf_bus, xf_bus_reached_by};
use support::faulty_wire::reset_chip;

use crate::host::Host;
use crate::probe::drives;
use crate::puppet::Puppet;

/// Two drives that are on, of which the second one is lost.
fn two_of_which_one_is_lost() -> (Host, [Puppet; 2], SimHandle) {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let handle = SimHandle::default();
    let bus = xf_bus_reached_by(puppets.iter().map(Puppet::boxed).collect(), handle.clone(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(1).servo_on(2);
    handle.lose(2);
    host.until("the loss", |host| host.state() == StateByte::failed(Some(MasterState::Op)));
    (host, puppets, handle)
}

/// XF-19.4 A slave that was lost comes back; the other one goes on in OP meanwhile, and misses no target.
#[test]
fn who_comes_back_disturbs_nobody() {
    let (mut host, puppets, handle) = two_of_which_one_is_lost();
    handle.find(2);
    host.master(MasterCommand::SetState(MasterState::Op));
    let mut targets = 0;
    while host.state() != StateByte::reached(MasterState::Op) {
        targets += 1;
        host.csp(1, targets).cycle();
    }
    host.drained().cycles(30);
    assert_eq!(puppets[0].targets(), (0..=targets).collect::<Vec<_>>());
    assert!(puppets[0].strings().al_state() == AlState::Op && puppets[1].strings().al_state() == AlState::Op);
}

/// XF-19.8 Cut wires are reported once, with what to do. When they are whole again all slaves are taken out of OP at
/// once, since the chip still repeats its newest outputs, and count as lost; the next SET_STATE brings them back.
#[test]
fn cut_wires_are_told_and_heal() {
    let puppet = Puppet::obedient();
    let bus = xf_bus(vec![puppet.boxed()], XfBusOptions::DEFAULT);
    let cut = bus.wires().cut.clone();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(1).servo_on(1).csp(1, 100).drained();
    let mark = host.mark();
    cut.store(true, Ordering::Relaxed);
    host.cycles(20_000);
    let told: Vec<_> = host.board.engine().events_since(mark).collect();
    let down = told.iter().filter(|event| matches!(event.kind, EventKind::BusDown)).count();
    assert!(down >= 1 && told.iter().any(|event| event.to_string().contains("look at its wires")), "{told:?}");
    cut.store(false, Ordering::Relaxed);
    host.until("the loss", |host| host.state() == StateByte::failed(Some(MasterState::Op)));
    host.until("PreOP", |_| puppet.strings().al_state() == AlState::PreOp);
    puppet.forget();
    host.master(MasterCommand::SetState(MasterState::Op));
    host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op));
    assert!(puppet.controlwords().iter().all(|word| *word == 0), "nothing starts by itself");
    host.servo_on(1).csp(1, 200).drained().cycles(20);
    assert_eq!(puppet.last().target, 200);
}

/// SK-12.4 Wires that are cut for a moment, in which the answers of some cycles are lost: they make no report, are counted and
/// logged, and the drive gets every target all the same.
#[test]
fn answers_that_the_wires_lose_are_counted() {
    let puppet = Puppet::obedient();
    let bus = xf_bus(vec![puppet.boxed()], XfBusOptions::DEFAULT);
    let cut = bus.wires().cut.clone();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(1).servo_on(1).csp(1, 1).drained().cycles(20);
    puppet.forget();
    let (before, reports, mark, began) = (host.counters(), host.reports, host.mark(), host.board.now());
    for n in 2..=100 {
        cut.store(n >= 20, Ordering::Relaxed);
        host.csp(1, n).cycle();
    }
    host.cycles(100);
    cut.store(false, Ordering::Relaxed);
    host.drained().cycles(100);
    let (after, reports) = (host.counters(), host.reports - reports);
    let lost = after.answers_lost - before.answers_lost;
    let cycles = (host.board.now() - began) / 1_000_000;
    assert!(reports + 100 < cycles && reports + lost >= cycles, "{lost} lost, {reports} reports, {cycles} cycles");
    let logged =
        host.board.engine().events_since(mark).filter(|event| matches!(event.kind, EventKind::AnswersLost { .. }));
    assert!(logged.count() > 0);
    assert!(puppet.targets().into_iter().filter(|target| *target > 1).eq(2..=100), "{:?}", puppet.targets());
    assert_eq!((after.for_lost, after.outputs_lost, after.full), (0, 0, 0));
}

/// XF-19.9 A slave that is lost again and again is named as soon as the first time, when the chip's count of wrong working
/// counters is at its end.
#[test]
fn the_tenth_loss_is_named_as_soon_as_the_first() {
    let handle = SimHandle::default();
    let bus = xf_bus_reached_by(drives(2), handle.clone(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2);
    for loss in 1..=10 {
        handle.lose(2);
        let mut cycles = 0;
        while !host.state().is_failed() {
            host.cycle();
            cycles += 1;
        }
        assert!(cycles <= 12, "loss {loss}: {cycles}");
        host.cycles(100);
        handle.find(2);
        host.go(MasterState::Op).cycles(17 * loss);
    }
}

/// XF-19.11 A slave that is lost while another one is being brought back is named all the same, and the outputs that it
/// missed are counted.
#[test]
fn who_is_lost_meanwhile_is_named() {
    let (mut host, puppets, handle) = two_of_which_one_is_lost();
    // The slave does not answer, so that the change lasts.
    host.master(MasterCommand::SetState(MasterState::Op)).cycles(200);
    let mut targets = 0;
    for cycle in 0..400 {
        if cycle == 100 {
            handle.lose(1);
        }
        targets += 1;
        host.csp(1, targets).cycle();
    }
    assert!(host.board.engine().lost().contains(1), "{:?}", host.board.engine().lost());
    host.drained().cycles(100);
    let got = puppets[0].targets().last().copied().expect("some have come");
    // Outputs sent since the states were read last, which may have arrived, count as well.
    let (missing, counted) = (targets - got, host.counters().for_lost as i32);
    assert!((missing..missing + 20).contains(&counted), "{got} of {targets} have come, {counted} counted");
}

/// Every slave is lost with its chip, whose wires were cut for a while; the second one cannot be mapped, so that the first
/// comes back alone.
fn one_of_two_back(puppets: &[Puppet; 2], handle: &SimHandle) -> Host {
    let slaves = puppets.iter().map(Puppet::boxed).collect();
    let bus = xf_bus_reached_by(slaves, handle.clone(), XfBusOptions { ahead: 30, ..XfBusOptions::DEFAULT });
    let cut = bus.wires().cut.clone();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2);
    cut.store(true, Ordering::Relaxed);
    host.cycles(4000);
    cut.store(false, Ordering::Relaxed);
    host.until("the loss", |host| host.state() == StateByte::failed(Some(MasterState::Op)));
    handle.abort_object(2, Some((ObjectAddress::new(0x1600, 0), AbortCode::VALUE_RANGE)));
    host.master(MasterCommand::SetState(MasterState::Op));
    host.until("slave 1 is back", |host| !host.board.engine().lost().contains(1));
    host.cycles(15_000);
    host
}

/// XF-19.11 Outputs in the chip when the last slave leaves OP for the configuration of another one are lost, and
/// counted: the FIFO runs empty without another command. SK-12.7 It comes back by the same SET_STATE.
#[test]
fn what_nobody_gets_any_more_is_counted() {
    let (puppets, handle) = ([Puppet::obedient(), Puppet::obedient()], SimHandle::default());
    let mut host = one_of_two_back(&puppets, &handle);
    host.servo_on(1).drained();
    handle.abort_object(2, None);
    let before = host.counters();
    host.master(MasterCommand::SetState(MasterState::Op));
    let mut targets = 0;
    while puppets[0].strings().al_state() == AlState::Op {
        assert!(targets < 2000, "slave 1 stays in OP");
        targets += 1;
        host.csp(1, targets);
        host.csp(1, targets + 1).cycle();
        targets += 1;
    }
    host.drained().until("OP", |host| host.state() == StateByte::reached(MasterState::Op)).cycles(100);
    let got = puppets[0].targets().iter().filter(|target| **target > 0).count() as u64;
    let after = host.counters();
    let counted = [
        after.for_lost - before.for_lost,
        after.outputs_lost - before.outputs_lost,
        after.discarded_before_enabled - before.discarded_before_enabled,
        after.cleared - before.cleared,
        after.full - before.full,
    ];
    let missing = targets as u64 - got;
    assert!(missing > 0 && counted.iter().sum::<u64>() >= missing, "{missing} are missing: {counted:?}");
}

/// XF-19.13 A chip that was started anew while the cable was cut finds all slaves once it is whole, and a board whose chip
/// has found none knows all the same how many there are.
#[test]
fn a_network_that_was_found_in_part_is_found_whole() {
    for reach in [0, 1] {
        let (puppets, handle) = ([Puppet::obedient(), Puppet::obedient()], SimHandle::default());
        let mut host = one_of_two_back(&puppets, &handle);
        handle.cut_after(reach);
        host.master(MasterCommand::SetState(MasterState::PreOp));
        host.until("PreOP or not", |host| host.board.engine().state().state() == Some(MasterState::PreOp));
        host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(2000).unwrap(), shift: DcShift::Auto });
        host.master(MasterCommand::SetState(MasterState::Op));
        host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
        handle.heal();
        handle.abort_object(2, None);
        host.go(MasterState::Op).servo_on(1).servo_on(2);
    }
}

/// XF-19.11 A slave that misses some cycles and answers again before its state is read is not lost, and the cycles are
/// counted.
#[test]
fn cycles_that_somebody_has_missed_are_counted() {
    let (puppet, handle) = (Puppet::obedient(), SimHandle::default());
    let bus = xf_bus_reached_by(vec![puppet.boxed()], handle.clone(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(1).servo_on(1).cycles(100);
    for n in 1..=200 {
        handle.silence(1, (100..103).contains(&n));
        host.csp(1, n).cycle();
    }
    host.drained().cycles(100);
    assert!(host.board.engine().lost().is_empty());
    let got = puppet.targets().iter().filter(|target| **target > 0).count() as u64;
    assert!(got < 200 && host.counters().outputs_lost >= 200 - got, "{got} have come, {:?}", host.counters());
}

/// XF-19.11 A slave that has left OP by itself while an SDO was under way is lost, though a change of all slaves begins before
/// that is seen.
#[test]
fn who_was_lost_before_a_change_is_counted() {
    let (puppets, handle) = ([Puppet::obedient(), Puppet::obedient()], SimHandle::default());
    let bus = xf_bus_reached_by(puppets.iter().map(Puppet::boxed).collect(), handle.clone(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(1).cycles(100);
    handle.delay_sdo(2, 300_000_000);
    host.sdo(SdoCommand::Read { slave: 2, object: ObjectAddress::new(0x1018, 1) }).cycles(20);
    handle.lose(1);
    for n in 1..=200 {
        host.csp(1, n).cycle();
    }
    host.master(MasterCommand::SetState(MasterState::PreOp));
    host.until("PreOP", |host| host.board.engine().state().state() == Some(MasterState::PreOp));
    let got = puppets[0].targets().iter().filter(|target| **target > 0).count() as u64;
    let counters = host.counters();
    assert!(counters.for_lost + counters.cleared >= 200 - got, "{got} have come, {counters:?}");
}

/// The job that brings the only slave to that state.
fn state(target: AlState) -> Job {
    Job::State { target, slaves: SlaveSet::first(1), timeout_ns: 10_000_000_000 }
}

/// The job that configures the only slave as a drive in CSP.
fn configure(cycle: CycleTime) -> Job {
    let drive = SlaveConfig { role: Role::Drive(Mode::Csp), sync: DriveSync::DcSync };
    Job::Configure(BusConfig { cycle, selected: SlaveSet::first(1), slaves: [drive; MAX_SLAVES] })
}

/// XF-19.13 After a job that is given up when the last slave has left OP, the bus still reports its cycles: the chip
/// has none in that state.
#[test]
fn cycles_are_told_behind_a_job_that_was_given_up() {
    let puppet = Puppet::obedient();
    let mut bus = xf_bus(vec![puppet.boxed()], XfBusOptions::DEFAULT);
    let mut times = (1..200_000).map(|n| n * 1_000_000);
    for job in
        [Job::Scan, state(AlState::PreOp), configure(CycleTime::DEFAULT), state(AlState::SafeOp), state(AlState::Op)]
    {
        bus.start(job, 0).unwrap();
        times.find_map(|now| bus.poll_job(now)).expect("it ends");
    }
    assert_eq!(puppet.strings().al_state(), AlState::Op);
    bus.start(state(AlState::PreOp), 0).unwrap();
    let mut inputs = Inputs::default();
    times.find(|now| bus.poll_job(*now).is_none() && puppet.strings().al_state() < AlState::Op).expect("it leaves OP");
    // The answer to that command, without a further step.
    times.next().map(|now| bus.poll_job(now));
    bus.cancel_job();
    let told = times.take(100).filter(|now| bus.poll(*now, &mut inputs).is_some()).count();
    assert!(told > 90, "{told} of 100");
}

/// XF-19.12 A chip that is reset while its packets get another size forgets its network unseen, since its check word is set anew
/// then: the next change of state fails, and the one behind it starts the network.
#[test]
fn a_reset_during_a_resize_is_seen() {
    // The packets of a chip's start are too short for the process data of that many slaves.
    const DRIVES: u8 = 12;
    let puppets: Vec<Puppet> = (0..DRIVES).map(|_| Puppet::obedient()).collect();
    let mut bus = xf_bus(puppets.iter().map(Puppet::boxed).collect(), XfBusOptions::DEFAULT);
    let mut now = 0;
    let mut ends = |bus: &mut XfBus<ChipLine<SlaveModels>>, job, resets: bool| {
        bus.start(job, now).unwrap();
        let (size, mut reset) = (bus.host().size(), false);
        (0..200_000).find_map(|_| {
            now += 100_000;
            if resets && !reset && bus.host().size() != size {
                reset = true;
                reset_chip(bus.wires_mut().chip(), now);
            }
            bus.poll_job(now)
        })
    };
    let slaves = SlaveSet::first(DRIVES);
    let state = |target| Job::State { target, slaves, timeout_ns: 10_000_000_000 };
    let Job::Configure(config) = configure(CycleTime::DEFAULT) else { panic!("it is one") };
    let configure = Job::Configure(BusConfig { selected: slaves, ..config });
    for job in [Job::Scan, state(AlState::PreOp)] {
        ends(&mut bus, job, false).expect("it ends");
    }
    ends(&mut bus, configure, true).expect("it ends");
    let done = ends(&mut bus, state(AlState::SafeOp), false);
    assert!(matches!(done, Some(JobDone::State(Err(_)))), "{done:?}");
    for job in [state(AlState::PreOp), configure, state(AlState::SafeOp)] {
        let done = ends(&mut bus, job, false);
        assert!(matches!(done, Some(JobDone::State(Ok(())) | JobDone::Configure(Ok(_)))), "{done:?}");
    }
    assert_eq!(puppets[0].strings().al_state(), AlState::SafeOp);
}

/// XF-19.12 A chip that was reset between a configuration and the change of state behind it has no process data any more: the
/// change fails, and no slave is brought to OP without them.
#[test]
fn no_slave_goes_to_op_without_process_data() {
    let puppet = Puppet::obedient();
    let mut bus = xf_bus(vec![puppet.boxed()], XfBusOptions::DEFAULT);
    let (mut now, cut) = (0, bus.wires().cut.clone());
    let mut pass = |bus: &mut XfBus<ChipLine<SlaveModels>>, cycles| {
        (0..cycles).find_map(|_| {
            now += 1_000_000;
            bus.poll_job(now)
        })
    };
    for job in [Job::Scan, state(AlState::PreOp), configure(CycleTime::DEFAULT)] {
        bus.start(job, 0).unwrap();
        pass(&mut bus, 20_000).expect("it ends");
    }
    cut.store(true, Ordering::Relaxed);
    pass(&mut bus, 5000);
    cut.store(false, Ordering::Relaxed);
    pass(&mut bus, 5000);
    bus.start(state(AlState::SafeOp), 0).unwrap();
    let done = pass(&mut bus, 20_000);
    assert!(matches!(done, Some(JobDone::State(Err(_)))), "{done:?}");
    assert_eq!(puppet.strings().al_state(), AlState::PreOp);
}

/// XF-19.12 A chip that is reset while one slave is being brought back has lost the configuration of the others, too: they are
/// lost, and none of them goes to OP without process data.
#[test]
fn who_was_configured_before_a_reset_is_configured_again() {
    let (puppets, handle) = ([Puppet::obedient(), Puppet::obedient()], SimHandle::default());
    let slaves = puppets.iter().map(Puppet::boxed).collect();
    let bus = xf_bus_reached_by(slaves, handle.clone(), XfBusOptions::DEFAULT);
    let cut = bus.wires().cut.clone();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.declare_drives(2).go(MasterState::SafeOp);
    handle.lose(2);
    host.until("the loss", |host| host.state().is_failed());
    handle.find(2);
    host.master(MasterCommand::SetState(MasterState::Op)).cycles(2);
    cut.store(true, Ordering::Relaxed);
    host.cycles(4000);
    cut.store(false, Ordering::Relaxed);
    for _ in 0..20 {
        if host.state() != StateByte::reached(MasterState::Op) {
            host.master(MasterCommand::SetState(MasterState::Op)).cycles(2000);
        }
    }
    host.servo_on(1).servo_on(2).csp(1, 10).csp(2, 20).drained().cycles(30);
    assert_eq!([puppets[0].last().target, puppets[1].last().target], [10, 20]);
}
