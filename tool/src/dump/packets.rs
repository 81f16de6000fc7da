//! Prints the packets of an ECM-XF, from a recording or from hexadecimal digits, as text, as bytes or as JSON.

use std::io::{self, Read, Write};
use std::rc::Rc;

use ecmsk::link::Dir;
use ecmsk::recording::exchanges::{Exchanges, RecordedBytes, is_of_chip};
use ecmsk::recording::{RecordError, RecordMeta};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, CommandPacket, CrcCoverage, DataSize, END_WORD,
    Errors, PacketError, Received, START_WORD, Status,
};
use serde_json::{Value, json};

use super::Args;
use super::pieces::Pieces;
use crate::error::CliError;
use crate::filter::Times;
use crate::stderr::say;
use crate::{output, recording};

/// The bytes that are read to find out whether a file is the recording of a chip. The link in its header may be long.
/// \[OURS]
const BEGINNING: u64 = 128 * 1024;
/// Most bytes of an answer's data that are shown. \[OURS]
const DATA_SHOWN: usize = 16;

/// Returns the source again, and whether it is the recording of a chip.
///
/// # Errors
/// The source cannot be read.
pub fn look(mut source: Box<dyn Read>, name: &str) -> Result<(Box<dyn Read>, bool), RecordError> {
    let mut beginning = Vec::new();
    let read = (&mut source).take(BEGINNING).read_to_end(&mut beginning);
    read.map_err(|error| RecordError::Io { name: name.to_owned(), message: error.to_string() })?;
    let of_chip = is_of_chip(&beginning);
    Ok((Box::new(io::Cursor::new(beginning).chain(source)), of_chip))
}

/// Prints the packets of a recording.
pub fn dump(args: &Args, source: Box<dyn Read>, name: &str) -> Result<(), CliError> {
    let mut out = output::stdout();
    let shown = show(args, source, name, &mut out);
    // The packets before an error are shown as well.
    out.flush()?;
    shown
}

fn show(args: &Args, source: Box<dyn Read>, name: &str, out: &mut output::Out) -> Result<(), CliError> {
    let times = Times { from: args.from, to: args.to };
    let mut exchanges = Exchanges::new(source, name)?;
    let (mut first_ns, mut meta): (Option<u64>, Option<Rc<RecordMeta>>) = (None, None);
    let mut number = 0;
    let mut pieces = [Pieces::default(), Pieces::default()];
    while let Some(recorded) = exchanges.next() {
        let recorded = match recorded {
            Ok(recorded) => recorded,
            Err(error) => {
                write_pieces(out, &mut pieces, args)?;
                return Err(error.into());
            }
        };
        let is_piece = Pieces::is_one(&recorded);
        if !is_piece || exchanges.meta() != meta.as_deref() || pieces.iter().any(Pieces::is_full) {
            write_pieces(out, &mut pieces, args)?;
        }
        if exchanges.meta() != meta.as_deref() {
            meta = exchanges.meta().cloned().map(Rc::new);
            if let Some(meta) = meta.as_deref().filter(|_| !args.json) {
                writeln!(out, "# {}", recording::link_name(meta))?;
            }
        }
        number += 1;
        let since_ns = recorded.at_ns as i64 - *first_ns.get_or_insert(recorded.at_ns) as i64;
        let other_way = args.direction.is_some_and(|direction| direction != recorded.dir);
        if other_way || !times.contains(since_ns) {
            continue;
        }
        if is_piece {
            pieces[usize::from(recorded.dir == Dir::Read)].add(number, since_ns, &recorded);
        } else {
            write_packet(out, number, since_ns, &recorded, args)?;
        }
    }
    write_pieces(out, &mut pieces, args)?;
    let lacks = exchanges.lacks();
    if !lacks.is_nothing() {
        say("note", &format_args!("{name}: {lacks}"));
        if args.json {
            super::json::write_lacks(out, &lacks)?;
        }
    }
    Ok(())
}

const fn direction(dir: Dir) -> &'static str {
    match dir {
        Dir::Write => "command",
        Dir::Read => "answer",
    }
}

