//! Hosts like other drivers for the chip, on its model. They are written from what is known of those drivers, with their own
//! packet code, and use none of this project's encoders.
//!
//! | host | what is its own |
//! | --- | --- |
//! | driver 0.1 | its CRC-32 covers up to the next multiple of 4; of a return byte it looks at bit 1; no 402_CONFIG_SET |
//! | driver 1.60 | takes inputs only with bits 1 and 2 of the return byte; its CRC-32 covers all or the valid bytes |
//! | a closed client | clears all errors in every packet; covers all in commands and the valid bytes in answers; n is 512; takes NOP answers for answers |

use ecmsk::ethercat::Ns;
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::{CrcCoverage, CrcCoverages};

use crate::crc32;
use crate::network::drive;

/// A byte at 24 MHz.
const BYTE_NS: Ns = 333;
const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const DRIVES: u8 = 3;

/// Codes of driver 1.60 that the manuals leave out: EMAC_RESET, RTA, EMAC_INIT, extra PDO data, SPI_PACK_SIZE_SET.
const LEFT_OUT: [u8; 13] = [40, 60, 61, 62, 63, 64, 65, 128, 133, 134, 135, 136, 141];

/// The bytes that a CRC-32 covers in a driver.
type Cover = fn(n: usize, valid: usize) -> usize;

fn all(n: usize, _: usize) -> usize {
    24 + n
}

fn valid(_: usize, valid: usize) -> usize {
    24 + valid
}

fn valid4(_: usize, valid: usize) -> usize {
    (24 + valid).next_multiple_of(4)
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16
}

/// A command as a driver fills its structure.
#[derive(Clone, Debug, Default)]
struct Command {
    code: u8,
    par: u8,
    info: [u8; 4],
    len: u16,
    data: Vec<u8>,
}

fn command(code: u8, par: u8, info: [u8; 4]) -> Command {
    Command { code, par, info, ..Command::default() }
}

fn with_data(code: u8, par: u8, info: [u8; 4], data: &[u8]) -> Command {
    Command { code, par, info, len: data.len() as u16, data: data.to_vec() }
}

/// A host with its chip.
struct Peer {
    port: ChipPort<SlaveModels>,
    now: Ns,
    n: usize,
    index: u8,
    /// Whether CRC-32 was set.
    crc: bool,
    of_commands: Cover,
    of_answers: Cover,
    control: u8,
    takes_nops: bool,
    /// Fields of the last answer: the bits of 0x09, the status of 0x0A, the return byte.
    errors: u8,
    status: u8,
    ret: u8,
}

/// The kind of answer.
enum Back {
    Answer(Vec<u8>),
    /// Not ready, or unreadable.
    Bad,
}

