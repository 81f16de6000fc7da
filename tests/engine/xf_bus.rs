//! The board over an ECM-XF: a program sees the same as on the simulated bus.

use ecmsk::cia402::DriveState;
use ecmsk::engine::{EngineConfig, StateFailure};
use ecmsk::fieldbus::HardwareLimit;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::sk::{CycleTime, DcShift, FifoAction, MasterCommand, MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::Slave;
use support::chip_line::xf_bus;

use crate::host::Host;
use crate::probe::drives;
use crate::puppet::Puppet;

fn over_xf(slaves: Vec<Box<dyn Slave>>) -> Host {
    Host::new(EngineConfig::default(), xf_bus(slaves, XfBusOptions::DEFAULT))
}

fn program(host: &mut Host) -> [(u8, i32, u16); 2] {
    host.declare_drives(2);
    host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(2000).unwrap(), shift: DcShift::Auto });
    host.go(MasterState::Op).drained().servo_on(1).servo_on(2);
    for n in 1..=300 {
        host.csp(1, n * 3).until("room", |host| host.answer().fifo_free > 20);
    }
    host.csp(2, -5000).drained().slave(1, SlaveCommand::ServoOff).cycles(300);
    assert_eq!(host.drive(1).statusword.state(), Some(DriveState::SwitchOnDisabled));
    [1, 2].map(|slave| {
        let drive = host.drive(slave);
        (drive.head.id, drive.position, drive.statusword.0)
    })
}

/// XF-19.1 A program that moves drives over the simulated bus moves them to the same place over an ECM-XF.
#[test]
fn a_program_ends_in_the_same_place() {
    let expected = program(&mut Host::new(EngineConfig::default(), SimBus::new(drives(2))));
    let mut host = over_xf(drives(2));
    assert_eq!(program(&mut host), expected);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
}

/// XF-19.3 The first target of a drive in OP is its actual position, with its motor off.
#[test]
fn op_begins_where_the_axis_is() {
    let puppet = Puppet::new();
    puppet.strings().shows.position = 77_000;
    let mut host = over_xf(vec![puppet.boxed()]);
    host.op(1).cycles(20);
    let first = puppet.strings().sent[0];
    assert_eq!((first.controlword.0, first.target), (0, 77_000));
    assert_eq!(puppet.targets(), [77_000]);
}

/// XF-19.5 Forty drives get a target in every cycle, for as long as the program sends one: the chip is set to packets that
/// carry more than one set of outputs.
#[test]
fn forty_drives_are_led_in_every_cycle() {
    let puppets: Vec<Puppet> = (0..40).map(|_| Puppet::obedient()).collect();
    let mut host = over_xf(puppets.iter().map(Puppet::boxed).collect());
    host.op(40);
    for slave in 1..=40 {
        host.servo_on(slave);
    }
    host.drained();
    let target = |host: &mut Host, n| {
        host.build(|frame, size| {
            (1..=40).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n)).into()));
        });
    };
    (1..=8).for_each(|n| target(&mut host, n));
    for n in 9..=3000 {
        target(&mut host, n);
        host.cycle();
    }
    host.drained().cycles(20);
    assert_eq!((host.counters().full, host.counters().outputs_lost), (0, 0));
    for (n, puppet) in puppets.iter().enumerate() {
        let sent = puppet.strings().sent.clone();
        let moves =
            sent.iter().map(|out| out.target).skip_while(|target| *target < 1).take_while(|target| *target < 3000);
        assert!(moves.eq(1..3000), "slave {}: each target once and in order, without a pause", n + 1);
    }
}

/// XF-19.5 A cycle that the packets of 40 drives are too slow for is refused, with the time that they take; a longer
/// cycle works then.
#[test]
fn a_cycle_that_cannot_be_held_is_refused() {
    let mut host = over_xf(drives(40));
    host.declare_drives(40);
    let set_dc = |us| MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto };
    host.master(set_dc(250)).master(MasterCommand::SetState(MasterState::Op));
    host.until("the refusal", |host| host.state().is_failed());
    let failure = host.board.engine().state_failure().expect("it says why");
    let StateFailure::Hardware(HardwareLimit::Cycle { cycle_ns: 250_000, needed_ns }) = failure else {
        panic!("{failure:?}")
    };
    assert!((250_001..1_000_000).contains(&needed_ns), "{needed_ns}");
    let said = failure.to_string();
    assert!(said.contains("a cycle of 250 us") && said.contains("SET_DC") && said.contains("speed="), "{said}");
    host.master(set_dc(1000)).go(MasterState::Op);
}

/// XF-19.6 A program that sends more sets than the chip's limit has at most that many in it, and 6 for the transport.
#[test]
fn no_more_than_ahead_lie_in_the_chip() {
    for ahead in [1, 4, 8, 20] {
        let puppet = Puppet::obedient();
        let options = XfBusOptions { ahead, ..XfBusOptions::DEFAULT };
        let mut host = Host::new(EngineConfig::default(), xf_bus(vec![puppet.boxed()], options));
        host.op(1).servo_on(1).drained();
        for n in 1..=150 {
            host.csp(1, n);
        }
        host.cycles(40);
        puppet.forget();
        // The board's FIFO is held, so that it passes no more outputs: later cycles execute those in the chip.
        host.board.handle().hold_fifo(true);
        host.cycles(60);
        let first = puppet.strings().sent[0].target;
        let last = puppet.last().target;
        let ahead = i32::from(ahead);
        assert!((ahead..=ahead + 6).contains(&(last - first)), "ahead {ahead}: {first} to {last}");
    }
}

