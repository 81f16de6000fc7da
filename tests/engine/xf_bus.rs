//! The board over an ECM-XF: a program sees the same as on the simulated bus.

use ecmsk::cia402::DriveState;
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveCommand, StateByte};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use support::chip_line::xf_bus;

use crate::host::Host;

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

/// XF-18.1 A program that moves drives over the simulated bus moves them to the same place over an ECM-XF.
#[test]
fn a_program_ends_in_the_same_place() {
    let expected = program(&mut Host::new(EngineConfig::default(), SimBus::new(drives(2))));
    let mut host = over_xf(drives(2));
    assert_eq!(program(&mut host), expected);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
}
