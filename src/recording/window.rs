//! Reads the frames of a stretch of time from a long recording, without reading the rest of the file.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::file_formats::ecmrec::header::{HEADER_LEN, Header};
use super::file_formats::ecmrec::index::{BlockAt, Index};
use super::meta::RecordMeta;
use super::reader::Recording;
use super::timeline::LONGEST_SILENCE_NS;

/// The number of blocks with commands for the board itself that are read from the beginning of the recording, and from
/// its end as well; further ones between them are left out. \[OURS] A program that configures the board and then runs
/// makes only a few such blocks.
const ORDERS_MAX: usize = 64;

/// The part of a recording that is needed to understand the frames in a stretch of time, as a source of bytes.
///
/// That is the beginning of the recording, blocks with a command for the board itself (which shows the slaves and the
/// state of the network), and the blocks of the stretch. Read it as a [`Recording`].
pub struct WindowOf {
    file: File,
    /// The ranges of the file that are left to read: offset and length, bytes.
    parts: VecDeque<(u64, u64)>,
    frames: u64,
}

impl WindowOf {
    /// Opens the part of a recording for the stretch from `from_ns` to `to_ns`, both included, ns since
    /// [`RecordMeta::zero_ns`]. `None` if this part is the whole file, or cannot be found without reading all frames: the file
    /// has another format than `.ecmrec`, or the clock was set during the recording, so that the times of its blocks do
    /// not rise evenly.
    ///
    /// `None`, too, if the header of a block that the part needs is damaged: reading the whole file instead reports the
    /// damage.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(path: &Path, from_ns: i64, to_ns: i64) -> io::Result<Option<Self>> {
        let Some((mut file, index)) = Index::open(path)? else { return Ok(None) };
        let Some(first) = index.blocks.first().filter(|_| is_even(&index.blocks)) else { return Ok(None) };
        let meta = Recording::open(path).ok().and_then(|recording| recording.meta().cloned());
        let zero_ns = RecordMeta::zero_ns(meta.as_ref(), first.times_ns.0);
        let at = |ns: i64| zero_ns.saturating_add_signed(ns);
        let is_inside = |block: &BlockAt| block.times_ns.1 >= at(from_ns) && block.times_ns.0 <= at(to_ns);
        let orders: Vec<u64> = index.blocks.iter().filter(|block| block.has_orders).map(|block| block.at).collect();
        let orders = orders.iter().enumerate().filter(|(n, _)| *n < ORDERS_MAX || n + ORDERS_MAX >= orders.len());
        let mut needed: Vec<u64> = orders.map(|(_, at)| *at).collect();
        needed.extend(index.blocks.iter().filter(|block| block.is_piece || is_inside(block)).map(|block| block.at));
        needed.push(first.at);
        needed.sort_unstable();
        needed.dedup();
        if needed.len() == index.blocks.len() {
            return Ok(None);
        }
        let mut parts = [index.sections.clone(), index.ends.clone()].concat();
        for at in needed {
            file.seek(SeekFrom::Start(at))?;
            let mut header = [0; HEADER_LEN];
            file.read_exact(&mut header)?;
            let Some(header) = Header::parse(&header) else { return Ok(None) };
            parts.push((at, header.block_len() as u64));
        }
        parts.sort_unstable();
        let frames = index.blocks.iter().map(|block| u64::from(block.packets)).sum();
        Ok(Some(Self { file, parts: parts.into(), frames }))
    }

    /// The number of frames in the whole recording.
    pub const fn frames(&self) -> u64 {
        self.frames
    }
}

/// Whether times rise from block to block without long gaps. Only then are all frames of a stretch of time in the
/// blocks whose times overlap it.
fn is_even(blocks: &[BlockAt]) -> bool {
    blocks.is_sorted_by(|before, after| {
        let silence = i128::from(after.times_ns.0) - i128::from(before.times_ns.1);
        before.times_ns.0 <= after.times_ns.0 && silence < i128::from(LONGEST_SILENCE_NS)
    })
}

impl Read for WindowOf {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while let Some((at, len)) = self.parts.front_mut() {
            if *len == 0 {
                self.parts.pop_front();
                continue;
            }
            self.file.seek(SeekFrom::Start(*at))?;
            let most = buffer.len().min(usize::try_from(*len).unwrap_or(usize::MAX));
            let read = self.file.read(&mut buffer[..most])?;
            if read == 0 {
                return Ok(0);
            }
            (*at, *len) = (*at + read as u64, *len - read as u64);
            return Ok(read);
        }
        Ok(0)
    }
}
