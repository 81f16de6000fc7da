//! Prints the packets in the recording of an ECM-XF.

use std::io::{self, Read, Write};

use ecmsk::link::Dir;
use ecmsk::recording::exchanges::{Exchanges, RecordedBytes, is_of_chip};
use ecmsk::recording::{RecordError, RecordMeta};

use super::Args;
use super::output_formats::{self, Format};
use super::packet::Packet;
use super::pieces::Pieces;
use super::place::{Place, Time};
use crate::error::CliError;
use crate::stderr::say;
use crate::{output, recording};

/// The number of bytes of a file that are read to detect the recording of an ECM-XF. They must include the header with
/// the link, which may be long. \[OURS]
const BEGINNING: u64 = 128 * 1024;

/// Reads the beginning of a source to detect the recording of an ECM-XF. Returns the source, which still yields the
/// bytes that were read, and whether it is such a recording.
///
/// # Errors
/// The source cannot be read.
pub fn look(mut source: Box<dyn Read + Send>, name: &str) -> Result<(Box<dyn Read + Send>, bool), RecordError> {
    let mut beginning = Vec::new();
    let read = (&mut source).take(BEGINNING).read_to_end(&mut beginning);
    read.map_err(|error| RecordError::Io { name: name.to_owned(), message: error.to_string() })?;
    let of_chip = is_of_chip(&beginning);
    Ok((Box::new(io::Cursor::new(beginning).chain(source)), of_chip))
}

/// Prints the packets of a recording.
pub fn dump(args: &Args, source: Box<dyn Read + Send>, name: &str) -> Result<(), CliError> {
    let mut exchanges = Exchanges::new(source, name)?;
    let mut printer = Printer { out: output::stdout(), format: output_formats::chosen(args), held: Default::default() };
    let shown = show(args, &mut exchanges, &mut printer);
    // Pieces that were already collected are printed even after an error.
    printer.write_held()?;
    if shown.is_ok() {
        let lacks = exchanges.lacks();
        if !lacks.is_nothing() {
            say("note", &format_args!("{name}: {lacks}"));
            printer.format.lacks(&mut printer.out, &lacks)?;
        }
    }
    printer.out.flush()?;
    shown
}

fn show(args: &Args, exchanges: &mut Exchanges<Box<dyn Read + Send>>, printer: &mut Printer) -> Result<(), CliError> {
    let times = args.times.times();
    let mut meta: Option<RecordMeta> = None;
    let mut number = 0;
    while let Some(recorded) = exchanges.next() {
        let recorded = recorded?;
        let is_piece = Pieces::is_one(&recorded);
        if !is_piece || exchanges.meta() != meta.as_ref() || printer.held.iter().any(Pieces::is_full) {
            printer.write_held()?;
        }
        if exchanges.meta() != meta.as_ref() {
            meta = exchanges.meta().cloned();
            if let Some(meta) = &meta {
                printer.format.heading(&mut printer.out, &recording::link_name(meta))?;
            }
        }
        number += 1;
        let zero_ns = exchanges.zero_ns().unwrap_or(recorded.at_ns);
        let since_ns = recorded.at_ns.wrapping_sub(zero_ns) as i64;
        let other_way = args.direction.is_some_and(|direction| direction != recorded.dir);
        if other_way || !times.contains(since_ns) {
            continue;
        }
        if is_piece {
            printer.held[usize::from(recorded.dir == Dir::Read)].add(number, since_ns, &recorded);
        } else {
            printer.packet(number, since_ns, &recorded)?;
        }
    }
    Ok(())
}

/// Prints packets in the format of the options.
struct Printer {
    out: output::Out,
    format: Box<dyn Format>,
    /// Pieces of packets that are collected but not yet printed: to the chip, and from it.
    held: [Pieces; 2],
}

impl Printer {
    fn packet(&mut self, number: u64, since_start_ns: i64, recorded: &RecordedBytes) -> io::Result<()> {
        let time = Some(Time { since_start_ns, recorded_ns: recorded.at_ns });
        let place = Place { number, time, direction: recorded.dir, guessed: false };
        self.format.packet(&mut self.out, &Packet { place, bytes: &recorded.bytes })
    }

    fn write_held(&mut self) -> io::Result<()> {
        for (pieces, dir) in std::mem::take(&mut self.held).into_iter().zip([Dir::Write, Dir::Read]) {
            match pieces.count {
                0 => {}
                1 => {
                    let (at_ns, bytes) = (pieces.recorded_ns, pieces.bytes);
                    self.packet(pieces.numbers[0], pieces.since_ns[0], &RecordedBytes { at_ns, dir, bytes })?;
                }
                _ => self.format.pieces(&mut self.out, &pieces, dir)?,
            }
        }
        Ok(())
    }
}
