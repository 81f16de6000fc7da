//! A host like another driver for the chip, with packet code of its own, and the chip's model under it.

use std::ops::Range;

use ecmsk::ethercat::Ns;
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::{CrcCoverage, CrcCoverages};

use crate::crc32;
use crate::network::drive;

/// A byte at 24 MHz.
const BYTE_NS: Ns = 333;
const US: Ns = 1_000;
pub const MS: Ns = 1_000_000;
pub const DRIVES: u8 = 3;

/// The bytes that a CRC-32 covers in a driver.
pub type Cover = fn(n: usize, valid: usize) -> usize;

pub fn all(n: usize, _: usize) -> usize {
    24 + n
}

pub fn valid(_: usize, valid: usize) -> usize {
    24 + valid
}

pub fn valid4(_: usize, valid: usize) -> usize {
    (24 + valid).next_multiple_of(4)
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16
}

/// A command as a driver fills its structure.
#[derive(Clone, Debug, Default)]
pub struct Command {
    pub code: u8,
    pub par: u8,
    pub info: [u8; 4],
    pub len: u16,
    pub data: Vec<u8>,
}

pub fn command(code: u8, par: u8, info: [u8; 4]) -> Command {
    Command { code, par, info, ..Command::default() }
}

pub fn with_data(code: u8, par: u8, info: [u8; 4], data: &[u8]) -> Command {
    Command { code, par, info, len: data.len() as u16, data: data.to_vec() }
}

/// PDOs with their entries, each an object with its length in bits.
type Pdos = &'static [(u16, &'static [u32])];

/// What a host maps on every drive.
pub struct Map {
    pub rx: Pdos,
    pub tx: Pdos,
}

const MODE: u32 = 0x6060_0008;
const MODE_DISPLAY: u32 = 0x6061_0008;
const STATUSWORD: u32 = 0x6041_0010;
const POSITION: u32 = 0x6064_0020;
const TARGET: u32 = 0x607A_0020;

/// Controlword and target, statusword and position.
pub const WORDS: Map = Map { rx: &[(0x1600, &[0x6040_0010, TARGET])], tx: &[(0x1A00, &[STATUSWORD, POSITION])] };

/// The same with the mode behind each word.
pub const MODES: Map =
    Map { rx: &[(0x1600, &[0x6040_0010, MODE, TARGET])], tx: &[(0x1A00, &[STATUSWORD, MODE_DISPLAY, POSITION])] };

/// Three PDOs of each direction, with 0x60FE:1, 0x606B and 0x6074.
pub const THREE_PDOS: Map = Map {
    rx: &[(0x1600, &[0x6040_0010, TARGET]), (0x1601, &[0x60FE_0120]), (0x1602, &[MODE])],
    tx: &[(0x1A00, &[STATUSWORD, POSITION]), (0x1A01, &[0x606B_0020, 0x6074_0010]), (0x1A02, &[MODE_DISPLAY])],
};

/// The bytes of an entry in a drive's image.
fn place(pdos: Pdos, entry: u32) -> Option<Range<usize>> {
    let len = |entry: u32| (entry & 0xFF) as usize / 8;
    let entries = || pdos.iter().flat_map(|(_, entries)| *entries);
    let before = entries().take_while(|other| **other != entry).map(|other| len(*other)).sum();
    entries().any(|other| *other == entry).then(|| before..before + len(entry))
}

/// The length of a drive's image.
fn bytes(pdos: Pdos) -> usize {
    pdos.iter().flat_map(|(_, entries)| *entries).map(|entry| (entry & 0xFF) as usize / 8).sum()
}

/// A host with its chip.
pub struct Peer {
    pub port: ChipPort<SlaveModels>,
    pub now: Ns,
    pub n: usize,
    index: u8,
    /// Whether CRC-32 was set.
    crc: bool,
    of_commands: Cover,
    of_answers: Cover,
    pub control: u8,
    pub takes_nops: bool,
    map: &'static Map,
    /// Fields of the last answer: the bits of 0x09, the status of 0x0A, the return byte.
    pub errors: u8,
    status: u8,
    pub ret: u8,
}

