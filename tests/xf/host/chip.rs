//! A chip for the tests of the driver: a stream of bytes each way, the rules about packets, busy times and FIFOs, and
//! no network. It records the commands that it ran.

use std::collections::VecDeque;

use ecmsk::xf::packet::write_not_ready;
use ecmsk::xf::request::{PdoOperation, Request, SdoOperation, SlaveInfoItem};
use ecmsk::xf::response::{Answer, PdoExchange, Returned};
use ecmsk::xf::{
    AnswerHeader, CheckRule, CheckType, CommandCode, CommandPacket, CrcCoverage, CrcCoverages, DataSize, Errors,
    MAX_PACKET, Malformed, Status, write_answer,
};

/// A result that is already bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bytes<'a>(u8, &'a [u8]);

impl<'a> Answer<'a> for Bytes<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        data[..self.1.len()].copy_from_slice(self.1);
        Ok(Returned { ret: self.0, len: self.1.len() as u16 })
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Ok(Self(returned.ret, data))
    }
}

/// A fault of an exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    #[default]
    None,
    /// A bit of the host's packet is inverted.
    ToChip(usize),
    /// A bit of the chip's answer is inverted.
    ToHost(usize),
    /// The chip is not ready: it takes nothing and keeps its answer.
    NotReady,
    /// The chip takes nothing and sends zeros.
    Zeros,
    /// The exchange fails at the host, although the chip has got it.
    Lost,
    /// The due answer is sent twice, and the others later.
    Doubled,
    /// The due answer never comes: the previous one is sent again.
    Replaced,
    /// The due answer comes after the next one.
    Late,
    /// An answer to a command that was not sent comes in between.
    Stranger,
    /// The chip is reset before the exchange.
    Reset,
}

/// One TxPDO per cycle, 8 bytes.
pub const PDO: usize = 8;

pub struct Chip {
    pub start: DataSize,
    pub size: DataSize,
    pub kind: CheckType,
    pub coverages: CrcCoverages,
    /// Whether its CRC-32 is an unknown one: of its answers, and of the packets that it takes.
    pub strange: [bool; 2],
    /// Packets for which a non-immediate command keeps the chip busy.
    pub busy_for: u32,
    /// Packets between two cycles.
    pub cycle: u32,
    pub rx_entries: usize,
    /// All commands that were run, with the arguments that distinguish them.
    pub ran: Vec<(CommandCode, u32)>,
    /// The indices of all packets that were taken, with their codes.
    pub taken: Vec<(u8, CommandCode)>,
    pub put_out: Vec<u32>,
    pub rx: VecDeque<u32>,
    pub tx: VecDeque<u32>,
    pub fifo_on: bool,
    /// SPI_RECONFIG_OP sets the fixed check word too.
    pub resize_resets_kind: bool,
    /// A command that the chip refuses.
    pub refused: Option<CommandCode>,
    /// The answer of SPI_PACK_SIZE_GET, if it is not n.
    pub claims: Option<DataSize>,
    pub crc_errors: u8,
    pub errors: Errors,
    /// Errors that cannot be cleared.
    pub stays: Errors,
    busy: u32,
    fails: bool,
    last: Option<(u8, CommandCode)>,
    input: Vec<u8>,
    answers: VecDeque<Vec<u8>>,
    previous: Vec<u8>,
    sdo: u32,
    packets: u32,
}

impl Chip {
    pub fn new(size: DataSize) -> Self {
        let mut chip = Self {
            start: size,
            size,
            kind: CheckType::Fixed,
            coverages: CrcCoverages::default(),
            strange: [false; 2],
            busy_for: 6,
            cycle: 3,
            rx_entries: 64,
            ran: Vec::new(),
            taken: Vec::new(),
            put_out: Vec::new(),
            rx: VecDeque::new(),
            tx: VecDeque::new(),
            fifo_on: false,
            resize_resets_kind: false,
            refused: None,
            claims: None,
            crc_errors: 0,
            errors: Errors::NONE,
            stays: Errors::NONE,
            busy: 0,
            fails: false,
            last: None,
            input: Vec::new(),
            answers: VecDeque::new(),
            previous: Vec::new(),
            sdo: 0,
            packets: 0,
        };
        chip.reset();
        chip
    }

    pub fn reset(&mut self) {
        (self.size, self.kind) = (self.start, CheckType::Fixed);
        (self.busy, self.fails, self.last, self.fifo_on) = (0, false, None, false);
        (self.crc_errors, self.errors) = (0, Errors::NONE);
        self.rx.clear();
        self.tx.clear();
        self.input.clear();
        self.answers.clear();
        self.answer(0, CommandCode::InfoUpdate, Status::NOP, Bytes(0, &[]), 0);
    }

