//! ALM_CLR: the fault reset of a drive, and its limits.

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{FifoAction, Frame, MasterCommand, SlaveCommand};
use ecmsk::slave::{DeviceFault, Drive, DriveConfig, Fault};

use crate::drives::board;
use crate::host::Host;
use crate::probe::{Bench, drives};
use crate::puppet::{DISABLED, ENABLED, FAULT, FAULT_REACTION, NOT_READY, Puppet, QUICK_STOP, READY, SWITCHED_ON};
use crate::rig::ahead;
use support::ahead_bus::AheadBus;

const BIT_7: u16 = 0x80;

fn alarm_clear(host: &mut Host) -> &mut Host {
    host.slave(1, SlaveCommand::AlarmClear)
}

/// How often bit 7 has risen in the outputs from number `from` on.
fn edges(puppet: &Puppet, from: usize) -> usize {
    let words: Vec<bool> = puppet.strings().sent.iter().map(|out| out.controlword.0 & BIT_7 != 0).collect();
    words[from..].windows(2).filter(|pair| !pair[0] && pair[1]).count()
}

fn sets(puppet: &Puppet) -> usize {
    puppet.strings().sent.len()
}

fn state(host: &Host) -> DriveState {
    host.drive(1).statusword.state().expect("a state")
}

/// A drive that was on and is in Fault now.
fn faulted(host: &mut Host, network: &SimHandle, resettable: bool) {
    host.servo_on(1).cycles(5);
    network.apply_fault(1, Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x2310, resettable } });
    host.until("Fault", |host| state(host) == DriveState::Fault);
    assert_eq!(host.drive(1).error_code, 0x2310);
}

/// SK-7.11 ALM_CLR is a rising edge of controlword bit 7: the bit is clear before and after it, and nothing else is set.
/// SK-4.19 It takes one entry and is answered with the drive's slot.
#[test]
fn alarm_clear_is_a_rising_edge() {
    for fault in [FAULT, FAULT_REACTION] {
        let (mut host, puppet) = board();
        puppet.show(fault);
        host.cycles(5);
        puppet.forget();
        let executed = host.counters().executed;
        host.cycles(20);
        assert_eq!(puppet.controlwords(), [0x00], "the board does nothing by itself");
        host.build(|frame, size| frame.put_slave(size, 1, &SlaveCommand::AlarmClear.with_index(0x42))).cycles(100);
        assert_eq!(puppet.controlwords(), [0x00, BIT_7, 0x00], "{fault:04x}");
        assert_eq!(host.counters().executed, executed + 1, "one entry");
        let slot = host.drive(1);
        assert_eq!((slot.head.id, slot.head.index, slot.statusword), (0x10, 0x42, Statusword(fault)));
        assert_eq!(slot.position, 1000);
    }
}

/// SK-7.11 Every ALM_CLR is an edge of its own, and one that comes soon after another makes one, too.
#[test]
fn alarm_clear_works_again() {
    for gap in 0..40 {
        let (mut host, puppet) = board();
        puppet.show(FAULT);
        host.cycles(5);
        alarm_clear(&mut host).cycles(gap);
        let from = sets(&puppet).saturating_sub(1);
        alarm_clear(&mut host).cycles(60);
        assert!(edges(&puppet, from) >= 1, "{gap} cycles later");
        assert_eq!(puppet.last().controlword.0, 0x00, "{gap} cycles later");
    }
    let (mut host, puppet) = board();
    puppet.show(FAULT);
    host.cycles(5);
    for n in 1..=10 {
        alarm_clear(&mut host).cycles(50);
        assert_eq!(edges(&puppet, 0), n);
    }
    // ALM_CLR in every frame, as from a program that waits for the end of the fault.
    let from = sets(&puppet);
    for _ in 0..200 {
        alarm_clear(&mut host).cycle();
    }
    assert!(edges(&puppet, from) >= 10, "{}", edges(&puppet, from));
}

