//! The device behind a slave controller.

use super::coe::{Coe, number};
use super::{Foe, OddSlave, sii};

/// A device.
pub enum Device {
    /// Nothing: a coupler.
    None,
    /// A terminal: the byte at the second address copies that at the first.
    Echo(usize, usize),
    /// A drive.
    Drive(Drive),
}

/// A CiA 402 drive that reaches each target at once.
#[derive(Default)]
pub struct Drive {
    /// The actual position.
    pub position: i32,
    /// All targets that it has reached.
    pub targets: Vec<i32>,
    stage: Stage,
}

#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Disabled,
    Ready,
    On,
    Enabled,
}

/// The objects of a drive, at power-on with controlword and target, statusword, position, torque and error code.
pub fn drive_objects() -> Coe {
    let mut coe = Coe::default();
    let mut put = |index, sub, bytes, value| {
        coe.objects.insert((index, sub), number(bytes, value));
    };
    put(0x1000, 0, 4, 0x0002_0192);
    put(0x1001, 0, 1, 0);
    for (sub, value) in (0..).zip([4, 0x1234, 0x5678, 1, 0]) {
        put(0x1018, sub, if sub == 0 { 1 } else { 4 }, value);
    }
    for (sub, value) in (0..).zip([4, 1, 2, 3, 4]) {
        put(0x1C00, sub, 1, value);
    }
    for (assignment, pdo) in [(0x1C12, 0x1600), (0x1C13, 0x1A00)] {
        put(assignment, 0, 1, 1);
        put(assignment, 1, 2, pdo);
        put(assignment, 2, 2, 0);
    }
    let pdos: [(u16, &[u32]); 2] =
        [(0x1600, &[0x6040_0010, 0x607A_0020]), (0x1A00, &[0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010])];
    for (index, entries) in pdos {
        put(index, 0, 1, entries.len() as u32);
        for sub in 1..=8 {
            put(index, sub, 4, entries.get(usize::from(sub) - 1).copied().unwrap_or(0));
        }
    }
    for index in [0x1C32, 0x1C33] {
        put(index, 0, 1, 2);
        put(index, 1, 2, 0);
        put(index, 2, 4, 0);
    }
    for (index, bytes) in [
        (0x603F, 2),
        (0x6040, 2),
        (0x6041, 2),
        (0x6060, 1),
        (0x6061, 1),
        (0x6064, 4),
        (0x606C, 4),
        (0x6071, 2),
        (0x6077, 2),
        (0x607A, 4),
        (0x607C, 4),
        (0x6098, 1),
        (0x609A, 4),
        (0x60B1, 4),
        (0x60B2, 2),
        (0x60FD, 4),
        (0x60FF, 4),
    ] {
        put(index, 0, bytes, 0);
    }
    put(0x6502, 0, 4, 0x0180);
    put(0x6099, 0, 1, 2);
    put(0x6099, 1, 4, 0);
    put(0x6099, 2, 4, 0);
    coe.objects.insert((0x1008, 0), b"an odd drive".to_vec());
    coe.read_only.extend([0x1000, 0x1008, 0x1018, 0x1C00, 0x6041, 0x6061, 0x6064]);
    coe
}

/// A drive without oddities.
pub fn drive() -> OddSlave {
    drive_of(sii::drive(Some(&sii::MANAGERS)))
}

/// A drive with that EEPROM.
pub fn drive_of(eeprom: Vec<u8>) -> OddSlave {
    OddSlave::new(eeprom, Device::Drive(Drive::default())).with(|slave| {
        slave.mailbox.coe = Some(drive_objects());
        slave.mailbox.foe = Some(Foe::default());
    })
}

/// A coupler with device emulation and without a mailbox.
pub fn coupler() -> OddSlave {
    let eeprom = sii::Content::new(0).strings(&[b"COUPLER"]).general(1).fmmus(&[]).managers(&[]).end();
    OddSlave::new(eeprom, Device::None).with(|slave| {
        slave.states.copies_control = true;
        slave.clock = None;
    })
}

