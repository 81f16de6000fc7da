//! The segments of the ring: their numbers and lengths. The oldest ones are deleted, so that all segments stay within
//! the bound.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::folder::{self, Folder, Output};

/// A segment of the ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub number: u64,
    /// The length of its file, bytes.
    bytes: u64,
    /// The length of its compressed form until this replaces the file, bytes; then 0.
    packed: u64,
    /// The latest time of its frames, ns; 0 for a segment of an earlier opening of the board.
    pub last_ns: u64,
}

/// The segments, oldest first. Only the recorder's thread uses them.
pub(super) struct Ring {
    folder: Arc<dyn Folder>,
    bound: u64,
    segments: VecDeque<Segment>,
    bytes: u64,
}

impl Ring {
    /// A ring of the segments that exist already, `there`: their numbers and lengths.
    pub fn new(folder: Arc<dyn Folder>, bound: u64, mut there: Vec<(u64, u64)>) -> Self {
        there.sort_unstable();
        let bytes = there.iter().map(|(_, bytes)| bytes).sum();
        let segments =
            there.into_iter().map(|(number, bytes)| Segment { number, bytes, packed: 0, last_ns: 0 }).collect();
        Self { folder, bound, segments, bytes }
    }

    /// Adds a segment that grows from now on.
    pub fn begin(&mut self, number: u64) {
        self.segments.push_back(Segment { number, bytes: 0, packed: 0, last_ns: 0 });
    }

    /// Notes the time of a frame of the newest segment.
    pub fn frame(&mut self, at_ns: u64) {
        if let Some(live) = self.segments.back_mut() {
            live.last_ns = live.last_ns.max(at_ns);
        }
    }

    /// The number of the first segment that has frames from the time `at_ns` on. Only segments of this opening of the
    /// board count; `from` is the first of these.
    pub fn first_at(&self, from: u64, at_ns: u64) -> u64 {
        let found = self.segments.iter().find(|segment| segment.number >= from && segment.last_ns >= at_ns);
        found.or(self.segments.back()).map_or(from, |segment| segment.number)
    }

    /// Notes that the compressed form of a segment has replaced its file.
    pub fn is_packed(&mut self, number: u64) {
        if let Some(segment) = self.segments.iter_mut().find(|segment| segment.number == number) {
            self.bytes -= segment.bytes;
            (segment.bytes, segment.packed) = (segment.packed, 0);
        }
    }

    /// Removes the compressed form of a segment, because it could not be written.
    pub fn remove_packed(&mut self, number: u64) {
        if let Some(segment) = self.segments.iter_mut().find(|segment| segment.number == number) {
            self.bytes -= std::mem::take(&mut segment.packed);
            // A file that cannot be removed now is removed when the folder is opened again.
            let _ = self.folder.remove(&folder::packed(number));
        }
    }

    /// Deletes the oldest segments until `bytes` more bytes fit into the bound.
    ///
    /// # Errors
    /// The bytes do not fit beside the newest segment, or a segment cannot be deleted.
    pub fn make_room(&mut self, bytes: u64) -> io::Result<()> {
        while self.bytes + bytes > self.bound {
            if !self.delete_oldest()? {
                let what = format!("{} bytes have no room for a segment; give it a larger flight_bytes=", self.bound);
                return Err(io::Error::new(io::ErrorKind::QuotaExceeded, what));
            }
        }
        Ok(())
    }

    /// Deletes the oldest segment; returns false if only the newest segment is left, which may still grow.
    fn delete_oldest(&mut self) -> io::Result<bool> {
        let Some(oldest) = self.segments.front().copied().filter(|_| self.segments.len() > 1) else {
            return Ok(false);
        };
        // The order matters: the keeper may rename the compressed form to the name of the segment at any moment. In the
        // other order the renamed file could stay.
        for name in [folder::packed(oldest.number), folder::segment(oldest.number)] {
            match self.folder.remove(&name) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        self.segments.pop_front();
        self.bytes -= oldest.bytes + oldest.packed;
        Ok(true)
    }
}

/// The ring of one flight recorder. Its growing files share it, on the same thread.
#[derive(Clone)]
pub(super) struct SharedRing(Arc<Mutex<Ring>>);

impl SharedRing {
    pub fn new(ring: Ring) -> Self {
        Self(Arc::new(Mutex::new(ring)))
    }

    pub fn lock(&self) -> MutexGuard<'_, Ring> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `write`; as long as the disk is full, deletes the oldest segment and calls it again.
    pub fn with_room<T>(&self, mut write: impl FnMut() -> io::Result<T>) -> io::Result<T> {
        loop {
            match write() {
                Err(error) if is_full(&error) && self.lock().delete_oldest()? => {}
                result => return result,
            }
        }
    }

    /// Creates the file of the newest segment; with `is_packed` the file of its compressed form.
    pub fn create(&self, number: u64, is_packed: bool) -> io::Result<SegmentFile> {
        let name = if is_packed { folder::packed(number) } else { folder::segment(number) };
        let folder = Arc::clone(&self.lock().folder);
        let output = self.with_room(|| folder.create(&name))?;
        Ok(SegmentFile { output, ring: self.clone(), is_packed })
    }

    /// The length of the file of the newest segment, bytes.
    pub fn live_bytes(&self) -> u64 {
        self.lock().segments.back().map_or(0, |segment| segment.bytes)
    }
}

/// Whether an error says that the disk is full or the quota of the user is used up.
fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

/// A file of the newest segment. Before each write the oldest segments are deleted, as far as the bound requires it.
pub(super) struct SegmentFile {
    output: Box<dyn Output>,
    ring: SharedRing,
    is_packed: bool,
}

impl Write for SegmentFile {
    /// Appends all bytes, or none of them.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let length = bytes.len() as u64;
        self.ring.lock().make_room(length)?;
        let output = &mut self.output;
        self.ring.with_room(|| output.append(bytes))?;
        let mut ring = self.ring.lock();
        ring.bytes += length;
        if let Some(live) = ring.segments.back_mut() {
            *(if self.is_packed { &mut live.packed } else { &mut live.bytes }) += length;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
