//! Decodes a packet of an ECM-XF, and describes it as text.

use ecmsk::link::Dir;
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, CommandPacket, CrcCoverage, DataSize, END_WORD,
    Errors, PacketError, Received, START_WORD, Status,
};

use super::place::Place;

/// The largest number of data bytes of an answer that are shown. \[OURS]
const DATA_SHOWN: usize = 16;

/// The bytes of a packet of an ECM-XF, with its position in the input.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'p> {
    /// The number, time and direction of the packet.
    pub place: Place,
    /// The bytes as they were transferred.
    pub bytes: &'p [u8],
}

impl<'p> Packet<'p> {
    /// The direction as a word: `command` or `answer`.
    pub const fn direction_name(&self) -> &'static str {
        direction_name(self.place.direction)
    }

    /// Decodes the bytes according to the direction of the packet.
    pub fn decoded(&self) -> Decoded<'p> {
        Decoded::of(self.place.direction, self.bytes)
    }
}

/// A direction as a word: `command` or `answer`.
pub const fn direction_name(direction: Dir) -> &'static str {
    match direction {
        Dir::Write => "command",
        Dir::Read => "answer",
    }
}

/// Whether the bytes are a packet of an ECM-XF: their length, start word and end word are right.
pub fn is_packet(bytes: &[u8]) -> bool {
    DataSize::of_packet(bytes.len()).is_some()
        && bytes.starts_with(&START_WORD.to_le_bytes())
        && bytes.ends_with(&END_WORD.to_le_bytes())
}

/// Guesses the direction of a packet. \[OURS] In an answer, bytes 8 to 10 have a state, a link level or a check type.
/// In a command these bytes are reserved or clear errors.
pub fn guessed(bytes: &[u8]) -> Dir {
    let Some(&[state, levels, status]) = bytes.get(0x08..0x0B).and_then(|bytes| bytes.first_chunk()) else {
        return Dir::Write;
    };
    let has_state = matches!(state & 0x0F, 1..=4 | 8) && state & 0xE0 == 0;
    let has_link = levels & (Errors::LINK_PIN | Errors::PHY_LINK).0 != 0;
    let has_crc = matches!(Status(status).check_type(), Ok(CheckType::Crc32));
    if has_state || has_link || has_crc { Dir::Read } else { Dir::Write }
}

/// The bytes of a packet in one direction, decoded.
pub enum Decoded<'p> {
    /// A command, and the type of its check word (a fixed word or a CRC).
    Command { packet: CommandPacket<'p>, check: CheckType },
    /// An answer of the chip, and its data.
    Answer { header: AnswerHeader, data: &'p [u8] },
    /// The chip's answer "not ready": it was still processing the previous packet.
    NotReady,
    /// The length is that of a packet, but the content is not valid.
    Damaged(PacketError),
    /// The length is not that of a packet: the driver was searching for the packet size, or transferred a packet in
    /// parts.
    NoPacket(usize),
}

impl<'p> Decoded<'p> {
    /// Decodes the bytes of one exchange in this direction.
    pub fn of(direction: Dir, bytes: &'p [u8]) -> Self {
        let Some(size) = DataSize::of_packet(bytes.len()) else { return Self::NoPacket(bytes.len()) };
        match direction {
            Dir::Write => {
                let parse = |rule: CheckRule| {
                    let check = rule.kind;
                    CommandPacket::parse(bytes, size, rule).map(|packet| Self::Command { packet, check })
                };
                let crc = |coverage| parse(CheckRule { coverage, ..CheckRule::CRC32 });
                parse(CheckRule::FIXED).or_else(|_| first_right(crc)).unwrap_or_else(Self::Damaged)
            }
            Dir::Read => {
                let parse = |coverage| AnswerPacket::parse(bytes, size, coverage);
                match first_right(parse) {
                    Ok(Received::Answer(AnswerPacket { header, data })) => Self::Answer { header, data },
                    Ok(Received::NotReady) => Self::NotReady,
                    Err(error) => Self::Damaged(error),
                }
            }
        }
    }

    /// The decoded packet, as lines of text.
    pub fn lines(&self) -> Vec<String> {
        match self {
            Self::Command { packet, check } => {
                let header = &packet.header;
                let asked = match packet.request() {
                    // The debug text of a request has its type twice, so the outer one is removed.
                    Ok(request) => {
                        let text = format!("{request:?}");
                        let inner =
                            text.split_once('(').and_then(|(_, rest)| rest.strip_suffix(')')).map(str::to_owned);
                        inner.unwrap_or(text)
                    }
                    Err(problem) => format!("malformed: {problem}"),
                };
                let mut lines = vec![format!("#{} {}: {asked}", header.index, name(header.code))];
                let control = header.control.0;
                lines.push(format!("control 0x{control:02X}, length {}, check {}", header.len, word(*check)));
                lines
            }
            Self::Answer { header, data } => {
                let nop = header.status.contains(Status::NOP);
                let what = if nop { "NOP, no result".to_owned() } else { result(header, data) };
                vec![format!("#{} {}: {what}", header.index, name(header.code)), levels(header)]
            }
            Self::NotReady => vec!["not ready: the command of this exchange is lost".to_owned()],
            Self::Damaged(problem) => vec![format!("damaged: {problem}")],
            Self::NoPacket(count) => vec![format!("{count} bytes, as no packet has")],
        }
    }
}

/// Parses with each check coverage (the range of bytes that the CRC includes) and returns the first valid result. If
/// none is valid, returns the error of the first coverage.
fn first_right<T>(parse: impl Fn(CrcCoverage) -> Result<T, PacketError>) -> Result<T, PacketError> {
    let others = || CrcCoverage::EVERY.into_iter().skip(1);
    parse(CrcCoverage::EVERY[0]).or_else(|error| others().find_map(|coverage| parse(coverage).ok()).ok_or(error))
}

fn result(header: &AnswerHeader, data: &[u8]) -> String {
    let valid = &data[..usize::from(header.len).min(data.len())];
    let mut text = format!("ret 0x{:02X}", header.ret);
    if !valid.is_empty() {
        let more = if valid.len() > DATA_SHOWN { " .." } else { "" };
        let bytes = digits(&valid[..valid.len().min(DATA_SHOWN)]);
        text.push_str(&format!(", {} bytes of data: {bytes}{more}", valid.len()));
    }
    text
}

/// The fields that every answer has in addition to its result: state, errors, FIFO levels, CRC errors.
fn levels(header: &AnswerHeader) -> String {
    let state = match header.state.state() {
        Some(state) => format!("{state:?}"),
        None => format!("0x{:02X}", header.state.0),
    };
    let failed = if header.state.has_error() { " with an error" } else { "" };
    let errors = header.errors.0 & Errors::ALL.0;
    let errors = if errors == 0 { "none".to_owned() } else { format!("0x{errors:02X}") };
    let busy = if header.status.contains(Status::BUSY) { ", busy" } else { "" };
    format!(
        "state {state}{failed}, errors {errors}, RxFIFO {}, TxFIFO {}, CRC errors {}{busy}",
        header.rx_fifo, header.tx_fifo, header.crc_errors
    )
}

const fn word(check: CheckType) -> &'static str {
    match check {
        CheckType::Fixed => "fixed",
        CheckType::Crc32 => "CRC-32",
    }
}

fn name(code: CommandCode) -> String {
    code.name().map_or_else(|| format!("code {}", code.code()), str::to_owned)
}

/// The bytes as hexadecimal digits, separated by spaces.
pub fn digits(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}