/// The kind of answer.
pub enum Back {
    Answer(Vec<u8>),
    /// Not ready, or unreadable.
    Bad,
}

impl Peer {
    pub fn new(profile: Profile, of_commands: Cover, of_answers: Cover) -> Self {
        let chip = Chip::new(profile, SlaveModels::new((0..DRIVES).map(|_| drive()).collect()));
        Self {
            port: ChipPort::new(chip),
            // The drivers give the chip a second to start.
            now: 1000 * MS,
            n: 0,
            index: 0,
            crc: false,
            of_commands,
            of_answers,
            control: 0,
            takes_nops: false,
            map: &WORDS,
            errors: 0,
            status: 0,
            ret: 0,
        }
    }

    fn clock(&mut self, out: &[u8]) -> Vec<u8> {
        let mut back = vec![0; out.len()];
        self.port.transfer(self.now, out, &mut back);
        self.now += BYTE_NS * out.len() as Ns;
        back
    }

    /// One byte per exchange until end word and start word have followed each other twice, then up to the end of that packet.
    pub fn find_n(&mut self) {
        let border = [0x59, 0x58, 0x57, 0x56, 0xA4, 0xA3, 0xA2, 0xA1];
        let (mut stream, mut first) = (Vec::new(), None);
        let len = loop {
            self.now += US;
            stream.extend(self.clock(&[0]));
            assert!(stream.len() < 1_000_000, "no packets come");
            match first {
                _ if !stream.ends_with(&border) => {}
                None => first = Some(stream.len()),
                Some(first) => break stream.len() - first,
            }
        };
        self.n = len - 32;
        self.clock(&vec![0; len - 4]);
        self.now += 200 * US;
    }

    pub fn packet(&self, command: &Command) -> Vec<u8> {
        let mut packet = vec![0xA4, 0xA3, 0xA2, 0xA1];
        packet.extend(command.info);
        packet.extend([0, 0, self.control, self.index, command.code, command.par]);
        packet.extend(command.len.to_le_bytes());
        packet.extend([0; 8]);
        packet.extend(&command.data);
        packet.resize(24 + self.n, 0);
        let covered = (self.of_commands)(self.n, command.len.into()).min(packet.len());
        let is_fixed = !self.crc || command.code == 23;
        let word = if is_fixed { 0x1234_5678 } else { crc32(&packet[..covered]) };
        packet.extend(word.to_le_bytes());
        packet.extend([0x59, 0x58, 0x57, 0x56]);
        packet
    }

    pub fn exchange(&mut self, packet: &[u8]) -> Back {
        self.now += 150 * US;
        let back = self.clock(packet);
        let end = 24 + self.n;
        if u32_at(&back, 0) != 0xA1A2_A3A4 || u32_at(&back, end + 4) != 0x5657_5859 {
            return Back::Bad;
        }
        let covered = (self.of_answers)(self.n, u16_at(&back, 0x0E).into()).min(end);
        let expected = if back[0x0A] & 3 == 3 { crc32(&back[..covered]) } else { 0x1234_5678 };
        if u32_at(&back, end) == expected { Back::Answer(back) } else { Back::Bad }
    }

    /// Sends a command until its answer comes, with the same index and code; returns the valid data.
    pub fn call(&mut self, command: &Command) -> Vec<u8> {
        self.index = self.index.wrapping_add(1);
        let packet = self.packet(command);
        let mut bad = 0;
        for _ in 0..1000 {
            let Back::Answer(answer) = self.exchange(&packet) else {
                bad += 1;
                assert!(bad < 10, "10 bad answers in a row to {command:?}");
                continue;
            };
            bad = 0;
            let is_nop = answer[0x0A] & 1 << 5 != 0;
            if answer[0x0B] == self.index && answer[0x0C] == command.code && (self.takes_nops || !is_nop) {
                (self.errors, self.status, self.ret) = (answer[0x09] & 0xF8, answer[0x0A], answer[0x0D]);
                return answer[24..][..u16_at(&answer, 0x0E).into()].to_vec();
            }
        }
        panic!("no answer to {command:?}");
    }