/// SK-7.11 Without a fault it has no effect: a walk of SV_ON goes on, a drive that is on holds its target, one that is
/// off stays off, and a fault that comes later is not reset.
#[test]
fn without_a_fault_alarm_clear_has_no_effect() {
    let (mut host, puppet) = board();
    for statusword in [NOT_READY, DISABLED, READY, SWITCHED_ON, QUICK_STOP] {
        puppet.show(statusword);
        host.cycles(3);
        alarm_clear(&mut host).cycles(20);
        assert_eq!(puppet.controlwords(), [0x00], "{statusword:04x}");
    }
    puppet.show(DISABLED);
    host.cycles(3).slave(1, SlaveCommand::ServoOn).cycles(3);
    let mut words = vec![0x00, 0x06];
    for (shown, asked) in [(READY, 0x07), (SWITCHED_ON, 0x0F), (ENABLED, 0x0F)] {
        puppet.show(shown);
        alarm_clear(&mut host).cycles(5);
        words.push(asked);
        words.dedup();
        assert_eq!(puppet.controlwords(), words, "a walk at {shown:04x}");
    }
    host.csp(1, 1234).drained();
    puppet.forget();
    for _ in 0..50 {
        alarm_clear(&mut host).cycle();
    }
    assert_eq!((puppet.controlwords(), puppet.targets()), (vec![0x0F], vec![1234]));
    host.csp(1, 1300).drained();
    assert_eq!(puppet.last().target, 1300, "it follows on");
    alarm_clear(&mut host).drained();
    puppet.show(FAULT);
    host.cycles(100);
    assert_eq!(edges(&puppet, 0), 0, "it is not kept for later");
    assert_eq!(host.counters().rejected_total(), 0);
}

/// SK-7.11 A drive in Fault goes to Switch on disabled, and its error code is cleared. The motor stays off, however
/// often ALM_CLR comes, also if it was on or an SV_ON came in the fault; a new SV_ON starts it. SK-7.9 SV_ON alone
/// resets nothing.
#[test]
fn alarm_clear_resets_a_fault_and_starts_no_motor() {
    for (before, times) in [(false, 1), (false, 30), (true, 1), (true, 30)] {
        let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(1));
        host.op(1);
        faulted(&mut host, &network, true);
        host.cycles(100);
        assert_eq!(state(&host), DriveState::Fault, "it stays until ALM_CLR");
        if before {
            host.slave(1, SlaveCommand::ServoOn).cycles(100);
            assert_eq!(state(&host), DriveState::Fault);
        }
        for _ in 0..times {
            alarm_clear(&mut host).cycle();
        }
        host.until("the reset", |host| state(host) == DriveState::SwitchOnDisabled);
        assert_eq!(host.drive(1).error_code, 0);
        for _ in 0..500 {
            host.cycle();
            assert_eq!(state(&host), DriveState::SwitchOnDisabled, "no motor starts by itself");
        }
        let position = host.drive(1).position;
        host.servo_on(1).csp(1, position + 50).drained().cycles(100);
        assert_eq!(host.drive(1).position, position + 50);

        // A second fault, a second reset.
        faulted(&mut host, &network, true);
        alarm_clear(&mut host);
        host.until("the second reset", |host| state(host) == DriveState::SwitchOnDisabled);
        assert_eq!(host.counters().rejected_total(), 0);
    }
}

/// SK-7.12 ALM_CLR does not clear every alarm: one that the drive keeps stays, with its error code, and the drive off.
#[test]
fn alarm_clear_does_not_clear_every_alarm() {
    let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(1));
    host.op(1);
    faulted(&mut host, &network, false);
    for _ in 0..20 {
        alarm_clear(&mut host).cycles(30);
        host.slave(1, SlaveCommand::ServoOn).cycles(30);
        assert_eq!((state(&host), host.drive(1).error_code), (DriveState::Fault, 0x2310));
    }
    assert_eq!(host.counters().rejected_total(), 0);
}

