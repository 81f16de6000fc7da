//! Copies the frames of a recording to a new file, which may have another format.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::blocks::BlockWriter;
use super::file::{self, Sink};
use super::loss::Loss;
use super::settings::Settings;
use super::writer::{Capture, FrameEntry, Writer};
use crate::recording::file_formats::ecmrec;
use crate::recording::{Lacks, RecordMeta, Recorded};

/// A recording that gets its frames from another recording, not from a link. The extension of its file name decides its
/// format, as with `record=`.
///
/// A source file may hold several recordings, one after the other. Each becomes one in the new file: if this process
/// has written to that file before, the recording is appended.
pub struct RecordingCopy {
    path: PathBuf,
    meta: RecordMeta,
    settings: Settings,
    /// `None` before the first frame.
    writer: Option<Box<dyn Writer<FrameEntry>>>,
}

impl RecordingCopy {
    /// A copy of a recording in the file at `path`, which is made when the first frame is added.
    pub fn new(path: &Path, meta: &RecordMeta) -> Self {
        Self { path: path.to_owned(), meta: meta.clone(), settings: Settings::new(meta.slot), writer: None }
    }

    /// Looks at a frame before the first one that is copied. If the frame is a setting of the board (SET_AXIS, SET_DC),
    /// the copy begins with it, at a time shortly before its first frame. Without the settings the copied frames cannot
    /// be understood.
    pub fn look(&mut self, recorded: &Recorded) {
        self.settings.look(&entry(recorded));
    }

    /// Adds a frame of the source recording, with its time stamp.
    ///
    /// # Errors
    /// The file cannot be made, another recording is writing to it, or the frames so far cannot be written; the error
    /// says why.
    pub fn add(&mut self, recorded: &Recorded) -> io::Result<()> {
        let writer = match &mut self.writer {
            Some(writer) => writer,
            None => {
                let mut writer = begin(&self.path, &self.meta)?;
                self.settings.before(recorded.at_ns).for_each(|entry| writer.push(entry));
                self.writer.insert(writer)
            }
        };
        writer.push(entry(recorded));
        check(writer.as_mut())
    }

    /// Ends the recording. `lacks` is what the source recording lacks: its missing frames count as missing in the copy,
    /// and if it was not ended, neither is the copy.
    ///
    /// # Errors
    /// The end cannot be written; the error says why.
    pub fn end(self, lacks: &Lacks) -> io::Result<()> {
        let Some(mut writer) = self.writer else { return Ok(()) };
        if lacks.missing > 0 {
            let why = lacks.why.clone().unwrap_or_else(|| "they were missing in the file that was copied".to_owned());
            writer.loss().inherit(lacks.missing, why);
        }
        writer.flush();
        check(writer.as_mut())?;
        if lacks.not_ended == 0 {
            writer.end();
        }
        check(writer.as_mut())
    }
}

fn begin(path: &Path, meta: &RecordMeta) -> io::Result<Box<dyn Writer<FrameEntry>>> {
    let sink = Sink::File(file::open(path)?);
    let loss = Loss::new(path.display().to_string(), Arc::default());
    Ok(if ecmrec::is_named(path) {
        Box::new(BlockWriter::begin(loss, sink, meta)?)
    } else {
        Box::new(Capture::begin(loss, sink, meta)?)
    })
}

fn entry(Recorded { at_ns, dir, frame, .. }: &Recorded) -> FrameEntry {
    FrameEntry { at_ns: *at_ns, dir: *dir, frame: (**frame).clone() }
}

fn check(writer: &mut dyn Writer<FrameEntry>) -> io::Result<()> {
    writer.loss().error().map_or(Ok(()), |error| Err(io::Error::other(error)))
}
