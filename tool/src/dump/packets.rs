//! The packets of a recording of a chip ECM-XF, in words, as bytes or as JSON.

use std::io::{self, Read, Write};
use std::rc::Rc;

use ecmsk::link::Dir;
use ecmsk::recording::exchanges::{Exchanges, RecordedBytes, is_of_chip};
use ecmsk::recording::{RecordError, RecordMeta};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, CommandPacket, Coverage, DataSize, Errors,
    PacketError, Received, Status,
};
use serde_json::json;

use super::Args;
use crate::error::{CliError, say};
use crate::filter::Times;
use crate::{output, recording};

/// The bytes of a file that tell whether it is the recording of a chip. Its link may be long. \[OURS]
const BEGINNING: u64 = 128 * 1024;
/// How many bytes of an answer's data are shown beside its name. \[OURS]
const DATA_SHOWN: usize = 16;

/// The source of a recording, and whether it is one of a chip.
///
/// # Errors
/// It cannot be read.
pub fn look(mut source: Box<dyn Read>, name: &str) -> Result<(Box<dyn Read>, bool), RecordError> {
    let mut beginning = Vec::new();
    let read = (&mut source).take(BEGINNING).read_to_end(&mut beginning);
    read.map_err(|error| RecordError::Io { name: name.to_owned(), message: error.to_string() })?;
    let of_chip = is_of_chip(&beginning);
    Ok((Box::new(io::Cursor::new(beginning).chain(source)), of_chip))
}

/// Shows the packets.
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
    while let Some(recorded) = exchanges.next() {
        let recorded = recorded?;
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
        if args.json {
            write_json(out, number, since_ns, &recorded)?;
        } else {
            write_text(out, number, since_ns, &recorded, args.hex)?;
        }
    }
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

fn write_text(
    out: &mut output::Out,
    number: u64,
    since_ns: i64,
    recorded: &RecordedBytes,
    hex: bool,
) -> io::Result<()> {
    let (ns, sign) = (since_ns.unsigned_abs(), if since_ns < 0 { "-" } else { "" });
    let seconds = format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
    writeln!(out, "packet {number:<6} {seconds:>14} s  {}", direction(recorded.dir))?;
    for line in Shown::of(recorded).lines() {
        writeln!(out, "  {line}")?;
    }
    if hex {
        for line in recorded.bytes.chunks(32) {
            writeln!(out, "  {}", digits(line))?;
        }
    }
    Ok(())
}

fn write_json(out: &mut output::Out, number: u64, since_ns: i64, recorded: &RecordedBytes) -> io::Result<()> {
    let shown = Shown::of(recorded);
    let mut object = json!({
        "number": number,
        "time_ns": since_ns,
        "recorded_ns": recorded.at_ns,
        "direction": direction(recorded.dir),
        "bytes": recorded.bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>(),
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
    writeln!(out, "{object}")
}

/// The bytes of one direction as far as they are known.
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
    /// As many bytes as a packet has, and none.
    Damaged(PacketError),
    /// So many bytes, as no packet has: while packets are searched, or a part of one.
    NoPacket(usize),
}

impl<'p> Shown<'p> {
    fn of(recorded: &'p RecordedBytes) -> Self {
        let bytes = &recorded.bytes;
        let Some(size) = DataSize::of_packet(bytes.len()) else { return Self::NoPacket(bytes.len()) };
        match recorded.dir {
            Dir::Write => {
                let rules =
                    [CheckRule::FIXED, CheckRule::CRC32, CheckRule { coverage: Coverage::Valid, ..CheckRule::CRC32 }];
                let parse = |rule: CheckRule| {
                    let check = rule.kind;
                    CommandPacket::parse(bytes, size, rule).map(|packet| Self::Command { packet, check })
                };
                let crc = || parse(rules[1]).or_else(|error| parse(rules[2]).map_err(|_| error));
                parse(rules[0]).or_else(|_| crc()).unwrap_or_else(Self::Damaged)
            }
            Dir::Read => {
                let parse = |coverage| AnswerPacket::parse(bytes, size, coverage);
                match parse(Coverage::All).or_else(|error| parse(Coverage::Valid).map_err(|_| error)) {
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
                    // Its type stands twice in what it shows of itself.
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

/// What every answer says beside its result.
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
