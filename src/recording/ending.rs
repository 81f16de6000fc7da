//! Finds out from the end of a recording what is missing in it.
//!
//! The recorder of this crate ends each section with pcapng's block of interface statistics. If the block is missing,
//! the recording was not ended: its program was killed, is still running, or found the disk full. The section header
//! names the program that wrote the section. If it is another program (a capture, or a recording that was rewritten), a
//! missing block means nothing \[OURS]. A recording in blocks (`.ecmrec`) ends with a block of its own.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::file_formats::ecmrec::header::{Kind, MAGIC};
use super::file_formats::ecmrec::index;
use super::file_formats::ecmrec::section::End;
use super::lacks::Lacks;
use super::reader::Recording;

/// The maximum length of a file's last block, bytes; a longer block is not read. The last block of a recording has a
/// few hundred bytes. \[OURS]
const LONGEST_END: u64 = 64 * 1024;
/// How many bytes at the beginning of a file are read: more than the blocks before the first frame of a recording have.
/// \[OURS]
const LONGEST_BEGIN: u64 = 1 << 20;

/// What is missing in a recording. Only the first and the last block of the file are read, so that this is fast for a
/// long file. If a file has several recordings, the result is that of the last one.
///
/// # Errors
/// The error of the system if the file cannot be read. A file that is no recording counts as one that was not ended.
pub fn lacks_at_end(path: &Path) -> io::Result<Lacks> {
    let not_ended = Lacks { not_ended: 1, ..Lacks::default() };
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    if let Some(lacks) = lacks_of_blocks(&mut file, length)? {
        return Ok(lacks);
    }
    let mut bytes = Vec::new();
    (&mut file).take(LONGEST_BEGIN).read_to_end(&mut bytes)?;
    // The length of the first two blocks: the section header and the interface description.
    let Some(headers) = (0..2).try_fold(0_usize, |at, _| at.checked_add(block_len(bytes.get(at..)?)?)) else {
        return Ok(not_ended);
    };
    if headers as u64 > length || headers > bytes.len() {
        return Ok(not_ended);
    }
    bytes.truncate(headers);
    if length > headers as u64 {
        let mut tail = [0; 4];
        file.seek(SeekFrom::End(-4))?;
        file.read_exact(&mut tail)?;
        let last = u64::from(u32::from_le_bytes(tail));
        if !(12..=LONGEST_END).contains(&last) || last > length - headers as u64 {
            return Ok(not_ended);
        }
        file.seek(SeekFrom::Start(length - last))?;
        file.take(last).read_to_end(&mut bytes)?;
    }
    let Ok(mut recording) = Recording::new(&bytes[..], "") else { return Ok(not_ended) };
    let whole = recording.by_ref().all(|frame| frame.is_ok());
    Ok(if whole { recording.lacks() } else { not_ended })
}

/// What is missing in a recording in blocks (`.ecmrec`), by its last block; `None` if the file is no such recording.
fn lacks_of_blocks(file: &mut File, length: u64) -> io::Result<Option<Lacks>> {
    let mut begin = Vec::new();
    file.take(MAGIC.len() as u64).read_to_end(&mut begin)?;
    let last = if begin == MAGIC { index::block_before(file, length)? } else { None };
    file.seek(SeekFrom::Start(0))?;
    if begin != MAGIC {
        return Ok(None);
    }
    let end = last.filter(|(_, header, _)| header.kind == Some(Kind::End)).and_then(|(_, _, bytes)| End::parse(&bytes));
    Ok(Some(match end {
        Some(End { missing, why, .. }) => Lacks { missing, why, ..Lacks::default() },
        None => Lacks { not_ended: 1, ..Lacks::default() },
    }))
}

/// The length of the block at the beginning of `bytes`. `None`: the bytes end before the length field does, or the
/// length is invalid.
fn block_len(bytes: &[u8]) -> Option<usize> {
    let length = bytes.get(4..)?.first_chunk()?;
    usize::try_from(u32::from_le_bytes(*length)).ok().filter(|length| *length >= 12)
}
