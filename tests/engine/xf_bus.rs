//! The board over an ECM-XF: a program sees the same as on the simulated bus.

use ecmsk::cia402::DriveState;
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::AlState;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveCommand, StateByte};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use support::chip_line::{xf_bus, xf_bus_reached_by};

use crate::host::Host;
use crate::puppet::Puppet;

fn drives(count: usize) -> Vec<Box<dyn Slave>> {
    (0..count).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

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

/// XF-19.3 What a drive gets first in OP is the position where it is, with its motor off.
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

/// XF-19.4 A slave that was lost comes back; the other one goes on in OP meanwhile, and misses no target.
#[test]
fn who_comes_back_disturbs_nobody() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let handle = SimHandle::default();
    let bus = xf_bus_reached_by(puppets.iter().map(Puppet::boxed).collect(), handle.clone(), XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(1).servo_on(2);
    handle.lose(2);
    host.until("the loss", |host| host.state() == StateByte::failed(Some(MasterState::Op)));
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
