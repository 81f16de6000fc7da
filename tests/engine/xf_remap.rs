//! Slaves behind an ECM-XF that fall back to their default process data when the chip lays these out by RECONFIG_OP (2):
//! the manual tells to use CONFIG_MAP (73) then (ecm-xf, "Settled").

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::sk::{DriveSync, MasterCommand, MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, Wires};
use ecmsk::xf::{CommandCode, HEADER_LEN};
use support::chip_line::ChipLine;

use crate::host::Host;

/// How often the chip got each of the two commands, and how often that made the slaves fall back.
#[derive(Default)]
struct Layouts {
    reconfig: AtomicU32,
    config_map: AtomicU32,
    fallen: AtomicU32,
}

/// The commands by which slaves fall back.
const NONE: &[CommandCode] = &[];
const RECONFIG: &[CommandCode] = &[CommandCode::Reconfig];
const BOTH: &[CommandCode] = &[CommandCode::Reconfig, CommandCode::ConfigMap];

/// Wires that see these commands.
struct Seen {
    wires: ChipLine<SlaveModels>,
    by: &'static [CommandCode],
    layouts: Arc<Layouts>,
    newest: (u8, u8),
}

impl Wires for Seen {
    type Error = Infallible;

    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Infallible> {
        if to_chip.len() > HEADER_LEN {
            let packet = (to_chip[0x0B], to_chip[0x0C]);
            if std::mem::replace(&mut self.newest, packet) != packet {
                let code = CommandCode::from_code(packet.1);
                match code {
                    CommandCode::Reconfig => self.layouts.reconfig.fetch_add(1, Ordering::Relaxed),
                    CommandCode::ConfigMap => self.layouts.config_map.fetch_add(1, Ordering::Relaxed),
                    _ => 0,
                };
                if self.by.contains(&code) {
                    self.layouts.fallen.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
        self.wires.exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), Infallible> {
        self.wires.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, Infallible> {
        self.wires.wait_ready(until)
    }
}

/// A drive that assigns its default RxPDO, 0x1600, when it falls back.
struct Falling {
    drive: Drive,
    layouts: Arc<Layouts>,
    fallen: u32,
    complete_access: bool,
}

impl Falling {
    fn fall(&mut self) {
        let fallen = self.layouts.fallen.load(Ordering::Relaxed);
        if std::mem::replace(&mut self.fallen, fallen) != fallen {
            for (sub, value) in [(0, &[0][..]), (1, &[0x00, 0x16]), (0, &[1])] {
                let _ = self.drive.write(ObjectAddress::new(0x1C12, sub), SdoScope::Entry, value);
            }
        }
    }
}

impl Slave for Falling {
    support::hand_on_slave!(drive: name, state, enter, set_sync_managers, step, begin_step, end_step, has_dc, shaft);

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        self.fall();
        if scope == SdoScope::Complete && !self.complete_access {
            return Err(AbortCode::COMPLETE_ACCESS);
        }
        self.drive.read(object, scope, value)
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.fall();
        self.drive.write(object, scope, value)
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.drive.exchange(outputs, inputs);
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        self.drive.set_sync_cycle(cycle_ns);
    }
}

/// A board over a chip with two such drives. The first one is declared in `mode`, the second one in CSP, `rest` cycles
/// before SET_STATE.
fn declared(by: &'static [CommandCode], complete_access: bool, mode: Mode, rest: usize) -> (Host, Arc<Layouts>) {
    let layouts = Arc::<Layouts>::default();
    let drive = || -> Box<dyn Slave> {
        let drive = Drive::new(DriveConfig::default());
        Box::new(Falling { drive, layouts: Arc::clone(&layouts), fallen: 0, complete_access })
    };
    let line = ChipLine::new(Chip::new(Profile::NEW, SlaveModels::new(vec![drive(), drive()])));
    let wires = Seen { wires: line, by, layouts: Arc::clone(&layouts), newest: (0, 0) };
    let options = XfBusOptions { clock_hz: Some(24_000_000), ..XfBusOptions::DEFAULT };
    let config = HostConfig { size: Some(Profile::NEW.size), ..HostConfig::DEFAULT };
    let mut host = Host::new(EngineConfig::default(), XfBus::new(wires, config, options));
    host.declare_drives(2).slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync }).cycles(rest);
    (host, layouts)
}

/// The RxPDOs that both drives have assigned.
fn assigned(host: &mut Host) -> [Result<u32, AbortCode>; 2] {
    [1, 2].map(|slave| {
        // Another answer first, so that the slot does not show the wanted one already.
        let _ = host.read_object(slave, 0x1000, 0);
        host.read_object(slave, 0x1C12, 1)
    })
}

const RESTS: [usize; 3] = [0, 60, 500];

/// XF-19.16 A drive in CSV, whose PDO is as long as the default one, gets its velocity, and none as a position: it has its
/// PDO in SafeOP, also when SafeOP is entered again, whether the network was prepared or not. Then 73 lays out the process
/// data. A drive whose mapping stays is laid out by 2 alone.
#[test]
fn a_drive_that_falls_back_has_its_process_data() {
    for by in [NONE, RECONFIG] {
        for (complete_access, rest) in [true, false].into_iter().flat_map(|whole| RESTS.map(|rest| (whole, rest))) {
            let what = format!("{by:?} {complete_access} {rest}");
            let (mut host, layouts) = declared(by, complete_access, Mode::Csv, rest);
            for _ in 0..2 {
                host.go(MasterState::SafeOp);
                assert_eq!(assigned(&mut host), [Ok(0x1601), Ok(0x1600)], "{what}");
                host.go(MasterState::PreOp).cycles(rest);
            }
            host.go(MasterState::Op).drained().servo_on(1).servo_on(2).drained();
            host.slave(1, SlaveCommand::Csv(Motion::to(20_000))).csp(2, 3000).drained().cycles(500);
            let positions = [1, 2].map(|slave| host.drive(slave).position);
            assert!((5000..15_000).contains(&positions[0]), "{what}: {positions:?}");
            assert!((2900..3100).contains(&positions[1]), "{what}: {positions:?}");
            let [reconfig, config_map] =
                [&layouts.reconfig, &layouts.config_map].map(|count| count.load(Ordering::Relaxed));
            assert!(reconfig > 0, "{what}");
            assert_eq!(config_map > 0, !by.is_empty(), "{what}: {reconfig}, {config_map}");
        }
    }
}

/// XF-19.16 A drive in CST, whose PDO is shorter than the default one, comes to OP although it falls back.
#[test]
fn a_drive_that_falls_back_to_another_length_comes_to_op() {
    for rest in RESTS {
        let (mut host, layouts) = declared(RECONFIG, true, Mode::Cst, rest);
        for _ in 0..2 {
            host.go(MasterState::Op).drained().servo_on(1).drained();
            host.go(MasterState::PreOp);
            assert_eq!(assigned(&mut host), [Ok(0x1602), Ok(0x1600)], "{rest}");
        }
        let reconfigs = layouts.reconfig.load(Ordering::Relaxed);
        assert!(reconfigs <= 2, "{rest}: what falls back once is not laid out by 2 again: {reconfigs}");
    }
}

/// XF-19.16 A drive that falls back with both commands is never led with another object's outputs: SafeOP is refused.
#[test]
fn a_drive_that_always_falls_back_is_refused() {
    for (mode, rest) in [(Mode::Csv, 0), (Mode::Cst, 0), (Mode::Cst, 60), (Mode::Cst, 500)] {
        let (mut host, _) = declared(BOTH, true, mode, rest);
        for _ in 0..2 {
            host.master(MasterCommand::SetState(MasterState::Op));
            host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
        }
    }
}