    /// Clocks bytes, which are divided into packets.
    pub fn clock(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        for byte in bytes {
            out.push(self.answers[0][self.input.len()]);
            self.input.push(*byte);
            if self.input.len() == self.size.packet_len() {
                let packet = std::mem::take(&mut self.input);
                self.previous = self.answers.pop_front().expect("an answer");
                self.take(&packet);
            }
        }
        out
    }

    pub fn exchange(&mut self, bytes: &[u8], fault: Fault) -> Vec<u8> {
        let mut sent = bytes.to_vec();
        match fault {
            Fault::ToChip(bit) => flip(&mut sent, bit),
            Fault::NotReady => {
                let mut buffer = [0; MAX_PACKET];
                let packet =
                    write_not_ready(&mut buffer, self.size, self.header(0, CommandCode::InfoUpdate, Status::NOP));
                let mut packet = packet.expect("it fits").to_vec();
                packet.resize(bytes.len(), 0);
                return packet;
            }
            Fault::Zeros => return vec![0; bytes.len()],
            Fault::Doubled if self.answers.len() < 2 => self.answers.push_front(self.previous_or_due()),
            Fault::Replaced => self.answers[0] = self.previous_or_due(),
            Fault::Reset => self.reset(),
            Fault::Stranger if self.answers.len() < 2 => {
                let due = self.answers.pop_front().expect("an answer");
                self.answer(0, CommandCode::SdoGet, Status::NONE, Bytes(9, &[9; 20]), 0);
                self.answers.push_back(due);
            }
            Fault::Late if self.answers.len() > 1 => self.answers.swap(0, 1),
            _ => {}
        }
        let mut back = self.clock(&sent);
        match fault {
            Fault::ToHost(bit) => flip(&mut back, bit),
            Fault::Lost => back.clear(),
            _ => {}
        }
        back
    }

    fn previous_or_due(&self) -> Vec<u8> {
        let due = &self.answers[0];
        if self.previous.len() == due.len() { self.previous.clone() } else { due.clone() }
    }

    pub fn is_busy(&self) -> bool {
        self.busy > 0
    }

    /// Starts a command that does not end.
    pub fn keep_busy(&mut self) {
        self.busy = u32::MAX;
    }

    fn rule(&self, coverage: CrcCoverage) -> CheckRule {
        CheckRule { kind: self.kind, coverage }
    }

    fn header(&self, index: u8, code: CommandCode, status: Status) -> AnswerHeader {
        let busy = if self.busy > 0 { Status::BUSY } else { Status::NONE };
        AnswerHeader {
            index,
            code,
            crc_errors: self.crc_errors,
            errors: self.errors,
            status: status | busy,
            rx_fifo: self.rx.len() as u8,
            tx_fifo: self.tx.len() as u8,
            ..AnswerHeader::default()
        }
    }

    /// Queues an answer; its count of RxPDOs is the one before the command.
    fn answer(&mut self, index: u8, code: CommandCode, status: Status, result: Bytes<'_>, rx_fifo: u8) {
        let mut buffer = [0xA5; MAX_PACKET];
        let header = AnswerHeader { rx_fifo, ..self.header(index, code, status) };
        let rule = self.rule(self.coverages.answers);
        let mut packet = write_answer(&mut buffer, self.size, rule, header, &result).expect("it fits").to_vec();
        if self.strange[0] && self.kind == CheckType::Crc32 {
            let check = packet.len() - 8;
            packet[check] ^= 0xFF;
        }
        self.answers.push_back(packet);
    }

    fn take(&mut self, bytes: &[u8]) {
        self.packets += 1;
        let counted = self.rx.len() as u8;
        if self.packets.is_multiple_of(self.cycle) {
            self.cycle();
        }
        if self.busy > 0 {
            self.busy -= 1;
            if self.busy == 0 && std::mem::take(&mut self.fails) {
                self.errors = self.errors | Errors::NON_IMMEDIATE;
            }
        }
        let parsed = CommandPacket::parse(bytes, self.size, self.rule(self.coverages.commands));
        let is_strange = self.strange[1] && self.kind == CheckType::Crc32;
        let parsed = parsed.map_err(drop).and_then(|packet| if is_strange { Err(()) } else { Ok(packet) });
        let fixed = || CommandPacket::parse(bytes, self.size, CheckRule::FIXED).ok();
        let either = parsed.ok().or_else(|| fixed().filter(|packet| packet.header.code == CommandCode::CrcTypeSet));
        let Some(packet) = either else {
            self.crc_errors = self.crc_errors.saturating_add(1);
            self.errors = self.errors | Errors::CRC;
            let (index, code) = (bytes[0x0B], CommandCode::from_code(bytes[0x0C]));
            self.answer(index, code, Status::NOP, Bytes(0, &[]), counted);
            return;
        };
        let (index, code) = (packet.header.index, packet.header.code);
        self.errors = Errors(self.errors.0 & !packet.header.control.0) | self.stays;
        if self.last.replace((index, code)) == Some((index, code)) {
            self.answer(index, code, Status::NOP, Bytes(0, &[]), counted);
            return;
        }
        self.taken.push((index, code));
        // With the fixed check word a damaged packet may pass, and be no request of the manuals.
        let Ok(request) = packet.request() else {
            assert_eq!(self.kind, CheckType::Fixed, "the driver sends valid requests");
            self.errors = self.errors | Errors::COMMAND;
            self.answer(index, code, Status::NONE, Bytes(0, &[]), counted);
            return;
        };
        let mut data = Vec::new();
        let ret = self.run(&request, &packet, &mut data);
        let nop = if code == CommandCode::InfoUpdate { Status::NOP } else { Status::NONE };
        self.answer(index, code, nop, Bytes(ret, &data), counted);
        if let Request::SpiReconfig(request) = request {
            self.size = request.size;
            if self.resize_resets_kind {
                self.kind = CheckType::Fixed;
            }
            self.answers.clear();
            self.answer(index, code, Status::NONE, Bytes(0, &[]), counted);
        }
    }

