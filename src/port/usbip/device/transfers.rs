//! Pending transfers, oldest first. Their buffers are reused, so that after a while nothing is allocated.

use std::collections::VecDeque;

use super::{TRANSFERS_AT_ONCE, TooMany};

/// An IN transfer.
#[derive(Debug, Default)]
pub(super) struct Read {
    pub sequence: u32,
    /// How many bytes the host accepts.
    pub length: usize,
    pub bytes: Vec<u8>,
}

impl Read {
    /// How many more bytes fit.
    pub fn room(&self) -> usize {
        self.length - self.bytes.len()
    }
}

/// An OUT transfer.
#[derive(Debug, Default)]
pub(super) struct Write {
    pub sequence: u32,
    pub bytes: Vec<u8>,
    /// How many bytes the board has taken.
    pub moved: usize,
}

/// A transfer with the sequence number that the host has given it.
pub(super) trait Transfer: Default {
    fn sequence(&mut self) -> &mut u32;
}

impl Transfer for Read {
    fn sequence(&mut self) -> &mut u32 {
        &mut self.sequence
    }
}

impl Transfer for Write {
    fn sequence(&mut self) -> &mut u32 {
        &mut self.sequence
    }
}

/// The transfers of one direction.
#[derive(Debug)]
pub(super) struct Buffers<T> {
    waiting: VecDeque<T>,
    spare: Vec<T>,
}

impl<T> Default for Buffers<T> {
    fn default() -> Self {
        Self { waiting: VecDeque::new(), spare: Vec::new() }
    }
}

impl<T: Transfer> Buffers<T> {
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    pub fn first(&mut self) -> Option<&mut T> {
        self.waiting.front_mut()
    }

    pub fn is_first(&mut self, sequence: u32) -> bool {
        self.first().is_some_and(|first| *first.sequence() == sequence)
    }

    /// Adds a transfer; `fill` sets all of its fields except the sequence number.
    pub fn push(&mut self, sequence: u32, fill: impl FnOnce(&mut T)) -> Result<(), TooMany> {
        if self.waiting.len() >= TRANSFERS_AT_ONCE {
            return Err(TooMany);
        }
        let mut transfer = self.spare.pop().unwrap_or_default();
        *transfer.sequence() = sequence;
        fill(&mut transfer);
        self.waiting.push_back(transfer);
        Ok(())
    }

    /// Removes a transfer unless it is among the first `fixed`; returns whether it was there.
    pub fn remove(&mut self, sequence: u32, fixed: usize) -> bool {
        let at = (fixed..self.waiting.len()).find(|at| *self.waiting[*at].sequence() == sequence);
        let removed = at.and_then(|at| self.waiting.remove(at));
        let found = removed.is_some();
        self.spare.extend(removed);
        found
    }

    /// Removes the first transfer and passes it to `look`.
    pub fn end_first(&mut self, look: impl FnOnce(&T)) {
        if let Some(transfer) = self.waiting.pop_front() {
            look(&transfer);
            self.spare.push(transfer);
        }
    }
}
