//! The file `writer.txt` of a flight recorder: which process writes to the folder, and how its recording has ended.

use std::io;

use super::folder::{self, Folder};

/// The name of the file.
pub(super) const NAME: &str = "writer.txt";
/// The most bytes of the file that are read. \[OURS]
const BYTES_MAX: u64 = 4096;

/// The contents of the file `writer.txt`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct State {
    /// The id of the process that writes to the folder, or that has written to it last.
    pub pid: u32,
    /// Whether the recording was ended.
    pub is_ended: bool,
    /// The number of missing frames in all recordings of this process to the folder.
    pub missing: u64,
    /// Why frames are missing; `None` if none are.
    pub why: Option<String>,
    /// Why the first moment that is not kept could not be kept; `None` if there is no such moment.
    pub not_kept: Option<String>,
}

impl State {
    /// Writes that this process records from now on. If it has recorded to the folder before, its missing frames still
    /// count.
    pub fn begin(folder: &dyn Folder) -> io::Result<Self> {
        let pid = std::process::id();
        let before = Self::read(folder).filter(|state| state.pid == pid).unwrap_or_default();
        let state = Self { pid, is_ended: false, ..before };
        folder::put_text(folder, NAME, &state.text())?;
        Ok(state)
    }

    /// Reads the file; `None` if it does not exist or is not valid.
    pub fn read(folder: &dyn Folder) -> Option<Self> {
        let mut state = Self::default();
        for line in folder::text(folder, NAME, BYTES_MAX).ok()?.lines() {
            let (word, value) = line.split_once(' ').unwrap_or((line, ""));
            match word {
                "pid" => state.pid = value.parse().ok()?,
                "ended" => state.is_ended = true,
                "missing" => state.missing = value.parse().ok()?,
                "why" => state.why = Some(value.to_owned()),
                "not_kept" => state.not_kept = Some(value.to_owned()),
                _ => {}
            }
        }
        Some(state)
    }

    /// Notes why a moment is not kept; returns whether it is the first one.
    pub fn is_first_not_kept(&mut self, why: &str) -> bool {
        let is_first = self.not_kept.is_none();
        self.not_kept.get_or_insert_with(|| why.to_owned());
        is_first
    }

    /// Writes that the recording has ended.
    pub fn end(&mut self, folder: &dyn Folder, missing: u64, why: Option<&str>) -> io::Result<()> {
        (self.is_ended, self.missing) = (true, self.missing.saturating_add(missing));
        self.why = why.map(str::to_owned).or_else(|| self.why.take());
        folder::put_text(folder, NAME, &self.text())
    }

    /// What the recording lacks, for messages that name the folder themselves; `None` if it is whole.
    pub fn lacks(&self) -> Option<String> {
        let missing = (self.missing > 0).then(|| {
            let why = self.why.clone().unwrap_or_else(|| format!("{} frames are missing", self.missing));
            format!("{why}; record to a disk that is fast and has room")
        });
        let not_kept = self.not_kept.as_ref().map(|why| format!("a moment is not kept: {why}"));
        let not_ended = (!self.is_ended).then(|| {
            "the recording was not ended; its program was killed, or could not write: let it end by itself, on a disk \
             with room"
                .to_owned()
        });
        let lacks: Vec<String> = [missing, not_kept, not_ended].into_iter().flatten().collect();
        (!lacks.is_empty()).then(|| lacks.join("; "))
    }

    fn text(&self) -> String {
        let mut text = format!("pid {}\nmissing {}\n", self.pid, self.missing);
        for (word, value) in [("why", &self.why), ("not_kept", &self.not_kept)] {
            if let Some(value) = value {
                text += &format!("{word} {}\n", super::moment::one_line(value));
            }
        }
        if self.is_ended {
            text += "ended\n";
        }
        text
    }
}
