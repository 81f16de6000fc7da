//! The formats of the output, each in a file of its own: [`text`], [`json`].

mod json;
mod text;

use std::io::{self, Write};

use ecmsk::link::Dir;
use ecmsk::recording::Lacks;
use ecmsk::sk::dump::SlotLine;

use super::Args;
use super::frames::Shown;
use super::packet::Packet;
use super::pieces::Pieces;
use json::Json;
use text::Text;

/// A format of the output: what is written for each thing that a recording has.
pub trait Format {
    /// What follows is of another link or another board of a capture.
    fn heading(&self, out: &mut dyn Write, name: &str) -> io::Result<()>;
    /// A frame, and those of its slots that are shown.
    fn frame(&self, out: &mut dyn Write, shown: &Shown, slots: &[(usize, SlotLine)]) -> io::Result<()>;
    /// A packet of an ECM-XF.
    fn packet(&self, out: &mut dyn Write, packet: &Packet) -> io::Result<()>;
    /// Several exchanges with an ECM-XF in one direction, each of which is only a piece of a packet.
    fn pieces(&self, out: &mut dyn Write, pieces: &Pieces, direction: Dir) -> io::Result<()>;
    /// What the recording lacks, after its last frame or packet.
    fn lacks(&self, out: &mut dyn Write, lacks: &Lacks) -> io::Result<()>;
}

/// The format that the options choose.
pub fn chosen(args: &Args) -> Box<dyn Format> {
    // With lines of digits the flag says where they come from.
    let with_bytes = args.hex && args.file.is_some();
    if args.json { Box::new(Json) } else { Box::new(Text { with_bytes }) }
}
