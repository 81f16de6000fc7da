//! A list in a place of its own, so that what slave models are asked for allocates nothing.

use std::ops::Deref;

/// Up to `N` items.
#[derive(Clone, Copy, Debug)]
pub struct List<T, const N: usize> {
    items: [T; N],
    len: usize,
}

impl<T: Copy, const N: usize> List<T, N> {
    /// An empty list. `fill` is what lies in places that are not in use.
    pub const fn empty(fill: T) -> Self {
        Self { items: [fill; N], len: 0 }
    }

    /// The first items, as many as there is room for.
    pub fn of(fill: T, items: &[T]) -> Self {
        let mut list = Self::empty(fill);
        list.len = items.len().min(N);
        list.items[..list.len].copy_from_slice(&items[..list.len]);
        list
    }

    /// Adds an item; one for which there is no room is left out.
    pub fn push(&mut self, item: T) {
        if let Some(place) = self.items.get_mut(self.len) {
            *place = item;
            self.len += 1;
        }
    }

    /// Has `fill` write into the whole room, and takes as many items as it says, at most those.
    ///
    /// # Errors
    /// What `fill` gives.
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
