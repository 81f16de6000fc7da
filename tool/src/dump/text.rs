//! Prints a frame as text: a line for the frame, then one for each slot.

use std::io::{self, Write};

use ecmsk::sk::dump::SlotLine;

use super::frames::Shown;

/// What the number of a frame counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbering {
    /// `frame 1`: a frame of a recording.
    Frame,
    /// `line 1`: a line of the input.
    Line,
}

/// Writes a frame: one line for the frame and one for each of `lines`.
pub fn write(out: &mut dyn Write, by: Numbering, shown: &Shown, lines: &[(usize, SlotLine)]) -> io::Result<()> {
    match by {
        Numbering::Frame => write!(out, "frame {:<6}", shown.number)?,
        Numbering::Line => write!(out, "line {:<4}", shown.number)?,
    }
    if let Some(time) = shown.time {
        let (ns, sign) = (time.since_start_ns.unsigned_abs(), if time.since_start_ns < 0 { "-" } else { "" });
        let seconds = format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
        write!(out, " {seconds:>14} s ")?;
    }
    writeln!(out, " {}{}", shown.direction_name(), if shown.guessed { " (guessed)" } else { "" })?;
    for (_, line) in lines {
        writeln!(out, "  {line}")?;
    }
    Ok(())
}