/// A terminal with four outputs and four inputs, device emulation and no mailbox.
pub fn terminal() -> OddSlave {
    let managers = [(0x0F00, 1, 0x44, 9, 3), (0x1000, 1, 0x00, 1, 4)];
    let bits: [[(u16, u8, u8); 1]; 8] =
        std::array::from_fn(|n| [(if n < 4 { 0x7000 } else { 0x6000 } + 0x10 * (n as u16 & 3), 1, 1)]);
    let rx: [sii::Pdo<'_>; 4] = std::array::from_fn(|n| (0x1600 + n as u16, 0, &bits[n][..]));
    let tx: [sii::Pdo<'_>; 4] = std::array::from_fn(|n| (0x1A00 + n as u16, 1, &bits[4 + n][..]));
    let content = sii::Content::new(0).strings(&[b"EL"]).general(1).fmmus(&[1, 2]).managers(&managers);
    let eeprom = content.pdos(50, &tx).pdos(51, &rx).end();
    OddSlave::new(eeprom, Device::Echo(0x0F00, 0x1000)).with(|slave| {
        slave.states.copies_control = true;
        slave.clock = None;
    })
}

impl OddSlave {
    /// The position of a drive.
    pub fn position(&self) -> i32 {
        if let Device::Drive(drive) = &self.device { drive.position } else { 0 }
    }

    /// Runs the device after outputs have come, or inputs were read.
    pub(super) fn run_device(&mut self) {
        if let Device::Echo(from, to) = self.device {
            self.memory[to] = self.memory[from] & 0x0F;
            return;
        }
        let (state, now_on) = (self.state(), self.memory[0x0130] & 0x10 == 0);
        if state < 4 || !now_on && state == 8 {
            return;
        }
        let Some([outputs, inputs]) = self.mailbox.coe.as_ref().map(Coe::process_managers) else { return };
        let [at, to] = [outputs, inputs].map(|n| self.manager(n).start);
        let (Device::Drive(drive), Some(coe)) = (&mut self.device, &mut self.mailbox.coe) else { return };
        if state == 8 {
            let mut bit = at * 8;
            for entry in coe.mapped(outputs) {
                let bits = entry as usize & 0xFF;
                let value = (0..bits).map(|n| u32::from(self.memory[(bit + n) / 8] >> ((bit + n) % 8) & 1) << n).sum();
                coe.set((entry >> 16) as u16, (entry >> 8) as u8, value);
                bit += bits;
            }
            drive.step(coe);
        }
        drive.look(coe);
        let mut bit = to * 8;
        for entry in coe.mapped(inputs) {
            let value = coe.get((entry >> 16) as u16, (entry >> 8) as u8);
            for n in 0..entry as usize & 0xFF {
                let place = &mut self.memory[(bit + n) / 8];
                *place = *place & !(1 << ((bit + n) % 8)) | ((value >> n & 1) as u8) << ((bit + n) % 8);
            }
            bit += entry as usize & 0xFF;
        }
    }
}

impl Drive {
    fn step(&mut self, coe: &Coe) {
        let control = coe.get(0x6040, 0);
        self.stage = match (control & 0x0F, self.stage) {
            (0x06 | 0x0E, _) => Stage::Ready,
            (0x07, Stage::Ready | Stage::On | Stage::Enabled) => Stage::On,
            (0x0F, Stage::On | Stage::Enabled) => Stage::Enabled,
            (0x0F, stage) => stage,
            _ => Stage::Disabled,
        };
        let target = coe.get(0x607A, 0).cast_signed();
        if self.stage == Stage::Enabled && coe.get(0x6060, 0) == 8 && target != self.position {
            self.position = target;
            self.targets.push(target);
        }
    }

    /// Writes the position to its objects.
    pub(super) fn look(&self, coe: &mut Coe) {
        let word = match self.stage {
            Stage::Disabled => 0x0250,
            Stage::Ready => 0x0231,
            Stage::On => 0x0233,
            Stage::Enabled => 0x1237,
        };
        let mode = coe.get(0x6060, 0);
        coe.set(0x6041, 0, word);
        coe.set(0x6061, 0, mode);
        coe.set(0x6064, 0, self.position.cast_unsigned());
    }
}
