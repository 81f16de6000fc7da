//! A DP3CL in OP with the process data of power-on, and a master that sends a controlword, a target position and the function of
//! the touch probes in every cycle.

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, Ns};
use ecmsk::slave::dp3cl::{Dp3cl, Dp3clConfig};
use ecmsk::slave::{AlStatus, Slave};

pub const MS: Ns = 1_000_000;

pub struct Bench {
    pub drive: Dp3cl,
    pub cycle_ns: Ns,
    pub word: u16,
    pub target: i32,
    pub probes: u16,
}

/// A drive that was just switched on, in PreOP.
pub fn in_preop(config: Dp3clConfig) -> Dp3cl {
    let mut drive = Dp3cl::new(config);
    drive.enter(AlState::PreOp).expect("a drive has a mailbox");
    drive
}

pub fn usual() -> Dp3cl {
    in_preop(Dp3clConfig::default())
}

/// The drive after a loss of its power, in PreOP.
pub fn restarted(mut drive: Dp3cl) -> Dp3cl {
    drive.restart();
    drive.enter(AlState::PreOp).expect("a drive has a mailbox");
    drive
}

pub fn read(drive: &mut Dp3cl, index: u16, sub: u8) -> Result<i64, AbortCode> {
    let mut value = [0; 8];
    let len = drive.read(ObjectAddress::new(index, sub), SdoScope::Entry, &mut value)?;
    Ok(match len {
        1 => value[0].into(),
        2 => i64::from(u16::from_le_bytes([value[0], value[1]])),
        _ => i64::from(i32::from_le_bytes([value[0], value[1], value[2], value[3]])),
    })
}

/// Writes a value of as many bytes as the object has.
pub fn write(drive: &mut Dp3cl, index: u16, sub: u8, value: i64) -> Result<(), AbortCode> {
    let at = ObjectAddress::new(index, sub);
    let len = drive.read(at, SdoScope::Entry, &mut [0; 8])?;
    drive.write(at, SdoScope::Entry, &value.to_le_bytes()[..len])
}

/// A list in the usual order: count 0, items, count.
pub fn list(drive: &mut Dp3cl, index: u16, items: &[u32]) -> Result<(), AbortCode> {
    write(drive, index, 0, 0)?;
    for (sub, item) in (1..).zip(items) {
        write(drive, index, sub, (*item).into())?;
    }
    write(drive, index, 0, items.len() as i64)
}

impl Bench {
    /// A drive in OP in that mode of operation, its power stage off.
    pub fn in_op(config: Dp3clConfig, mode: i64, cycle_ns: Ns) -> Self {
        Self::of(in_preop(config), mode, cycle_ns)
    }

    /// A drive in PreOP, with the process data of power-on, brought to OP in that mode of operation.
    pub fn of(mut drive: Dp3cl, mode: i64, cycle_ns: Ns) -> Self {
        write(&mut drive, 0x6060, 0, mode).expect("any mode can be written");
        drive.set_sync_managers(8, 19);
        for state in [AlState::SafeOp, AlState::Op] {
            drive.enter(state).expect("the mapping of power-on is good");
        }
        let mut bench = Self { drive, cycle_ns, word: 0, target: 0, probes: 0 };
        bench.run_for(150 * MS);
        bench
    }

    /// A drive that is enabled, in that mode, with cycles of 1 ms.
    pub fn enabled(mode: i64) -> Self {
        Self::enabled_with(Dp3clConfig::default(), mode)
    }

    pub fn enabled_with(config: Dp3clConfig, mode: i64) -> Self {
        let mut bench = Self::in_op(config, mode, MS);
        bench.enable();
        bench
    }

    /// Sends 06h, 07h, 0Fh, each until the drive has reached its state.
    pub fn enable(&mut self) {
        for (word, state) in
            [(0x06, DriveState::ReadyToSwitchOn), (0x07, DriveState::SwitchedOn), (0x0F, DriveState::OperationEnabled)]
        {
            self.word = word;
            self.run_until(1000, |bench| bench.state() == Some(state));
        }
    }

    pub fn cycle(&mut self) {
        let mut image = [0; 8];
        image[..2].copy_from_slice(&self.word.to_le_bytes());
        image[2..6].copy_from_slice(&self.target.to_le_bytes());
        image[6..].copy_from_slice(&self.probes.to_le_bytes());
        self.drive.exchange(Some(&image), &mut [0; 19]);
        self.drive.step(self.cycle_ns);
    }

    pub fn run_for(&mut self, ns: Ns) {
        for _ in 0..ns.div_ceil(self.cycle_ns) {
            self.cycle();
        }
    }

    /// Runs cycles until a condition holds; returns the number of cycles.
    pub fn run_until(&mut self, most: usize, mut is_so: impl FnMut(&mut Self) -> bool) -> usize {
        for cycle in 0..most {
            if is_so(self) {
                return cycle;
            }
            self.cycle();
        }
        panic!("not within {most} cycles: {:04X}", self.status().0);
    }

    pub fn status(&self) -> Statusword {
        self.drive.statusword()
    }

    pub fn state(&self) -> Option<DriveState> {
        self.status().state()
    }

    pub fn bit(&self, bit: u16) -> bool {
        self.status().0 >> bit & 1 != 0
    }

    pub fn read(&mut self, index: u16, sub: u8) -> i64 {
        read(&mut self.drive, index, sub).expect("it can be read")
    }

    pub fn write(&mut self, index: u16, sub: u8, value: i64) {
        write(&mut self.drive, index, sub, value).unwrap_or_else(|code| panic!("{index:04X}:{sub}: {code}"));
    }

    /// 0x6064.
    pub fn position(&mut self) -> i64 {
        self.read(0x6064, 0)
    }

    pub fn shaft(&self) -> i64 {
        self.drive.shaft(0).expect("it has one axis")
    }

    /// 0x606C.
    pub fn velocity(&mut self) -> i64 {
        self.read(0x606C, 0)
    }

    pub fn enter(&mut self, state: AlState) -> Result<(), AlStatus> {
        self.drive.enter(state)
    }
}
