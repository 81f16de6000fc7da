//! One exchange of packets: which answer is sent, what a command packet does besides its command, and what the next
//! answer contains.

use super::Chip;
use super::commands::CommandOutcome;
use super::network::SlaveNetwork;
use crate::ethercat::Ns;
use crate::xf::header::CommandHeader;
use crate::xf::packet::{write_answer, write_not_ready};
use crate::xf::response::{Answer, Returned};
use crate::xf::{
    AnswerHeader, CheckRule, CheckType, CommandCode, CommandPacket, Control, CrcCoverage, DataSize, Errors, HEADER_LEN,
    Interrupts, MAX_PACKET, Malformed, PacketError, Request, Reserve, Status,
};

/// Mask of GPIO 0 to 11, which the header of a command packet drives with every firmware (XF EN 211).
const HEADER_OUTPUTS: u16 = 0x0FFF;

/// The answer packet that the next exchange sends.
pub(super) struct Prepared {
    pub bytes: [u8; MAX_PACKET],
    /// The header of the prepared packet, which is also the header of a "not ready" answer.
    pub header: AnswerHeader,
    /// The length of the prepared packet, bytes.
    pub len: usize,
}

/// An answer whose return byte and data are encoded already, so that writing the packet only copies them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Encoded<'a> {
    ret: u8,
    data: &'a [u8],
}

impl<'a> Answer<'a> for Encoded<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let Returned { len, .. } = self.data.encode(data)?;
        Ok(Returned { ret: self.ret, len })
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        <&[u8]>::decode(returned, data).map(|data| Self { ret: returned.ret, data })
    }
}

/// The outcome of a command packet: the fields from which the answer packet is built, without the answer's data.
struct Reply {
    index: u8,
    code: CommandCode,
    returned: Returned,
    is_nop: bool,
}

impl Reply {
    /// An answer without a result, with the NOP flag in its status. `[OURS]` It repeats index and code of the command too.
    const fn nop(header: &CommandHeader) -> Self {
        Self { index: header.index, code: header.code, returned: Returned::NONE, is_nop: true }
    }
}

impl<N: SlaveNetwork> Chip<N> {
    /// Makes one exchange, whose last byte is transferred at `now`: the chip receives a command packet and sends the
    /// answer to the previous one. `command` has n + 32 bytes, see [`Self::size`]; any other length is a framing error.
    /// `answer` receives as much of the answer packet as it has room for, followed by zeros.
    ///
    /// While the chip is not ready ([`Self::is_ready`]) it answers with the check word
    /// [`NOT_READY`](crate::xf::NOT_READY) (OBS). `[OURS]` The command is then lost, and the prepared answer is sent in
    /// the next exchange.
    pub fn exchange(&mut self, now: Ns, command: &[u8], answer: &mut [u8]) {
        self.run_until(now);
        let is_ready = self.is_ready();
        let (packet, behind) = answer.split_at_mut(self.outgoing_len(is_ready).min(answer.len()));
        self.put_outgoing(is_ready, packet);
        behind.fill(0);
        if is_ready {
            self.take(command);
        }
    }

    /// Whether the chip accepts the next packet: it has started, and has processed the last packet.
    pub const fn is_ready(&self) -> bool {
        self.now >= self.ready_at
    }

    /// The length of the packet to send: the prepared answer, or a "not ready" packet of the present packet length.
    pub(super) const fn outgoing_len(&self, is_ready: bool) -> usize {
        if is_ready { self.prepared.len } else { self.size.packet_len() }
    }

    /// Writes the packet to send, cut to the length of `room`.
    pub(super) fn put_outgoing(&self, is_ready: bool, room: &mut [u8]) {
        if is_ready {
            return room.copy_from_slice(&self.prepared.bytes[..room.len()]);
        }
        let mut bytes = [0; MAX_PACKET];
        // Cannot fail: the buffer has room for the longest packet.
        let _ = write_not_ready(&mut bytes, self.size, self.prepared.header);
        room.copy_from_slice(&bytes[..room.len()]);
    }

