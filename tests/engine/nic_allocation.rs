//! A program on a network card causes no allocation, once its slaves were found and configured.

use allocation_counter::measure;
use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, SdoSize};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::nic::{ChainWires, NicBus, NicWires, Ring};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::master::Settings;
use ecmsk::sk::{DriveSync, MasterCommand, MasterState, SlaveCommand, StateByte};
use ecmsk::slave::{DeviceFault, Fault};

use crate::host::Host;

const DRIVES: usize = 40;

#[track_caller]
fn allocates_nothing(what: &str, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!((counted.count_total, counted.count_current), (0, 0), "{what}: {counted:?}");
}

fn go(host: &mut Host, state: MasterState) {
    host.master(MasterCommand::SetState(state));
    let mut cycles = 0;
    while host.state() != StateByte::reached(state) {
        host.cycle();
        cycles += 1;
        assert!(cycles < 30_000, "{state:?} is not reached: {:?}", host.state());
    }
}

/// Neither a change of state of 40 drives, nor an SDO that ends, is aborted, has no answer or is given up, nor an emergency, nor a cable
/// that is cut and slaves that were without power, and their way back allocate anything, on one card or in a ring.
#[test]
fn what_a_program_causes_allocates_nothing() {
    for is_ring in [false, true] {
        let network = SimHandle::default();
        let mut wires = ChainWires::new(crate::probe::drives(DRIVES), network.clone()).expect("they have an EEPROM");
        if is_ring {
            wires.connect_second(true);
            jobs_allocate_nothing(Ring::new(wires, [4; 6]), &network);
        } else {
            jobs_allocate_nothing(wires, &network);
        }
    }
}

fn jobs_allocate_nothing(wires: impl NicWires + Send + 'static, network: &SimHandle) {
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.declare_drives(DRIVES);
    for slave in 1..=DRIVES {
        host.slave(slave, SlaveCommand::DriveMode { mode: Mode::Csp, sync: DriveSync::DcSync });
    }
    allocates_nothing("the first way to OP", || go(&mut host, MasterState::Op));
    for state in [MasterState::SafeOp, MasterState::Op, MasterState::PreOp, MasterState::Op] {
        allocates_nothing("a change of state", || go(&mut host, state));
    }
    allocates_nothing("SDOs", || {
        assert_eq!(host.write_object(2, 0x6065, 0, SdoSize::Four, 99), Ok(99));
        assert_eq!(host.read_object(2, 0x6065, 0), Ok(99));
        assert!(host.read_object(3, 0x1008, 0).is_ok(), "the beginning of a name");
        assert_eq!(host.read_object(4, 0x5555, 0), Err(AbortCode::NO_OBJECT));
        assert!(host.write_object(2, 0x6065, 0, SdoSize::One, 99).is_err());
    });
    network.apply_fault(5, Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x2310, resettable: true } });
    allocates_nothing("an emergency", || {
        host.cycles(100);
    });
    assert_eq!(host.drive(5).error_code, 0x2310);
    network.delay_sdo(6, 20_000_000_000);
    allocates_nothing("an SDO without an answer", || {
        assert_eq!(host.read_object(6, 0x6065, 0), Err(AbortCode::TIMEOUT));
    });
    network.delay_sdo(6, 0);
    allocates_nothing("a change that is given up", || {
        host.master(MasterCommand::SetState(MasterState::PreOp)).cycles(30);
        go(&mut host, MasterState::Op);
    });
    allocates_nothing("slaves that are lost", || {
        network.cut_after(20);
        network.lose(3);
        host.cycles(500);
        network.heal();
        network.find(3);
        host.cycles(500);
        go(&mut host, MasterState::Op);
    });
    allocates_nothing("all were without power", || {
        (1..=DRIVES as u8).for_each(|slave| network.lose(slave));
        host.cycles(300);
        (1..=DRIVES as u8).for_each(|slave| network.find(slave));
        host.cycles(2000);
        go(&mut host, MasterState::Op);
    });
    allocates_nothing("OP again", || {
        host.cycles(100);
    });
}
