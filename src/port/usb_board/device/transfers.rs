//! Pending transfers, oldest first. Their buffers are reused, so that after a while nothing is allocated.

use std::collections::VecDeque;

use super::{TRANSFERS_AT_ONCE, TooMany};

/// A pending transfer.
#[derive(Debug, Default)]
pub(super) struct Pending {
    /// The sequence number that the host has given the transfer.
    pub sequence: u32,
    /// How many bytes the host accepts of an IN transfer.
    pub length: usize,
    /// For an IN transfer, the bytes for the host that have come from the board so far; for an OUT transfer, all bytes
    /// from the host.
    pub bytes: Vec<u8>,
    /// How many bytes of an OUT transfer the board has taken.
    pub moved: usize,
}

impl Pending {
    /// How many more bytes of an IN transfer fit.
    pub fn room(&self) -> usize {
        self.length - self.bytes.len()
    }
}

/// The transfers of one direction.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    waiting: VecDeque<Pending>,
    spare: Vec<Pending>,
}

impl Buffers {
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    pub fn first(&mut self) -> Option<&mut Pending> {
        self.waiting.front_mut()
    }

    pub fn is_first(&self, sequence: u32) -> bool {
        self.waiting.front().is_some_and(|first| first.sequence == sequence)
    }

    /// Adds a transfer of which no byte was moved yet: `bytes` come from the host, and `length` bytes may go to it.
    /// Fails if [`TRANSFERS_AT_ONCE`] transfers are pending in this direction.
    pub fn push(&mut self, sequence: u32, length: usize, bytes: &[u8]) -> Result<(), TooMany> {
        if self.waiting.len() >= TRANSFERS_AT_ONCE {
            return Err(TooMany);
        }
        let mut buffer = self.spare.pop().unwrap_or_default().bytes;
        buffer.clear();
        buffer.extend_from_slice(bytes);
        self.waiting.push_back(Pending { sequence, length, bytes: buffer, moved: 0 });
        Ok(())
    }

    /// Removes the transfer with this sequence number. The first `fixed` transfers, whose frames are being written to
    /// the board, cannot be removed. Returns whether a transfer was removed.
    pub fn remove(&mut self, sequence: u32, fixed: usize) -> bool {
        let at = (fixed..self.waiting.len()).find(|at| self.waiting[*at].sequence == sequence);
        let removed = at.and_then(|at| self.waiting.remove(at));
        let found = removed.is_some();
        self.spare.extend(removed);
        found
    }

    /// Removes the first transfer and passes it to `look`.
    pub fn end_first(&mut self, look: impl FnOnce(&Pending)) {
        if let Some(transfer) = self.waiting.pop_front() {
            look(&transfer);
            self.spare.push(transfer);
        }
    }
}