    /// The same, and waits until the chip is not busy any more; returns the errors shown meanwhile.
    pub fn run(&mut self, command: &Command) -> u8 {
        self.call(command);
        let mut errors = self.errors;
        for _ in 0..100_000 {
            self.call(&Command::default());
            errors |= self.errors;
            if self.status & 1 << 7 == 0 {
                return errors;
            }
        }
        panic!("{command:?} does not end");
    }

    pub fn well(&mut self, command: &Command) {
        assert_eq!(self.run(command), 0, "{command:?}");
    }

    pub fn set_crc(&mut self) {
        self.call(&command(25, 3, [0; 4]));
        self.crc = true;
    }

    /// Sends ECAT_INIT_OP as the drivers do, and checks the number of slaves.
    pub fn init(&mut self, shift_ns: u32) {
        let mut data = vec![0xFF, 0x81, 0x00, 0x03];
        for word in [1_000_000_u32, 0, shift_ns] {
            data.extend(word.to_le_bytes());
        }
        self.well(&with_data(1, 0, [0; 4], &data));
        self.call(&command(16, 0, [0; 4]));
        assert_eq!(self.ret, DRIVES);
    }

    pub fn state(&mut self, code: u8) {
        self.well(&command(12, 0xFF, [code, 0, 0, 0]));
        self.well(&command(57, 0, [0; 4]));
        self.call(&command(13, 0xFF, [0; 4]));
        assert_eq!(self.ret, code);
    }

    pub fn sdo(&mut self, slave: u8, index: u16, written: &[u8], reads: u8) -> u8 {
        let op = u8::from(written.is_empty());
        let mut data = vec![op, slave];
        data.extend(index.to_le_bytes());
        data.extend([0, 0]);
        data.extend(u16::from(reads.max(written.len() as u8)).to_le_bytes());
        data.extend(100_000_u32.to_le_bytes());
        data.extend(written);
        self.run(&with_data(10, 0, [0; 4], &data))
    }

    /// Sets CSP by SDO and maps process data by PDO_CONFIG_SET, on every drive.
    pub fn map(&mut self, map: &'static Map) {
        self.map = map;
        for slave in 0..DRIVES {
            assert_eq!(self.sdo(slave, 0x6060, &[8], 0), 0);
            for (assign, pdos) in [(0x1C12_u16, map.rx), (0x1C13, map.tx)] {
                let mut data = vec![0; 112];
                (data[0], data[1]) = (slave, pdos.len() as u8);
                data[2..4].copy_from_slice(&assign.to_le_bytes());
                for (n, (pdo, entries)) in pdos.iter().enumerate() {
                    data[4 + 2 * n..][..2].copy_from_slice(&pdo.to_le_bytes());
                    data[10 + 2 * n] = entries.len() as u8;
                    for (place, entry) in data[16 + 32 * n..].chunks_exact_mut(4).zip(*entries) {
                        place.copy_from_slice(&entry.to_le_bytes());
                    }
                }
                self.well(&with_data(7, 0, [0; 4], &data));
            }
        }
        self.well(&command(2, 0, [0; 4]));
    }

    /// Reads by PDO_DATA_OP; `None` if a needed bit of the return byte is missing.
    pub fn inputs(&mut self, needed: u8) -> Option<Vec<u8>> {
        let inputs = self.call(&command(6, 0, [6, 0, 0, 0]));
        (self.ret & needed == needed).then_some(inputs)
    }

