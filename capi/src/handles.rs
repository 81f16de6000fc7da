//! The boards that programs opened by URI.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};

use crate::board::OpenBoard;
use crate::error::CallError;

/// Handles are numbers and no addresses: one that was closed or made up is looked up in vain and harms nothing. None is
/// given out twice until all numbers of the machine's word are used up.
pub struct Handles {
    live: RwLock<Table>,
}

struct Table {
    boards: BTreeMap<usize, Arc<OpenBoard>>,
    next: usize,
}

/// The first handle given out; those below are kept for boards that have a name of their own.
pub(crate) const FIRST: usize = 0x10;

impl Handles {
    /// No board.
    pub const fn new() -> Self {
        Self { live: RwLock::new(Table { boards: BTreeMap::new(), next: FIRST }) }
    }

    /// Gives a board a handle.
    pub fn insert(&self, board: Arc<OpenBoard>) -> usize {
        let mut table = self.live.write().unwrap_or_else(PoisonError::into_inner);
        while table.boards.contains_key(&table.next) {
            table.next = after(table.next);
        }
        let handle = table.next;
        table.next = after(handle);
        table.boards.insert(handle, board);
        handle
    }

    /// The board of a handle.
    ///
    /// # Errors
    /// [`CallError::Handle`].
    pub fn get(&self, handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let table = self.live.read().unwrap_or_else(PoisonError::into_inner);
        table.boards.get(&handle).cloned().ok_or_else(|| CallError::Handle { handle }.into())
    }

    /// Takes the board of a handle out.
    ///
    /// # Errors
    /// [`CallError::Handle`].
    pub fn remove(&self, handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let mut table = self.live.write().unwrap_or_else(PoisonError::into_inner);
        table.boards.remove(&handle).ok_or_else(|| CallError::Handle { handle }.into())
    }

    /// Takes all boards out.
    #[cfg(unix)]
    pub fn drain(&self) -> Vec<Arc<OpenBoard>> {
        let mut table = self.live.write().unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut table.boards).into_values().collect()
    }
}

fn after(handle: usize) -> usize {
    handle.checked_add(1).unwrap_or(FIRST)
}