fn seconds(since_ns: i64) -> String {
    let (ns, sign) = (since_ns.unsigned_abs(), if since_ns < 0 { "-" } else { "" });
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

fn write_packet(
    out: &mut output::Out,
    number: u64,
    since_ns: i64,
    recorded: &RecordedBytes,
    args: &Args,
) -> io::Result<()> {
    if args.json {
        let mut object = object(recorded);
        object["number"] = number.into();
        object["time_ns"] = since_ns.into();
        object["recorded_ns"] = recorded.at_ns.into();
        return writeln!(out, "{object}");
    }
    writeln!(out, "packet {number:<6} {:>14} s  {}", seconds(since_ns), direction(recorded.dir))?;
    write_lines(out, recorded, args.hex)
}

fn write_lines(out: &mut output::Out, recorded: &RecordedBytes, hex: bool) -> io::Result<()> {
    for line in Shown::of(recorded).lines() {
        writeln!(out, "  {line}")?;
    }
    if hex { write_hex(out, &recorded.bytes) } else { Ok(()) }
}

fn write_hex(out: &mut output::Out, bytes: &[u8]) -> io::Result<()> {
    bytes.chunks(32).try_for_each(|line| writeln!(out, "  {}", digits(line)))
}

/// Writes the pieces that were collected, and clears them.
fn write_pieces(out: &mut output::Out, held: &mut [Pieces; 2], args: &Args) -> io::Result<()> {
    for (pieces, dir) in held.iter_mut().zip([Dir::Write, Dir::Read]) {
        let pieces = std::mem::take(pieces);
        match pieces.count {
            0 => {}
            1 => {
                let (at_ns, bytes) = (pieces.recorded_ns, pieces.bytes);
                let recorded = RecordedBytes { at_ns, dir, bytes };
                write_packet(out, pieces.numbers[0], pieces.since_ns[0], &recorded, args)?;
            }
            _ => write_joined(out, &pieces, dir, args)?,
        }
    }
    Ok(())
}

fn write_joined(out: &mut output::Out, pieces: &Pieces, dir: Dir, args: &Args) -> io::Result<()> {
    let (packets, in_none) = pieces.packets(dir);
    let found: u64 = packets.iter().map(|(times, _)| times).sum();
    let Pieces { bytes, count, numbers: [first, last], since_ns: [from, to], recorded_ns } = pieces;
    let text = format!("{} bytes in {count} pieces: {found} packets, and {in_none} bytes in none", bytes.len());
    if args.json {
        let of = |(times, packet): &(u64, RecordedBytes)| {
            let mut object = object(packet);
            object["times"] = (*times).into();
            object
        };
        let object = json!({
            "number": first,
            "last_number": last,
            "time_ns": from,
            "last_time_ns": to,
            "recorded_ns": recorded_ns,
            "direction": direction(dir),
            "pieces": count,
            "bytes_in_no_packet": in_none,
            "bytes": hex_of(bytes),
            "text": [text],
            "packets": packets.iter().map(of).collect::<Vec<Value>>(),
        });
        return writeln!(out, "{object}");
    }
    let (from, to) = (seconds(*from), seconds(*to));
    writeln!(out, "packet {first:<6} {from:>14} s  {}, up to packet {last} at {to} s", direction(dir))?;
    writeln!(out, "  {text}")?;
    for (times, packet) in &packets {
        if *times > 1 {
            writeln!(out, "  {times} times:")?;
        }
        write_lines(out, packet, false)?;
    }
    if args.hex { write_hex(out, bytes) } else { Ok(()) }
}

fn hex_of(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether bytes are a packet of a chip, by their length and the words at their beginning and end.
pub fn is_packet(bytes: &[u8]) -> bool {
    DataSize::of_packet(bytes.len()).is_some()
        && bytes.starts_with(&START_WORD.to_le_bytes())
        && bytes.ends_with(&END_WORD.to_le_bytes())
}

/// Writes a packet that was given as digits.
pub fn write_of_line(
    out: &mut output::Out,
    line: u64,
    bytes: Vec<u8>,
    dir: Dir,
    is_guess: bool,
    json: bool,
) -> io::Result<()> {
    let recorded = RecordedBytes { at_ns: 0, dir, bytes };
    if json {
        let mut object = object(&recorded);
        object["number"] = line.into();
        object["direction_guessed"] = is_guess.into();
        return writeln!(out, "{object}");
    }
    writeln!(out, "line {line:<4} {}{}", direction(dir), if is_guess { " (guessed)" } else { "" })?;
    write_lines(out, &recorded, false)
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

/// The bytes of one direction as JSON, with their meaning.
fn object(recorded: &RecordedBytes) -> Value {
    let shown = Shown::of(recorded);
    let mut object = json!({
        "direction": direction(recorded.dir),
        "bytes": hex_of(&recorded.bytes),
        "text": shown.lines(),
    });
    match &shown {
        Shown::Command { packet, .. } => {
            object["index"] = packet.header.index.into();
            object["code"] = packet.header.code.code().into();
        }
        Shown::Answer { header, .. } => {
            object["index"] = header.index.into();
            object["code"] = header.code.code().into();
            object["nop"] = header.status.contains(Status::NOP).into();
            object["ret"] = header.ret.into();
            object["state"] = header.state.0.into();
            object["errors"] = header.errors.0.into();
            object["rx_fifo"] = header.rx_fifo.into();
            object["tx_fifo"] = header.tx_fifo.into();
        }
        Shown::NotReady => object["not_ready"] = true.into(),
        Shown::Damaged(problem) => object["damaged"] = problem.to_string().into(),
        Shown::NoPacket(_) => {}
    }
    object
}

/// The bytes of one direction, decoded.
enum Shown<'p> {
    Command {
        packet: CommandPacket<'p>,
        check: CheckType,
    },
    Answer {
        header: AnswerHeader,
        data: &'p [u8],
    },
    NotReady,
    /// The length is that of a packet, but the content is not valid.
    Damaged(PacketError),
    /// The length is not that of a packet. The driver was searching for packets, or this is a part of one.
    NoPacket(usize),
}

impl<'p> Shown<'p> {
    fn of(recorded: &'p RecordedBytes) -> Self {
        let bytes = &recorded.bytes;
        let Some(size) = DataSize::of_packet(bytes.len()) else { return Self::NoPacket(bytes.len()) };
        match recorded.dir {
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

    fn lines(&self) -> Vec<String> {
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

/// Tries all check coverages and returns the first valid result. If none is valid, returns the error of the first one.
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

/// The values that every answer has besides its result.
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

fn digits(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}
