//! Text output: a line for each frame or packet, followed by a line for each shown slot of the frame, or by the decoded
//! packet.

use std::fmt::Display;
use std::io::{self, Write};

use ecmsk::link::Dir;
use ecmsk::recording::Lacks;
use ecmsk::sk::dump::SlotLine;

use super::Format;
use crate::dump::frames::Shown;
use crate::dump::packet::{self, Decoded, Packet};
use crate::dump::pieces::Pieces;
use crate::dump::place::Place;
use crate::output::seconds;

/// The output format without `--json`: text.
pub struct Text {
    /// Whether the bytes of packets are shown as well.
    pub with_bytes: bool,
}

impl Format for Text {
    fn heading(&self, out: &mut dyn Write, name: &str) -> io::Result<()> {
        writeln!(out, "# {name}")
    }

    fn frame(&self, out: &mut dyn Write, shown: &Shown, slots: &[(usize, SlotLine)]) -> io::Result<()> {
        place(out, "frame", &shown.place, shown.direction_name())?;
        indented(out, slots.iter().map(|(_, line)| line))
    }

    fn packet(&self, out: &mut dyn Write, packet: &Packet) -> io::Result<()> {
        place(out, "packet", &packet.place, packet.direction_name())?;
        indented(out, packet.decoded().lines())?;
        self.bytes(out, packet.bytes)
    }

    fn pieces(&self, out: &mut dyn Write, pieces: &Pieces, direction: Dir) -> io::Result<()> {
        let (packets, in_none) = pieces.packets(direction);
        let ([first, last], [from, to]) = (pieces.numbers, pieces.since_ns.map(seconds));
        let name = packet::direction_name(direction);
        writeln!(out, "packet {first:<6} {from:>14} s  {name}, up to packet {last} at {to} s")?;
        writeln!(out, "  {}", pieces.summary(&packets, in_none))?;
        for (times, packet) in &packets {
            if *times > 1 {
                writeln!(out, "  {times} times:")?;
            }
            indented(out, Decoded::of(packet.dir, &packet.bytes).lines())?;
        }
        self.bytes(out, &pieces.bytes)
    }

    fn lacks(&self, _: &mut dyn Write, _: &Lacks) -> io::Result<()> {
        // In text mode, a note on standard error says what the recording lacks, so nothing is written here.
        Ok(())
    }
}

impl Text {
    fn bytes(&self, out: &mut dyn Write, bytes: &[u8]) -> io::Result<()> {
        if !self.with_bytes {
            return Ok(());
        }
        indented(out, bytes.chunks(32).map(packet::digits))
    }
}

fn place(out: &mut dyn Write, what: &str, place: &Place, direction: &str) -> io::Result<()> {
    match place.time {
        Some(time) => write!(out, "{what} {:<6} {:>14} s ", place.number, seconds(time.since_start_ns))?,
        None => write!(out, "line {:<4}", place.number)?,
    }
    writeln!(out, " {direction}{}", if place.guessed { " (guessed)" } else { "" })
}

fn indented(out: &mut dyn Write, lines: impl IntoIterator<Item: Display>) -> io::Result<()> {
    lines.into_iter().try_for_each(|line| writeln!(out, "  {line}"))
}
