//! Lists what is in a recording in blocks (`.ecmrec`): frames, times, recordings, blocks. It reads the index and not
//! the frames.

use std::io;
use std::path::Path;

use super::file_formats::ecmrec::index::Index;

/// What is in a recording in blocks (`.ecmrec`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    /// The number of frames in all recordings of the file.
    pub frames: u64,
    /// The times of the earliest and the latest frame, in the file, ns; `None` without frames.
    pub times_ns: Option<(u64, u64)>,
    /// The number of recordings in the file: one for each opening of the board.
    pub recordings: u64,
    /// How many of these recordings were ended: they have the block that ends a recording.
    pub ended: u64,
    /// The number of blocks of frames.
    pub blocks: u64,
    /// The number of pieces: short blocks of the newest frames, which the writer later replaces by one block. A
    /// recording that was not ended has some at its end, and one that was written to a pipe has only pieces.
    pub pieces: u64,
    /// Whether the file has an index of all its blocks. If not, the headers of the blocks were read, and damaged blocks
    /// are missing in these numbers.
    pub has_index: bool,
}

impl Outline {
    /// The outline of a file; `None` if it is no recording in blocks.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(path: &Path) -> io::Result<Option<Self>> {
        let Some((_, Index { sections, ends, blocks, is_whole })) = Index::open(path)? else { return Ok(None) };
        let pieces = blocks.iter().filter(|block| block.is_piece).count() as u64;
        let first_ns = blocks.iter().map(|block| block.times_ns.0).min();
        let last_ns = blocks.iter().map(|block| block.times_ns.1).max();
        Ok(Some(Self {
            frames: blocks.iter().map(|block| u64::from(block.packets)).sum(),
            times_ns: first_ns.zip(last_ns),
            recordings: sections.len() as u64,
            ended: ends.len() as u64,
            blocks: blocks.len() as u64 - pieces,
            pieces,
            has_index: is_whole,
        }))
    }
}
