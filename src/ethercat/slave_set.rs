//! Sets of slaves, stored as the bits of one word, because every cycle tests and changes them for each slave.

/// The maximum number of slaves on the network of a board: 40 with 12-byte slots (SK-1). With 16-byte slots it is 30.
pub const MAX_SLAVES: usize = 40;

/// A set of slaves, numbered from 1 in network order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SlaveSet(u64);

impl SlaveSet {
    /// No slave.
    pub const EMPTY: Self = Self(0);

    /// The slaves whose bits are set; bit 0 is slave 1. Bits from [`MAX_SLAVES`] on must be 0: [`Self::iter`] leaves
    /// them out, but [`Self::len`] counts them.
    pub const fn from_bits(bits: u64) -> Self {
        Self(bits)
    }

    /// A bit for each slave in the set: bit 0 is slave 1.
    pub const fn bits(self) -> u64 {
        self.0
    }

    /// The slaves 1 to `n` in network order, with `n` in 0..=40.
    pub const fn first(n: u8) -> Self {
        Self((1 << n as u64) - 1)
    }

    /// Whether `slave` (from 1) is in the set.
    pub const fn contains(self, slave: u8) -> bool {
        slave >= 1 && self.0 & (1 << (slave as u64 - 1)) != 0
    }

    /// Adds `slave` (from 1) to the set.
    pub const fn insert(&mut self, slave: u8) {
        self.0 |= 1 << (slave as u64 - 1);
    }

    /// Removes `slave` (from 1) from the set.
    pub const fn remove(&mut self, slave: u8) {
        self.0 &= !(1 << (slave as u64 - 1));
    }

    /// Whether no slave is in the set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The slaves that are in either set.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The slaves that are in both sets.
    #[must_use]
    pub const fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// The slaves that are in this set and not in the other.
    #[must_use]
    pub const fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The number of slaves in the set.
    pub const fn len(self) -> u8 {
        self.0.count_ones() as u8
    }

    /// The slaves in ascending order.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        let mut left = self.0 & ((1 << MAX_SLAVES) - 1);
        core::iter::from_fn(move || {
            let slave = (left != 0).then(|| left.trailing_zeros() as u8 + 1)?;
            left &= left - 1;
            Some(slave)
        })
    }
}

impl FromIterator<u8> for SlaveSet {
    fn from_iter<T: IntoIterator<Item = u8>>(slaves: T) -> Self {
        let mut set = Self::EMPTY;
        slaves.into_iter().for_each(|slave| set.insert(slave));
        set
    }
}