    /// Processes a command packet and prepares the answer to it.
    pub(super) fn take(&mut self, command: &[u8]) {
        // The FIFO levels are read before the command runs, and the answer is sent in the next exchange. So the levels
        // in an answer do not yet include the effect of the command that it answers (OBS).
        let counts = self.fifos.counts();
        let mut data = [0; DataSize::MAX.bytes()];
        let size = self.size;
        let reply = match self.parse(command) {
            Ok(packet) => self.run_packet(&packet, &mut data[..size.bytes()]),
            Err((error, header)) => {
                self.count_damage(error);
                Reply::nop(&header)
            }
        };
        if self.restarts {
            return self.restart();
        }
        self.prepare(&reply, counts, &data);
        self.ready_at = self.now + self.timing.packet_ns;
    }

    /// Parses a command packet, whose check word has to be of the type that CRC_TYPE_SET has set last. `[OURS]` CRC_TYPE_SET
    /// itself may also have the fixed check word. The new type applies from its answer on.
    fn parse<'p>(&self, bytes: &'p [u8]) -> Result<CommandPacket<'p>, (PacketError, CommandHeader)> {
        let rule = self.check_rule(self.profile.coverages.commands);
        CommandPacket::parse(bytes, self.size, rule).or_else(|error| {
            let head = bytes.first_chunk::<HEADER_LEN>().map(|head| CommandHeader::decode(head).1);
            let header = head.unwrap_or_default();
            let fixed = CommandPacket::parse(bytes, self.size, CheckRule { kind: CheckType::Fixed, ..rule });
            match (header.code, fixed) {
                (CommandCode::CrcTypeSet, Ok(packet)) => Ok(packet),
                _ => Err((error, header)),
            }
        })
    }

    const fn check_rule(&self, coverage: CrcCoverage) -> CheckRule {
        CheckRule { kind: self.check, coverage }
    }

    /// Sets error bits, which stay set until the header of a command clears them.
    pub(super) fn raise(&mut self, error: Errors) {
        self.errors = self.errors | error;
        self.not_shown = self.not_shown | error;
    }

    /// Counts a damaged packet, which is not run. `[OURS]` A wrong check word sets error bit 6 and interrupt 23, a
    /// wrong start or end word sets error bit 4, and the answer has the NOP flag.
    fn count_damage(&mut self, error: PacketError) {
        self.crc_errors = self.crc_errors.saturating_add(1);
        if matches!(error, PacketError::CheckWord { .. }) {
            self.interrupts.raise(Interrupts::CRC);
            self.raise(Errors::CRC);
        } else {
            self.raise(Errors::SPI);
        }
    }

    /// Runs a valid packet. `[OURS]` A packet with the index and code of the previous one is a repetition: its command is not
    /// run again, and only its header takes effect, except for a request to update the states.
    fn run_packet(&mut self, packet: &CommandPacket<'_>, data: &mut [u8]) -> Reply {
        let header = &packet.header;
        self.take_header(header);
        let is_repeated = self.previous.replace((header.index, header.code)) == Some((header.index, header.code));
        if is_repeated {
            return Reply::nop(header);
        }
        let was_busy = self.job.is_some();
        let outcome = self.run_command(packet, data);
        let updates = header.control.contains(Control::UPDATE_STATE);
        if outcome.is_err() || updates && !self.start_update(was_busy) {
            self.raise(Errors::COMMAND);
        }
        let returned = outcome.unwrap_or(Returned::NONE);
        Reply { index: header.index, code: header.code, returned, is_nop: false }
    }

    fn run_command(&mut self, packet: &CommandPacket<'_>, data: &mut [u8]) -> CommandOutcome {
        let request = packet.request();
        self.unknown_commands += u64::from(matches!(request, Ok(Request::Unknown(_))));
        let outcome = request.map_err(Into::into).and_then(|request| self.run(&request, data));
        if outcome.is_err() {
            data.fill(0);
        }
        outcome
    }

    /// Applies a header: clears errors and interrupt flags, and drives GPIOs.
    ///
    /// `[OURS]` A bit of the header clears an error only after an answer to a command has shown the error; answers with the NOP
    /// flag do not count. One client sets all these bits in every packet from the first error on, but looks for errors only in
    /// the answers to its commands (OBS). If the bits acted earlier, it would never see another error.
    fn take_header(&mut self, header: &CommandHeader) {
        let shown = self.errors.without(self.not_shown);
        self.errors = self.errors.without(Errors(shown.0 & header.control.0 & Control::CLEAR_ALL.0));
        self.interrupts.clear(header.interrupt_clear);
        if header.interrupt_clear.contains(Interrupts::ENCODER) {
            self.encoder.flags = Default::default();
        }
        self.gpio.clear(header.gpio_interrupt_clear.into());
        if header.reserve.contains(Reserve::GPIO_OUTPUTS_VALID) {
            let (pins, values) = self.header_outputs(header.gpio_outputs);
            self.gpio.set_outputs(self.now, pins.into(), values.into());
        }
    }

    /// The pins that the header drives, and their values. From firmware 0x1E on these include 12 to 15, where bit 12 is
    /// GPIO 13 and bit 13 is GPIO 12 (XF ZH 246).
    const fn header_outputs(&self, bits: u16) -> (u16, u16) {
        if !self.profile.has_wide_header_outputs() {
            return (HEADER_OUTPUTS, bits);
        }
        (u16::MAX, bits & 0xCFFF | (bits & 0x1000) << 1 | (bits & 0x2000) >> 1)
    }

    fn prepare(&mut self, reply: &Reply, (rx_fifo, tx_fifo): (u8, u8), data: &[u8]) {
        let header = AnswerHeader {
            crc_errors: self.crc_errors,
            wkc_errors: self.bus.wkc_errors,
            tx_fifo,
            rx_fifo,
            state: self.bus.state_of_all(),
            errors: self.errors | self.levels(),
            status: self.status(reply.is_nop).with_check_type(self.check),
            index: reply.index,
            code: reply.code,
            ret: 0,
            len: 0,
            interrupts: self.interrupts.word(self.encoder.flags),
            gpio_interrupts: self.gpio.flags() as u16,
            gpio_inputs: self.gpio.values() as u16,
        };
        if !reply.is_nop {
            self.not_shown = Errors::NONE;
        }
        let Returned { ret, len } = reply.returned;
        let answer = Encoded { ret, data: &data[..usize::from(len).min(data.len())] };
        let rule = self.check_rule(self.profile.coverages.answers);
        let bytes = &mut self.prepared.bytes;
        let written = write_answer(bytes, self.size, rule, header, &answer).map(<[u8]>::len);
        // If the size has just become smaller than the answer, the answer is sent without its data.
        let without = |bytes| write_answer(bytes, self.size, rule, header, &()).map_or(0, <[u8]>::len);
        self.prepared.len = written.unwrap_or_else(|_| without(&mut self.prepared.bytes));
        self.prepared.header = header;
    }

    /// Prepares the first answer after the start, when there was no command to answer (XF EN 169).
    pub(super) fn prepare_first(&mut self) {
        self.prepare(&Reply::nop(&CommandHeader::default()), (0, 0), &[]);
    }

    /// The bits 0 to 2 of byte 0x09, which show present conditions instead of errors: link pin, PHY link, error bit of a slave.
    fn levels(&self) -> Errors {
        let bit = |on, bit| if on { bit } else { Errors::NONE };
        bit(self.network.has_link(), Errors::LINK_PIN)
            | bit(self.phy_link, Errors::PHY_LINK)
            | bit(self.bus.state_of_all().has_error(), Errors::STATE)
    }

    fn status(&self, is_nop: bool) -> Status {
        let bit = |on, bit| if on { bit } else { Status::NONE };
        bit(self.bus.dc_stable_at.is_some_and(|at| at <= self.now), Status::DC_STABLE)
            | bit(self.port_ready_at <= self.now, Status::PORT_READY)
            | bit(self.bus.mapped, Status::PDO_CONFIGURED)
            | bit(is_nop, Status::NOP)
            | bit(self.fifo_on, Status::FIFO_ON)
            | bit(self.job.is_some(), Status::BUSY)
    }
}