    fn cycle(&mut self) {
        if self.fifo_on
            && let Some(pdo) = self.rx.pop_front()
        {
            self.put_out.push(pdo);
            self.tx.push_back(pdo);
        }
    }

    fn run(&mut self, request: &Request<'_>, packet: &CommandPacket<'_>, data: &mut Vec<u8>) -> u8 {
        let mark = |data: &[u8]| u32::from_le_bytes(data[..4].try_into().expect("4 bytes"));
        let tag = match request {
            Request::SdoRequest(sdo) => match sdo.operation {
                SdoOperation::Write(bytes) => mark(bytes),
                SdoOperation::Read { .. } => sdo.object.index.into(),
            },
            Request::PdoDataFifo(pdo) if pdo.data.len() >= 4 => mark(pdo.data),
            Request::DacSetData(dac) => dac.value.get(),
            Request::SlaveInfoGet(info) => info.slave.get().into(),
            _ => packet.header.parameter.into(),
        };
        if self.refused == Some(request.code()) {
            self.errors = self.errors | Errors::COMMAND;
            return 0;
        }
        if !request.is_immediate() {
            if self.busy > 0 {
                self.errors = self.errors | Errors::COMMAND;
                return 0;
            }
            self.busy = self.busy_for;
        }
        self.ran.push((request.code(), tag));
        match request {
            Request::SpiPackSizeGet(_) => data.extend(self.claims.unwrap_or(self.size).get().to_le_bytes()),
            Request::CrcTypeSet(request) => self.kind = request.kind,
            Request::FirmwareVersionGet(_) => return 0x22,
            Request::FifoEnable(request) => self.fifo_on = request.on,
            Request::FifoClear(_) => self.rx.clear(),
            Request::SlaveInfoGet(info) if info.item == SlaveInfoItem::Vendor => {
                data.extend((1000 + tag).to_le_bytes());
            }
            Request::SdoRequest(_) => (self.sdo, self.fails) = (tag, tag == 0x5555),
            Request::SdoGet(_) => data.extend((self.sdo + 7).to_le_bytes()),
            Request::SdoAbortCodeGet(_) => data.extend(0x0602_0000u32.to_le_bytes()),
            Request::PdoDataFifo(pdo) => return self.process(pdo.count.into(), pdo.operation, pdo.data, data),
            Request::PdoData(_) => data.extend([7; PDO]),
            Request::Unknown(_) => self.errors = self.errors | Errors::COMMAND,
            _ => {}
        }
        0
    }

    fn process(&mut self, count: usize, operation: PdoOperation, outputs: &[u8], data: &mut Vec<u8>) -> u8 {
        let mut done = PdoOperation::NONE;
        if operation.contains(PdoOperation::WRITE) {
            if self.rx.len() + count > self.rx_entries {
                self.errors = self.errors | Errors::FIFO;
            } else {
                done = done | PdoOperation::WRITE;
                let pdos = outputs.chunks(PDO).map(|pdo| u32::from_le_bytes(pdo[..4].try_into().expect("4 bytes")));
                self.rx.extend(pdos);
            }
        }
        if operation.contains(PdoOperation::READ) {
            for _ in 0..count.min(self.tx.len()) {
                let pdo = self.tx.pop_front().expect("counted");
                data.extend(u64::from(pdo).to_le_bytes());
                done = done | PdoOperation::READ;
            }
        }
        PdoExchange { done, data }.done.0
    }
}

/// Inverts the bit with this number, modulo the length.
fn flip(bytes: &mut [u8], bit: usize) {
    let len = bytes.len();
    if len > 0 {
        bytes[bit / 8 % len] ^= 1 << (bit % 8);
    }
}
