//! Transfers that a host waits for, oldest first. Their buffers are used again: after a while nothing is allocated.

use std::collections::VecDeque;

use super::{TRANSFERS_AT_ONCE, TooMany};

/// A transfer to the host.
#[derive(Debug, Default)]
pub(super) struct Read {
    pub sequence: u32,
    /// Bytes that the host has room for.
    pub length: usize,
    pub bytes: Vec<u8>,
}

impl Read {
    /// Bytes that fit still.
    pub fn room(&self) -> usize {
        self.length - self.bytes.len()
    }
}

/// A transfer to the board.
#[derive(Debug, Default)]
pub(super) struct Write {
    pub sequence: u32,
    pub bytes: Vec<u8>,
    /// Bytes that the board has.
    pub moved: usize,
}

/// What has a number that the host gave it.
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

/// Transfers of one direction.
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

    /// Adds a transfer; `fill` sets all of it but its number.
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

    /// Takes a transfer out, wherever it stands but among the first `fixed`; says whether it was there.
    pub fn remove(&mut self, sequence: u32, fixed: usize) -> bool {
        let at = (fixed..self.waiting.len()).find(|at| *self.waiting[*at].sequence() == sequence);
        let removed = at.and_then(|at| self.waiting.remove(at));
        let found = removed.is_some();
        self.spare.extend(removed);
        found
    }

    /// Takes the first one out once it was looked at.
    pub fn end_first(&mut self, look: impl FnOnce(&T)) {
        if let Some(transfer) = self.waiting.pop_front() {
            look(&transfer);
            self.spare.push(transfer);
        }
    }
}
