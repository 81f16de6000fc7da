//! A simulated drive without a network, and a master that brings it through the states of CiA 402 cycle by cycle.

use ecmsk::cia402::{Controlword, DriveState, Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, MAX_AXES, Ns, Role};
use ecmsk::slave::{Drive, DriveConfig, DriveKind, Slave};

use crate::wired::{exchange, map};

pub const MS: Ns = 1_000_000;

pub struct Rig {
    pub drive: Drive,
    data: ProcessData,
    pub cycle_ns: Ns,
    pub out: AxisOut,
    pub seen: AxisIn,
}

impl Rig {
    /// A drive in OP with its power stage off.
    pub fn in_op(config: DriveConfig, mode: Mode, cycle_ns: Ns) -> Self {
        let role = match config.kind {
            DriveKind::Servo => Role::Drive(mode),
            DriveKind::Stepper => Role::Step(mode),
        };
        let mut drive = Drive::new(config);
        enter(&mut drive, AlState::PreOp);
        let data = map(&mut drive, role);
        enter(&mut drive, AlState::SafeOp);
        enter(&mut drive, AlState::Op);
        let mut rig = Self { drive, data, cycle_ns, out: AxisOut::default(), seen: AxisIn::default() };
        rig.run_for(200 * MS);
        rig
    }

    /// A drive in OP and Operation enabled, its target where its shaft is.
    pub fn enabled(config: DriveConfig, mode: Mode, cycle_ns: Ns) -> Self {
        let mut rig = Self::in_op(config, mode, cycle_ns);
        rig.enable();
        rig
    }

    pub fn enable(&mut self) {
        for (word, state) in [
            (Controlword::SHUTDOWN, DriveState::ReadyToSwitchOn),
            (Controlword::SWITCH_ON, DriveState::SwitchedOn),
            (Controlword::ENABLE_OPERATION, DriveState::OperationEnabled),
        ] {
            self.out.controlword = word;
            self.hold_position_until(state);
        }
    }

    fn hold_position_until(&mut self, state: DriveState) {
        for _ in 0..10_000 {
            if self.mode() == Mode::Csp {
                self.out.target = self.seen.position;
            }
            self.cycle();
            if self.seen.statusword.state() == Some(state) {
                return;
            }
        }
        panic!("{state} was not reached: {:04X}", self.seen.statusword.0);
    }

    /// One cycle: exchanges process data, then lets the time of the cycle pass.
    pub fn cycle(&mut self) -> AxisIn {
        let mut inputs = [AxisIn::default(); MAX_AXES];
        exchange(&mut self.drive, &self.data, Some(&[self.out, AxisOut::default()]), &mut inputs);
        self.seen = inputs[0];
        self.drive.step(self.cycle_ns);
        self.seen
    }

    /// Runs cycles for that time, at least one.
    pub fn run_for(&mut self, ns: Ns) {
        for _ in 0..ns.div_ceil(self.cycle_ns) {
            self.cycle();
        }
    }

    pub fn mode(&self) -> Mode {
        self.drive.axis().mode()
    }

    pub fn status(&self) -> Statusword {
        self.drive.axis().measured().statusword
    }

    pub fn state(&self) -> DriveState {
        self.drive.axis().machine().state()
    }

    pub fn position(&self) -> i64 {
        self.drive.axis().plant().position()
    }

    pub fn velocity(&self) -> f64 {
        self.drive.axis().plant().velocity()
    }

    pub fn torque(&self) -> i16 {
        self.drive.axis().measured().torque
    }

    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        read(&mut self.drive, index, sub).expect("it can be read")
    }

    pub fn write(&mut self, index: u16, sub: u8, size: SdoSize, value: i64) {
        write(&mut self.drive, index, sub, size, value).expect("it can be written");
    }
}

pub fn enter(drive: &mut Drive, state: AlState) {
    drive.enter(state).expect("the state is open to it");
    assert_eq!(drive.state(), state);
}

pub fn read(drive: &mut Drive, index: u16, sub: u8) -> Result<u32, AbortCode> {
    drive.upload(ObjectAddress::new(index, sub)).map(|value| value.bits)
}

pub fn write(drive: &mut Drive, index: u16, sub: u8, size: SdoSize, value: i64) -> Result<(), AbortCode> {
    drive.download(ObjectAddress::new(index, sub), size, value as u32)
}