/// XF-19.7 A frame that switches outputs off and asks for a lower state: the outputs go off first.
#[test]
fn what_was_taken_is_sent_before_slaves_leave_op() {
    let puppet = Puppet::new();
    let mut host = over_xf(vec![puppet.boxed()]);
    host.go(MasterState::Op).cycles(5).slave(1, SlaveCommand::IoWrite(0xFFFF)).drained();
    assert_eq!(puppet.last().outputs, 0xFFFF);
    host.build(|frame, size| {
        frame.put_master(size, &MasterCommand::SetState(MasterState::SafeOp));
        frame.put_slave(size, 1, &SlaveCommand::IoWrite(0).into());
    });
    host.until("SafeOP", |host| host.state() == StateByte::reached(MasterState::SafeOp));
    assert_eq!(puppet.last().outputs, 0);
}

/// XF-19.10 A program that sends a frame with each report while it waits for SV_ON finds hardly any of them in the FIFO
/// afterwards: later frames do not stay late for ever.
#[test]
fn waiting_for_servo_on_fills_no_fifo() {
    let mut host = over_xf(drives(2));
    host.op(2).slave(1, SlaveCommand::ServoOn).slave(2, SlaveCommand::ServoOn);
    let mut reports = host.reports;
    while !(host.drive(1).statusword.is_enabled() && host.drive(2).statusword.is_enabled()) {
        host.cycle();
        while reports < host.reports {
            host.idle();
            reports += 1;
        }
    }
    host.cycles(10);
    assert!(host.answer().fifo_free > 150, "{}", host.answer().fifo_free);
}

/// XF-19.6 More sets than the chip's RxFIFO has entries are kept by the bus, also where packets of another size were set up
/// behind the entries: 25 of 40 drives.
#[test]
fn more_ahead_than_the_chip_has_entries() {
    let puppet = Puppet::obedient();
    let mut slaves = drives(39);
    slaves.push(puppet.boxed());
    let options = XfBusOptions { ahead: 60, ..XfBusOptions::DEFAULT };
    let mut host = Host::new(EngineConfig::default(), xf_bus(slaves, options));
    host.op(40).servo_on(40).drained();
    puppet.forget();
    for n in 1..=150 {
        host.csp(40, n);
    }
    host.drained().cycles(20);
    assert_eq!(puppet.targets(), (0..=150).collect::<Vec<_>>());
    assert_eq!((host.counters().full, host.counters().outputs_lost), (0, 0));
}

/// XF-19.2 SK-12.1 SK-12.2 A clear stops the chip's FIFO while cycles go on: outputs in it then count as cleared, and
/// not as executed by those cycles.
#[test]
fn what_a_clear_has_stopped_counts_as_cleared() {
    for (ahead, cycles) in [(8, 5), (20, 12), (60, 40), (60, 63)] {
        let puppet = Puppet::obedient();
        let options = XfBusOptions { ahead, ..XfBusOptions::DEFAULT };
        let mut host = Host::new(EngineConfig::default(), xf_bus(vec![puppet.boxed()], options));
        host.op(1).servo_on(1).drained();
        puppet.forget();
        let before = host.counters();
        for n in 1..=150 {
            host.csp(1, n);
        }
        host.cycles(cycles).master(MasterCommand::SetFifo(FifoAction::Clear)).drained().cycles(80);
        // The frame with the clear is itself executed.
        let executed = (host.counters().executed - before.executed) as i32 - 1;
        let newest = puppet.last().target;
        assert_eq!(newest, executed, "ahead {ahead}, cleared after {cycles} cycles");
        assert_eq!(host.counters().cleared - before.cleared, 150 - newest as u64);
    }
}

/// SK-12.11 Whenever an SV_OFF and an SV_ON come while an SV_ON is under way beside an axis in motion, so that the chip
/// has sets with older steps: the drive is enabled at most once by each SV_ON, and off again at most once by the
/// SV_OFF.
#[test]
fn an_enabled_drive_stays_enabled() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let bus = xf_bus(puppets.iter().map(Puppet::boxed).collect(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(1);
    let mut target = 0;
    let mut follow = |host: &mut Host, cycles: usize| {
        for _ in 0..cycles {
            if host.answer().fifo_free > 150 {
                target += 1;
                host.csp(1, target);
            }
            host.cycle();
        }
    };
    for off_after in 1..=20 {
        for on_after in 1..=20 {
            puppets[1].forget();
            host.slave(2, SlaveCommand::ServoOn);
            follow(&mut host, off_after);
            host.slave(2, SlaveCommand::ServoOff);
            follow(&mut host, on_after);
            host.slave(2, SlaveCommand::ServoOn);
            follow(&mut host, 150);
            let enabled: Vec<bool> = puppets[1].controlwords().iter().map(|word| word & 0xF == 0xF).collect();
            let ends = enabled.windows(2).filter(|pair| pair[0] && !pair[1]).count();
            assert!(ends <= 1, "{off_after} and {on_after} cycles: {:?}", puppets[1].controlwords());
            assert_eq!(enabled.last(), Some(&true), "{off_after} and {on_after} cycles");
            host.slave(2, SlaveCommand::ServoOff);
            follow(&mut host, 150);
        }
    }
}