    /// The bytes of an entry in the inputs of each drive.
    fn each<'a>(&self, inputs: &'a [u8], entry: u32) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let place = place(self.map.tx, entry).expect("it is mapped");
        inputs.chunks_exact(bytes(self.map.tx)).map(move |drive| &drive[place.clone()])
    }

    fn positions(&self, inputs: &[u8]) -> Vec<i32> {
        self.each(inputs, POSITION).map(|position| u32_at(position, 0) as i32).collect()
    }

    /// Outputs of all drives: the targets, CSP if the mode is mapped, and 0.
    fn targets(&self, positions: &[i32]) -> Vec<u8> {
        let mut outputs = vec![0; bytes(self.map.rx) * positions.len()];
        for (drive, position) in outputs.chunks_exact_mut(bytes(self.map.rx)).zip(positions) {
            drive[place(self.map.rx, TARGET).expect("it is mapped")].copy_from_slice(&position.to_le_bytes());
            if let Some(mode) = place(self.map.rx, MODE) {
                drive[mode][0] = 8;
            }
        }
        outputs
    }

    /// From SafeOP on: switches the drives on, which follow 200 targets.
    pub fn switch_on_and_move(&mut self, needed: u8) {
        self.now += 10 * MS;
        let inputs = self.inputs(needed).expect("inputs");
        assert_eq!(inputs.len(), bytes(self.map.tx) * usize::from(DRIVES));
        let begin = self.positions(&inputs);
        let targets = self.targets(&begin);
        self.call(&with_data(6, 0, [5, 0, 0, 0], &targets));
        assert_eq!(self.ret & 1, 1);
        self.state(8);
        self.call(&command(18, 1, [0; 4]));
        for motor in 0..DRIVES {
            self.call(&command(27, motor, [0x27, 0, 0, 0]));
            assert_eq!(self.errors, 0);
        }
        self.now += 1000 * MS;
        for motor in 0..DRIVES {
            self.call(&command(28, motor, [0; 4]));
            assert_eq!(self.ret & 0x6F, 0x27, "motor {motor} is on");
        }
        let mut newest = begin.clone();
        for n in 1..=200 {
            let targets: Vec<i32> = begin.iter().map(|position| position + 50 * n).collect();
            let outputs = self.targets(&targets);
            let inputs = self.call(&with_data(5, 1, [3, 0, 0, 0], &outputs));
            assert!(self.errors == 0 && self.ret & 1 == 1, "target {n}");
            if self.ret & 2 != 0 {
                assert!(self.each(&inputs, STATUSWORD).all(|word| u16_at(word, 0) & 0x6F == 0x27));
                if place(self.map.tx, MODE_DISPLAY).is_some() {
                    assert!(self.each(&inputs, MODE_DISPLAY).all(|mode| mode == [8]), "CSP: the mode is the host's");
                }
                newest = self.positions(&inputs);
            }
            self.now += MS;
        }
        assert!(newest.iter().zip(&begin).all(|(newest, begin)| newest - begin > 5_000), "{begin:?} {newest:?}");
    }
}

/// The usual beginning: n, CRC-32, version, not busy, FIFO off and empty.
pub fn begin(peer: &mut Peer, n: usize) {
    peer.find_n();
    assert_eq!(peer.n, n);
    peer.set_crc();
    settle(peer);
}

pub fn settle(peer: &mut Peer) {
    peer.call(&command(56, 0, [0; 4]));
    // The bytes of the search were no packets.
    let control = std::mem::replace(&mut peer.control, 0xF8);
    peer.call(&Command::default());
    peer.control = control;
    peer.well(&Command::default());
    peer.call(&command(18, 0, [0; 4]));
    peer.call(&command(51, 0, [0; 4]));
}

pub fn over(coverage: CrcCoverage, profile: Profile) -> Profile {
    Profile { coverages: CrcCoverages::from(coverage), ..profile }
}
