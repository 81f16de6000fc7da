//! The table of the boards that a program has opened by URI.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};

use crate::board::OpenBoard;
use crate::error::CallError;

/// The table of open boards by their handles. A handle is a number and no address, so that one which was closed or made up is
/// not found and does no harm. No number is used again until all are used up.
pub struct Handles {
    table: RwLock<Table>,
}

struct Table {
    boards: BTreeMap<usize, Arc<OpenBoard>>,
    next: usize,
}

/// The first handle in the table. Smaller numbers are reserved for fixed handles; the vendor's board has handle 1.
pub(crate) const FIRST: usize = 0x10;

impl Handles {
    /// An empty table.
    pub const fn new() -> Self {
        Self { table: RwLock::new(Table { boards: BTreeMap::new(), next: FIRST }) }
    }

    /// Adds a board and returns its handle.
    pub fn insert(&self, board: Arc<OpenBoard>) -> usize {
        let mut table = self.table.write().unwrap_or_else(PoisonError::into_inner);
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
    /// [`CallError::Handle`]: no board in the table has this handle.
    pub fn get(&self, handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let table = self.table.read().unwrap_or_else(PoisonError::into_inner);
        table.boards.get(&handle).cloned().ok_or_else(|| CallError::Handle { handle }.into())
    }

    /// Removes the board of a handle and returns it.
    ///
    /// # Errors
    /// [`CallError::Handle`]: no board in the table has this handle.
    pub fn remove(&self, handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let mut table = self.table.write().unwrap_or_else(PoisonError::into_inner);
        table.boards.remove(&handle).ok_or_else(|| CallError::Handle { handle }.into())
    }

    /// All boards in the table.
    #[cfg(target_os = "linux")]
    pub fn all(&self) -> Vec<Arc<OpenBoard>> {
        self.table.read().unwrap_or_else(PoisonError::into_inner).boards.values().cloned().collect()
    }

    /// Removes all boards and returns them.
    #[cfg(unix)]
    pub fn drain(&self) -> Vec<Arc<OpenBoard>> {
        let mut table = self.table.write().unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut table.boards).into_values().collect()
    }
}

fn after(handle: usize) -> usize {
    handle.checked_add(1).unwrap_or(FIRST)
}
