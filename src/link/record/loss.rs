//! What a recording lacks: the number of missing frames, the reason, and the messages to the user about them.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::tell::tell;

/// The reason for missing frames that messages give if no write has failed.
const TOO_SLOW: &str = "the disk was too slow";

/// Counts the frames that are missing from a recording, and keeps the reason.
pub(super) struct Loss {
    /// The name of the file in messages.
    name: String,
    /// The number of frames that are missing from the file. Threads of the program count them too.
    dropped: Arc<AtomicU64>,
    /// Whether the user was warned about missing frames.
    told: bool,
    /// Whether the user is told nothing, since another [`Loss`] counts the same frames.
    is_quiet: bool,
    /// The error of a failed write. After it nothing more is written, and every frame is counted as missing. `None`: no
    /// write has failed.
    failed: Option<String>,
    /// For a copy of a recording: why frames are missing that the source recording lacked already. Otherwise `None`.
    inherited: Option<String>,
}

impl Loss {
    pub fn new(name: String, dropped: Arc<AtomicU64>) -> Self {
        Self { name, dropped, told: false, is_quiet: false, failed: None, inherited: None }
    }

    /// The loss of a file whose missing frames and errors another [`Loss`] takes over and reports.
    pub fn quiet() -> Self {
        Self { is_quiet: true, ..Self::new(String::new(), Arc::default()) }
    }

    /// Whether a write has failed, so that no more frames are written.
    pub const fn has_failed(&self) -> bool {
        self.failed.is_some()
    }

    /// Counts `frames` more frames as missing.
    pub fn add(&self, frames: u64) {
        self.dropped.fetch_add(frames, Ordering::Relaxed);
    }

    /// Counts frames that the source recording of a copy lacked already, with the reason that it states.
    pub fn inherit(&mut self, frames: u64, why: String) {
        self.add(frames);
        self.inherited = Some(why);
        self.told = true;
    }

    /// The error of a write after which nothing more is written; `None`: no write has failed.
    pub fn error(&self) -> Option<String> {
        self.failed.clone()
    }

    /// Stops the recording after an error of a write, and tells the user.
    pub fn fail(&mut self, error: &io::Error) {
        self.failed = Some(error.to_string());
        self.told = true;
        if self.is_quiet {
            return;
        }
        tell(format!("recording to {} has stopped: {error}; frames from here on are counted only", self.name));
    }

    /// Keeps the error of the first attempt to write the end of the recording as the reason for missing frames, unless
    /// a write has failed before. The end is then written in place of the last frames.
    pub fn note(&mut self, error: &io::Error) {
        self.failed.get_or_insert_with(|| error.to_string());
    }

    /// Warns the user when the first frames are missing. The recorder's thread does that, so that no thread of the
    /// program waits for standard error.
    pub fn tell(&mut self) {
        if !self.told && self.dropped.load(Ordering::Relaxed) > 0 {
            self.told = true;
            tell(format!("recording to {}: frames are missing: {TOO_SLOW}; record to a faster disk", self.name));
        }
    }

    /// Tells the user at the end how many frames are missing, if any are.
    pub fn tell_at_end(&self) {
        if let (_, Some(missing)) = self.missing() {
            tell(format!("recording to {}: {missing}", self.name));
        }
    }

    /// The number of missing frames so far.
    pub fn count(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Why frames are missing, if any are.
    pub fn why(&self) -> &str {
        self.failed.as_deref().or(self.inherited.as_deref()).unwrap_or(TOO_SLOW)
    }

    /// The number of missing frames, and if it is not 0, a text with the number and the reason.
    pub fn missing(&self) -> (u64, Option<String>) {
        let dropped = self.dropped.load(Ordering::Relaxed);
        (dropped, (dropped > 0).then(|| format!("{dropped} frames are missing: {}", self.why())))
    }
}
