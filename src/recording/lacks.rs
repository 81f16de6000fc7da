//! What is missing in a recording.

use std::fmt;

/// What is missing in a recording, as far as it was read. It is complete once the recording was read to its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lacks {
    /// The number of sections without an end. The recorder writes one section for each opening of a board.
    pub not_ended: u64,
    /// The number of frames that passed the link and are not in the recording.
    pub missing: u64,
    /// Why frames are missing, as the recorder has noted it in the file.
    pub why: Option<String>,
}

impl Lacks {
    /// Whether no section lacks its end, and no frame is known to be missing.
    pub const fn is_nothing(&self) -> bool {
        self.not_ended == 0 && self.missing == 0
    }
}

/// Writes one line, without the name of the file.
impl fmt::Display for Lacks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.missing > 0 {
            match &self.why {
                Some(why) => write!(f, "{} frames are missing: {why}", self.missing)?,
                None => write!(f, "{} frames are missing", self.missing)?,
            }
            if self.not_ended > 0 {
                f.write_str("; ")?;
            }
        }
        match self.not_ended {
            0 if self.missing == 0 => f.write_str("nothing is known to be missing"),
            0 => f.write_str("; record again, to a disk that is fast and has room, to have them all"),
            _ => f.write_str(
                "the recording was not ended, what came after its last frame is not in it; its program was killed, still \
                 runs, or could not write: let it end by itself, on a disk with room, to have all",
            ),
        }
    }
}