/// SK-7.11 A program that sends ALM_CLR in each frame until the fault is gone, and then SV_ON, succeeds on every bus.
#[test]
fn a_program_gets_out_of_a_fault_on_every_bus() {
    for how in ahead() {
        let bus = SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]);
        let network = bus.handle();
        let mut host = Host::new(EngineConfig::default(), AheadBus::new(bus, how));
        host.op(1);
        faulted(&mut host, &network, true);
        for _ in 0..500 {
            if state(&host) != DriveState::Fault {
                break;
            }
            alarm_clear(&mut host).cycle();
        }
        host.drained();
        assert_eq!(state(&host), DriveState::SwitchOnDisabled, "{how:?}");
        host.servo_on(1);
    }
}

/// SK-5.22 An ALM_CLR that the bus has taken ahead when the FIFO is cleared has no effect; SK-7.11 an ALM_CLR under way
/// ends, and the next one works.
#[test]
fn clear_takes_back_an_alarm_clear() {
    for how in ahead() {
        for (behind, under_way) in [(0, false), (4, false), (60, false), (4, true), (60, true)] {
            let puppet = Puppet::new();
            let mut host = Host::new(EngineConfig::default(), AheadBus::new(SimBus::new(vec![puppet.boxed()]), how));
            host.op(1);
            puppet.show(FAULT);
            host.cycles(50);
            puppet.forget();
            let idle = Frame::new();
            for _ in 0..40 {
                host.arrive(&idle);
            }
            let mut frame = Frame::new();
            frame.put_slave(host.size, 1, &SlaveCommand::AlarmClear.into());
            host.arrive(&frame);
            for _ in 0..behind {
                host.arrive(&idle);
            }
            if under_way {
                host.until("the edge", |_| edges(&puppet, 0) == 1);
            } else {
                host.cycles(10);
            }
            host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(200);
            let words: &[u16] = if under_way { &[0x00, BIT_7, 0x00] } else { &[0x00] };
            assert_eq!(puppet.controlwords(), words, "{how:?}, {behind} entries behind");
            puppet.forget();
            host.cycles(2);
            alarm_clear(&mut host).cycles(200);
            assert_eq!(puppet.controlwords(), [0x00, BIT_7, 0x00], "{how:?}");
        }
    }
}

/// SK-7.11 The bit falls as soon as the fault is gone: the walk of an SV_ON right after the reset is not held up, however
/// many ALM_CLR came.
#[test]
fn the_bit_falls_with_the_fault() {
    for times in 1..=4 {
        let (mut host, puppet) = board();
        puppet.show(FAULT);
        host.cycles(5);
        for _ in 0..times {
            alarm_clear(&mut host).cycle();
        }
        assert_eq!(puppet.last().controlword.0, BIT_7);
        puppet.show(DISABLED);
        // A cycle shows the statusword, the next one carries what follows from it.
        host.cycle();
        puppet.forget();
        host.slave(1, SlaveCommand::ServoOn).cycles(3);
        for statusword in [READY, SWITCHED_ON, ENABLED] {
            puppet.show(statusword);
            host.cycles(30);
        }
        assert_eq!(puppet.controlwords(), [0x00, 0x06, 0x07, 0x0F], "{times} times");
    }
}

/// SK-7.11 The other drives of the network are not touched.
#[test]
fn alarm_clear_is_for_one_drive() {
    let puppets = [Puppet::new(), Puppet::new()];
    let mut host = Host::new(EngineConfig::default(), SimBus::new(puppets.iter().map(Puppet::boxed).collect()));
    host.op(2);
    puppets.iter().for_each(|puppet| puppet.show(FAULT));
    host.cycles(5);
    puppets.iter().for_each(Puppet::forget);
    host.slave(2, SlaveCommand::AlarmClear).cycles(100);
    assert_eq!((edges(&puppets[0], 0), puppets[0].controlwords()), (0, vec![0x00]));
    assert!(puppets[1].controlwords().contains(&BIT_7));
}
