//! Copies the frames of a recording to a new file, which may have another format.

use std::io;
use std::path::Path;
use std::sync::Arc;

use super::blocks::BlockWriter;
use super::file::{self, Sink};
use super::loss::Loss;
use super::writer::{Capture, FrameEntry, Writer};
use crate::recording::file_formats::ecmrec;
use crate::recording::{Lacks, RecordMeta, Recorded};

/// A recording that gets its frames from another recording, not from a link. The extension of its file name decides its
/// format, as with `record=`.
///
/// A source file may hold several recordings, one after the other. Each becomes one in the new file: if this process
/// has written to that file before, the recording is appended.
pub struct RecordingCopy {
    writer: Box<dyn Writer<FrameEntry>>,
}

impl RecordingCopy {
    /// Begins a recording in the file at `path`.
    ///
    /// # Errors
    /// The file cannot be written, or another recording is writing to it.
    pub fn begin(path: &Path, meta: &RecordMeta) -> io::Result<Self> {
        let sink = Sink::File(file::open(path)?);
        let loss = Loss::new(path.display().to_string(), Arc::default());
        let writer: Box<dyn Writer<FrameEntry>> = if ecmrec::is_named(path) {
            Box::new(BlockWriter::begin(loss, sink, meta)?)
        } else {
            Box::new(Capture::begin(loss, sink, meta)?)
        };
        Ok(Self { writer })
    }

    /// Adds a frame of the source recording, with its time stamp.
    ///
    /// # Errors
    /// The frames so far cannot be written; the error says why.
    pub fn add(&mut self, recorded: Recorded) -> io::Result<()> {
        let Recorded { at_ns, dir, frame, .. } = recorded;
        self.writer.push(FrameEntry { at_ns, dir, frame });
        self.check()
    }

    /// Ends the recording. `lacks` is what the source recording lacks: its missing frames count as missing in the copy,
    /// and if it was not ended, neither is the copy.
    ///
    /// # Errors
    /// The end cannot be written; the error says why.
    pub fn end(mut self, lacks: &Lacks) -> io::Result<()> {
        if lacks.missing > 0 {
            let why = lacks.why.clone().unwrap_or_else(|| "they were missing in the file that was copied".to_owned());
            self.writer.loss().inherit(lacks.missing, why);
        }
        self.writer.flush();
        self.check()?;
        if lacks.not_ended == 0 {
            self.writer.end();
        }
        self.check()
    }

    fn check(&mut self) -> io::Result<()> {
        self.writer.loss().error().map_or(Ok(()), |error| Err(io::Error::other(error)))
    }
}
