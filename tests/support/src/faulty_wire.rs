//! The wire between the driver of an ECM-XF and the model of the chip: faults on it, and of the chip at its end.

use ecmsk::ethercat::Ns;
use ecmsk::xf::chip::{Chip, ChipPort, ChipTiming, SlaveNetwork};
use ecmsk::xf::request::{Encode, SpiReconfig, WarmReset};
use ecmsk::xf::{
    AnswerPacket, CheckRule, CommandCode, CommandHeader, CrcCoverage, DataSize, MAX_PACKET, Received, write_answer,
    write_request,
};

use crate::dice::Dice;

/// How long a byte takes at 24 MHz.
const BYTE: Ns = 333;
/// Longer than the processing time of a packet in a chip of these tests.
const PACKETS_APART: Ns = 3_000_000;
/// The PHY and the register whose values are recorded.
pub const REGISTER: (u8, u8) = (1, 5);
/// The address in the flash memory to which numbers are written.
pub const FLASH_AT: usize = 0x100;

/// Times of a chip that starts, and changes its slaves' states, as fast as schedules need it, and works `packet_ns` on
/// a packet.
pub fn quick(packet_ns: Ns) -> ChipTiming {
    const MS: Ns = 1_000_000;
    ChipTiming {
        start_ns: 50 * MS,
        port_ns: 20 * MS,
        packet_ns,
        init_ns: 5 * MS,
        slave_ns: MS,
        reconfig_ns: 2 * MS,
        to_preop_ns: 5 * MS,
        to_safeop_ns: 5 * MS,
        to_op_ns: 5 * MS,
        down_ns: 2 * MS,
        ..ChipTiming::default()
    }
}

/// A fault of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// Bits of the command are flipped.
    FlippedToChip,
    /// Bits of the answer are flipped.
    FlippedToHost,
    /// The chip misses clock pulses: from there on it is behind the host.
    LostClocks,
    /// The chip sees clock pulses that the host has not sent.
    ExtraClocks,
    /// The exchange fails before its end, and the host gets no byte.
    Failed,
    /// The host gets only the beginning of the answer.
    Truncated,
    /// The packet is sent twice; the host gets the first answer, or the second one.
    Repeated,
    /// The host gets the answer of the previous exchange once more.
    Late,
    /// The host gets an answer to a command that it has never sent.
    Stranger,
    /// The chip is reset.
    Reset,
    /// The chip's packets have another size from now on.
    Resized,
}

/// The weight of each kind among all faults.
const FAULTS: [(Fault, u64); 11] = [
    (Fault::FlippedToChip, 60),
    (Fault::FlippedToHost, 60),
    (Fault::LostClocks, 4),
    (Fault::ExtraClocks, 4),
    (Fault::Failed, 10),
    (Fault::Truncated, 20),
    (Fault::Repeated, 20),
    (Fault::Late, 20),
    (Fault::Stranger, 20),
    (Fault::Reset, 1),
    (Fault::Resized, 1),
];

impl Fault {
    /// A random fault, in one of `rarely` exchanges.
    pub fn random(rarely: u64, dice: &mut Dice) -> Option<Self> {
        if !dice.one_in(rarely) {
            return None;
        }
        let mut at = dice.below(FAULTS.iter().map(|(_, weight)| weight).sum());
        let (fault, _) = FAULTS.iter().find(|(_, weight)| {
            let found = at < *weight;
            at = at.wrapping_sub(*weight);
            found
        })?;
        Some(*fault)
    }
}

/// The wire and the chip.
pub struct Wire<N: SlaveNetwork> {
    /// The chip's end of the wire.
    pub port: ChipPort<N>,
    last_answer: Vec<u8>,
    /// The successive values of the register and of the flash memory.
    pub registers: Vec<u16>,
    pub flash: Vec<u32>,
}

impl<N: SlaveNetwork> Wire<N> {
    /// A wire to that chip.
    pub fn new(chip: Chip<N>) -> Self {
        Self { port: ChipPort::new(chip), last_answer: Vec::new(), registers: Vec::new(), flash: Vec::new() }
    }

    /// Clocks a packet out and in. Returns the time of its end, and the answer.
    pub fn exchange(&mut self, now: Ns, packet: &[u8], fault: Option<Fault>, dice: &mut Dice) -> (Ns, Vec<u8>) {
        let end = now + BYTE * packet.len() as Ns;
        let answer = self.faulty(end, packet, fault, dice);
        self.look();
        (end, answer)
    }

