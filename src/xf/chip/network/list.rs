//! A list of fixed capacity, so that operations on slave models do not allocate.

use std::ops::Deref;

/// A list of up to `N` items.
#[derive(Clone, Copy, Debug)]
pub struct List<T, const N: usize> {
    items: [T; N],
    len: usize,
}

impl<T: Copy, const N: usize> List<T, N> {
    /// An empty list. `fill` is the value of unused entries.
    pub const fn empty(fill: T) -> Self {
        Self { items: [fill; N], len: 0 }
    }

    /// A list of the first items. Items for which there is no room are left out, such as the bytes of a value beyond a data
    /// segment.
    pub fn of(fill: T, items: &[T]) -> Self {
        let mut list = Self::empty(fill);
        list.len = items.len().min(N);
        list.items[..list.len].copy_from_slice(&items[..list.len]);
        list
    }

    /// Adds an item. If the list is full the item is dropped; lists of slaves have room for all slaves.
    pub fn push(&mut self, item: T) {
        if let Some(place) = self.items.get_mut(self.len) {
            *place = item;
            self.len += 1;
        }
    }

    /// Replaces the items: `fill` writes new items into the first `room` entries. Returns the number that `fill`
    /// returns, which may be larger than the room; the list has then `room` items.
    ///
    /// # Errors
    /// The error of `fill`.
    pub fn fill<E>(&mut self, room: usize, fill: impl FnOnce(&mut [T]) -> Result<usize, E>) -> Result<usize, E> {
        let room = room.min(N);
        let len = fill(&mut self.items[..room])?;
        self.len = len.min(room);
        Ok(len)
    }
}

impl<T, const N: usize> Deref for List<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items[..self.len]
    }
}

impl<T: PartialEq, const N: usize> PartialEq for List<T, N> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Eq, const N: usize> Eq for List<T, N> {}
