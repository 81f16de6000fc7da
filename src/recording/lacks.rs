//! What a recording is known to lack.

use std::fmt;

/// What a recording is known to lack, as far as it was read; all of it is known at the end only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lacks {
    /// Openings of a board, one section of the file each, that were not ended.
    pub not_ended: u64,
    /// Frames that passed and are not in it.
    pub missing: u64,
    /// Why frames are missing, in the words of the recorder that could not take them.
    pub why: Option<String>,
}

impl Lacks {
    /// Whether nothing is known to be missing.
    pub const fn is_nothing(&self) -> bool {
        self.not_ended == 0 && self.missing == 0
    }
}

/// One line, without the name of the file.
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