    fn faulty(&mut self, end: Ns, packet: &[u8], fault: Option<Fault>, dice: &mut Dice) -> Vec<u8> {
        let mut packet = packet.to_vec();
        if fault == Some(Fault::FlippedToChip) {
            flip(&mut packet, dice);
        }
        let at = dice.below(packet.len() as u64 + 1) as usize;
        let mut answer = match fault {
            Some(Fault::LostClocks) => {
                let lost = (dice.below(40) as usize).min(packet.len() - at);
                let mut answer = self.clock(end, &packet[..at]);
                answer.resize(at + lost, dice.pick(&[0, 0xFF]));
                answer.extend(self.clock(end, &packet[at + lost..]));
                answer
            }
            Some(Fault::ExtraClocks) => {
                let mut answer = self.clock(end, &packet[..at]);
                self.clock(end, &vec![0; 1 + dice.below(40) as usize]);
                answer.extend(self.clock(end, &packet[at..]));
                answer
            }
            Some(Fault::Failed) => {
                self.clock(end, &packet[..at]);
                Vec::new()
            }
            Some(Fault::Repeated) => {
                let first = self.clock(end, &packet);
                let second = self.clock(end + dice.pick(&[0, 1_000_000]), &packet);
                if dice.one_in(2) { first } else { second }
            }
            _ => self.clock(end, &packet),
        };
        let before = std::mem::replace(&mut self.last_answer, answer.clone());
        match fault {
            Some(Fault::FlippedToHost) => flip(&mut answer, dice),
            Some(Fault::Truncated) => answer.truncate(at),
            Some(Fault::Late) if before.len() == answer.len() => answer = before,
            Some(Fault::Stranger) => answer = stranger(answer, dice),
            _ => {}
        }
        answer
    }

    fn clock(&mut self, now: Ns, to_chip: &[u8]) -> Vec<u8> {
        let mut from_chip = vec![0; to_chip.len()];
        self.port.transfer(now, to_chip, &mut from_chip);
        from_chip
    }

    /// The chip is reset as by its reset line.
    pub fn reset(&mut self, now: Ns) {
        reset_chip(self.port.chip_mut(), now);
    }

    /// The chip changes the size of its packets by itself, if the size differs. A packet between two copies of another
    /// one would make that one run twice.
    pub fn resize(&mut self, now: Ns, size: DataSize) {
        if size != self.port.chip().size() {
            give(self.port.chip_mut(), now, &SpiReconfig { size });
        }
    }

    /// Records what has changed in the chip.
    fn look(&mut self) {
        let chip = self.port.chip_mut();
        let register = *chip.phy_register_mut(REGISTER.0, REGISTER.1).expect("there is one");
        let flash = chip.flash()[FLASH_AT..].first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
        if register != 0 && self.registers.last() != Some(&register) {
            self.registers.push(register);
        }
        if flash != u32::MAX && self.flash.last() != Some(&flash) {
            self.flash.push(flash);
        }
    }
}

/// The chip is reset as by its reset line.
pub fn reset_chip<N: SlaveNetwork>(chip: &mut Chip<N>, now: Ns) {
    give(chip, now, &WarmReset);
}

/// Gives the chip a packet, bypassing the wire, with one check word or the other.
fn give<N: SlaveNetwork>(chip: &mut Chip<N>, now: Ns, request: &impl Encode) {
    let mut now = now.max(chip.now());
    for rule in [CheckRule::CRC32, CheckRule::FIXED] {
        now += PACKETS_APART;
        let mut buffer = [0; MAX_PACKET];
        let header = CommandHeader::with_index(0);
        let packet = write_request(&mut buffer, chip.size(), rule, header, request).expect("it fits");
        chip.exchange(now, packet, &mut []);
    }
}

/// Inverts a few bits anywhere, or some successive bytes.
fn flip(bytes: &mut [u8], dice: &mut Dice) {
    let len = bytes.len() as u64;
    if dice.one_in(4) {
        let from = dice.below(len) as usize;
        let burst = bytes[from..].iter_mut().take(1 + dice.below(32) as usize);
        burst.for_each(|byte| *byte ^= dice.roll() as u8);
    } else {
        for _ in 0..=dice.below(3) {
            bytes[dice.below(len) as usize] ^= 1 << dice.below(8);
        }
    }
}

/// The answer with another index, code or both, and a right check word.
fn stranger(answer: Vec<u8>, dice: &mut Dice) -> Vec<u8> {
    let size = answer.len().checked_sub(32).and_then(DataSize::new);
    let Some(size) = size else { return answer };
    let Ok(Received::Answer(parsed)) = AnswerPacket::parse(&answer, size, CrcCoverage::All) else { return answer };
    let Ok(kind) = parsed.header.status.check_type() else { return answer };
    let mut header = parsed.header;
    if dice.one_in(2) {
        // An index that the host has not just sent.
        header.index = header.index.wrapping_add(100 + dice.below(50) as u8);
    } else {
        header.code = CommandCode::from_code(200 + dice.below(50) as u8);
    }
    let mut buffer = [0; MAX_PACKET];
    let data = &parsed.data[..usize::from(header.len).min(parsed.data.len())];
    let rule = CheckRule { kind, coverage: CrcCoverage::All };
    write_answer(&mut buffer, size, rule, header, &data).expect("it fits").to_vec()
}
