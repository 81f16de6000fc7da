//! The output formats of `ecmsk dump`: [`text`] and [`json`].

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

/// An output format. Each method writes one item of a recording to `out`.
pub trait Format {
    /// Writes a heading before the first frame of each link, or of each board in a capture. `name` is the link or the
    /// board.
    fn heading(&self, out: &mut dyn Write, name: &str) -> io::Result<()>;
    /// Writes a frame. `slots` are the slots that are shown.
    fn frame(&self, out: &mut dyn Write, shown: &Shown, slots: &[(usize, SlotLine)]) -> io::Result<()>;
    /// Writes a packet of an ECM-XF.
    fn packet(&self, out: &mut dyn Write, packet: &Packet) -> io::Result<()>;
    /// Writes consecutive exchanges with an ECM-XF in one direction that each transferred only a part of a packet.
    fn pieces(&self, out: &mut dyn Write, pieces: &Pieces, direction: Dir) -> io::Result<()>;
    /// Writes what is missing in an incomplete recording. It is called after the last frame or packet.
    fn lacks(&self, out: &mut dyn Write, lacks: &Lacks) -> io::Result<()>;
}

/// The format that the options choose.
pub fn chosen(args: &Args) -> Box<dyn Format> {
    // With a file, `--hex` requests the bytes of packets. Without one, it says that standard input has hexadecimal
    // digits.
    let with_bytes = args.hex && args.file.is_some();
    if args.json { Box::new(Json) } else { Box::new(Text { with_bytes }) }
}