impl Peer {
    fn new(profile: Profile, of_commands: Cover, of_answers: Cover) -> Self {
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
    fn find_n(&mut self) {
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

    fn packet(&self, command: &Command) -> Vec<u8> {
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

    fn exchange(&mut self, packet: &[u8]) -> Back {
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
    fn call(&mut self, command: &Command) -> Vec<u8> {
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
    fn run(&mut self, command: &Command) -> u8 {
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

    fn well(&mut self, command: &Command) {
        assert_eq!(self.run(command), 0, "{command:?}");
    }

    fn set_crc(&mut self) {
        self.call(&command(25, 3, [0; 4]));
        self.crc = true;
    }

    /// Sends ECAT_INIT_OP as the drivers do, and checks the number of slaves.
    fn init(&mut self, shift_ns: u32) {
        let mut data = vec![0xFF, 0x81, 0x00, 0x03];
        for word in [1_000_000_u32, 0, shift_ns] {
            data.extend(word.to_le_bytes());
        }
        self.well(&with_data(1, 0, [0; 4], &data));
        self.call(&command(16, 0, [0; 4]));
        assert_eq!(self.ret, DRIVES);
    }

    fn state(&mut self, code: u8) {
        self.well(&command(12, 0xFF, [code, 0, 0, 0]));
        self.well(&command(57, 0, [0; 4]));
        self.call(&command(13, 0xFF, [0; 4]));
        assert_eq!(self.ret, code);
    }

    fn sdo(&mut self, slave: u8, index: u16, written: &[u8], reads: u8) -> u8 {
        let op = u8::from(written.is_empty());
        let mut data = vec![op, slave];
        data.extend(index.to_le_bytes());
        data.extend([0, 0]);
        data.extend(u16::from(reads.max(written.len() as u8)).to_le_bytes());
        data.extend(100_000_u32.to_le_bytes());
        data.extend(written);
        self.run(&with_data(10, 0, [0; 4], &data))
    }

    /// CSP with controlword and target, statusword and position.
    fn map(&mut self) {
        for slave in 0..DRIVES {
            assert_eq!(self.sdo(slave, 0x6060, &[8], 0), 0);
            for (assign, pdo, objects) in
                [(0x1C12_u16, 0x1600_u16, [0x6040_0010_u32, 0x607A_0020]), (0x1C13, 0x1A00, [0x6041_0010, 0x6064_0020])]
            {
                let mut data = vec![0; 112];
                (data[0], data[1]) = (slave, 1);
                data[2..4].copy_from_slice(&assign.to_le_bytes());
                data[4..6].copy_from_slice(&pdo.to_le_bytes());
                data[10] = 2;
                for (place, object) in data[16..].chunks_exact_mut(4).zip(objects) {
                    place.copy_from_slice(&object.to_le_bytes());
                }
                self.well(&with_data(7, 0, [0; 4], &data));
            }
        }
        self.well(&command(2, 0, [0; 4]));
    }

    /// Reads by PDO_DATA_OP; `None` if a needed bit of the return byte is missing.
    fn inputs(&mut self, needed: u8) -> Option<Vec<u8>> {
        let inputs = self.call(&command(6, 0, [6, 0, 0, 0]));
        (self.ret & needed == needed).then_some(inputs)
    }

    fn positions(inputs: &[u8]) -> Vec<i32> {
        inputs.chunks_exact(6).map(|axis| u32_at(axis, 2) as i32).collect()
    }

    fn targets(positions: &[i32]) -> Vec<u8> {
        positions.iter().flat_map(|position| [&[0, 0][..], &position.to_le_bytes()].concat()).collect()
    }

    /// From SafeOP on: switches the drives on, which follow 200 targets.
    fn switch_on_and_move(&mut self, needed: u8) {
        self.now += 10 * MS;
        let inputs = self.inputs(needed).expect("inputs");
        assert_eq!(inputs.len(), 6 * usize::from(DRIVES));
        let begin = Self::positions(&inputs);
        self.call(&with_data(6, 0, [5, 0, 0, 0], &Self::targets(&begin)));
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
            let inputs = self.call(&with_data(5, 1, [3, 0, 0, 0], &Self::targets(&targets)));
            assert!(self.errors == 0 && self.ret & 1 == 1, "target {n}");
            if self.ret & 2 != 0 {
                assert!(inputs.chunks_exact(6).all(|axis| u16_at(axis, 0) & 0x6F == 0x27));
                newest = Self::positions(&inputs);
            }
            self.now += MS;
        }
        assert!(newest.iter().zip(&begin).all(|(newest, begin)| newest - begin > 5_000), "{begin:?} {newest:?}");
    }
}

/// The usual beginning: n, CRC-32, version, not busy, FIFO off and empty.
fn begin(peer: &mut Peer, n: usize) {
    peer.find_n();
    assert_eq!(peer.n, n);
    peer.set_crc();
    settle(peer);
}

fn settle(peer: &mut Peer) {
    peer.call(&command(56, 0, [0; 4]));
    // The bytes of the search were no packets.
    let control = std::mem::replace(&mut peer.control, 0xF8);
    peer.call(&Command::default());
    peer.control = control;
    peer.well(&Command::default());
    peer.call(&command(18, 0, [0; 4]));
    peer.call(&command(51, 0, [0; 4]));
}

fn over(coverage: CrcCoverage, profile: Profile) -> Profile {
    Profile { coverages: CrcCoverages::from(coverage), ..profile }
}

/// XF-13.6 Driver 0.1 (2020): CRC-32 up to the next multiple of 4, inputs by bit 1 of the return byte, and the helper
/// controlled by 402_CTL_SET alone.
#[test]
fn driver_0_1() {
    let mut peer = Peer::new(over(CrcCoverage::Valid4, Profile::OLD), valid4, valid4);
    begin(&mut peer, 112);
    peer.init(0);
    peer.state(2);
    peer.map();
    peer.state(4);
    for motor in 0..DRIVES {
        peer.call(&command(29, motor, [1 << 4, 0x5A, DRIVES, motor]));
        assert_eq!(peer.errors, 0, "402_CTL_SET without 402_CONFIG_SET");
    }
    peer.switch_on_and_move(1 << 1);
}

/// XF-13.6 Driver 1.60: CRC-32 over all, or over the valid bytes in one of its builds; inputs only with bits 1 and 2 of the
/// return byte. It asks for the clocks of slaves, and sends codes at start that the manuals leave out.
#[test]
fn driver_1_60() {
    for (coverage, cover) in [(CrcCoverage::All, all as Cover), (CrcCoverage::Valid, valid)] {
        let mut peer = Peer::new(over(coverage, Profile::NEW), cover, cover);
        begin(&mut peer, 1024);
        for code in LEFT_OUT {
            peer.call(&command(code, 0, [0; 4]));
            assert_eq!(peer.errors, 1 << 7, "code {code}: the command error");
            peer.control = 0x80;
            peer.well(&Command::default());
            peer.control = 0;
        }
        assert_eq!(peer.port.chip().unknown_commands(), LEFT_OUT.len() as u64);
        peer.init(0);
        peer.state(2);
        peer.map();
        peer.state(4);
        assert_eq!(peer.call(&command(15, 0, [13, 0, 0, 0])), [1], "the clock of slave 0 is on");
        for motor in 0..DRIVES {
            peer.call(&command(26, motor, [0, 0, 1 << 4 | 1 << 3, motor]));
            assert_eq!(peer.errors, 0);
        }
        peer.switch_on_and_move(1 << 1 | 1 << 2);
    }
}

/// XF-13.6 A closed client library: all of a command is covered and the valid bytes of an answer, n is set to 512 after a search
/// byte by byte, control 0xF8 stands in every packet, and an answer with the NOP flag is taken for one. A failed SDO is seen, and
/// none gives the bytes of the one before.
#[test]
fn a_closed_client() {
    let coverages = CrcCoverages { commands: CrcCoverage::All, answers: CrcCoverage::Valid };
    let mut peer = Peer::new(Profile { coverages, ..Profile::NEW }, all, valid);
    (peer.control, peer.takes_nops) = (0xF8, true);
    peer.find_n();
    peer.exchange(&peer.packet(&Command { code: 23, len: 512, ..Command::default() }));
    peer.now += 100 * MS;
    peer.n = 512;
    peer.set_crc();
    settle(&mut peer);
    peer.call(&command(132, 20, [0; 4]));
    peer.init(500_000);
    peer.state(2);
    peer.map();
    assert_eq!(peer.sdo(0, 0x1000, &[], 4), 0);
    assert_eq!(peer.call(&command(11, 0, [0; 4])).len(), 4);
    assert_eq!(peer.sdo(0, 0x5FFF, &[], 4), 1 << 3, "the failure is shown once");
    assert_eq!(peer.call(&command(11, 0, [0; 4])), [0; 0], "and has no bytes");
    assert_eq!(peer.errors, 0);
    assert_eq!(u32_at(&peer.call(&command(69, 0, [0; 4])), 0), 0x0602_0000);
    peer.call(&command(54, 32, [0; 4]));
    peer.call(&command(52, 1, [0; 4]));
    peer.well(&command(66, 0, [0; 4]));
    peer.well(&command(41, 0xFF, [4, 0, 0, 0]));
    for motor in 0..DRIVES {
        peer.call(&command(26, motor, [0, 0, 0x90, motor]));
    }
    peer.switch_on_and_move(1 << 1);
}

/// XF-13.6 STATE_SET 0x12 after an error, as an application sends it: the error is acknowledged, and PreOP reached.
#[test]
fn a_state_with_the_acknowledge_bit() {
    let mut peer = Peer::new(Profile::NEW, all, all);
    begin(&mut peer, 1024);
    peer.init(0);
    peer.state(2);
    assert_eq!(peer.run(&command(12, 0, [3, 0, 0, 0])), 1 << 3, "no slave knows Boot");
    peer.control = 1 << 3;
    peer.call(&command(13, 0, [0; 4]));
    peer.control = 0;
    assert_eq!(peer.ret, 0x12, "an error");
    peer.well(&command(12, 0, [0x12, 0, 0, 0]));
    peer.call(&command(13, 0, [0; 4]));
    assert_eq!(peer.ret, 2);
}
