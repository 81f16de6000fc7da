//! The tables of what a program has opened: boards by URI, machine files.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::Arc;

use ecmsk::threads::sync::{Mutex, lock};

/// The handles of boards. Smaller numbers are reserved for fixed handles; the vendor's board has handle 1.
pub const OF_BOARDS: RangeInclusive<usize> = 0x10..=usize::MAX / 2;
/// The handles of machine files. No board has one of them, so that a handle of the wrong kind is not found.
pub const OF_MACHINES: RangeInclusive<usize> = usize::MAX / 2 + 1..=usize::MAX;

/// A table of open boards or machine files, by handle. A handle is a number and not an address, so that a handle that
/// was closed or invented is not found and does no harm. No number is used again until all are used up.
pub struct Handles<T> {
    /// The numbers of the handles.
    range: RangeInclusive<usize>,
    table: Mutex<Table<T>>,
}

struct Table<T> {
    open: BTreeMap<usize, Arc<T>>,
    next: usize,
}

impl<T> Handles<T> {
    /// An empty table with handles of this range.
    pub const fn new(range: RangeInclusive<usize>) -> Self {
        let next = *range.start();
        Self { range, table: Mutex::new(Table { open: BTreeMap::new(), next }) }
    }

    /// Adds an opened board or machine file and returns its handle.
    pub fn insert(&self, opened: Arc<T>) -> usize {
        let mut table = lock(&self.table);
        while table.open.contains_key(&table.next) {
            table.next = self.after(table.next);
        }
        let handle = table.next;
        table.next = self.after(handle);
        table.open.insert(handle, opened);
        handle
    }

    /// The open board or machine file with this handle.
    pub fn get(&self, handle: usize) -> Option<Arc<T>> {
        lock(&self.table).open.get(&handle).cloned()
    }

    /// Removes the board or machine file with this handle and returns it.
    pub fn remove(&self, handle: usize) -> Option<Arc<T>> {
        lock(&self.table).open.remove(&handle)
    }

    /// All boards or machine files of the table.
    #[cfg(target_os = "linux")]
    pub fn all(&self) -> Vec<Arc<T>> {
        lock(&self.table).open.values().cloned().collect()
    }

    /// Removes all boards or machine files and returns them.
    #[cfg(unix)]
    pub fn drain(&self) -> Vec<Arc<T>> {
        let mut table = lock(&self.table);
        std::mem::take(&mut table.open).into_values().collect()
    }

    fn after(&self, handle: usize) -> usize {
        if handle == *self.range.end() { *self.range.start() } else { handle + 1 }
    }
}
