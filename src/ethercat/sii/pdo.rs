//! PDOs in an EEPROM: the default PDO mapping of a slave.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::wire_error::{room_for, split};
use crate::ethercat::{U16Le, WireError};

/// One object of a PDO.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiPdoEntry {
    /// The object's index; 0: the entry is padding between objects, `bits` long.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// The number of the text with the object's name; 0: none.
    pub name: u8,
    /// The code of the data type, as in the object dictionary.
    pub data_type: u8,
    /// The object's length in bits.
    pub bits: u8,
    /// Flags, not interpreted.
    pub flags: u16,
}

/// Wire layout of [`SiiPdoEntry`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct EntryLayout {
    index: U16Le,
    sub: u8,
    name: u8,
    data_type: u8,
    bits: u8,
    flags: U16Le,
}

impl SiiPdoEntry {
    /// Length of an entry in bytes.
    pub const LEN: usize = 8;

    /// Decodes an entry.
    pub fn decode(bytes: &[u8; Self::LEN]) -> Self {
        let layout: &EntryLayout = bytemuck::cast_ref(bytes);
        Self {
            index: layout.index.get(),
            sub: layout.sub,
            name: layout.name,
            data_type: layout.data_type,
            bits: layout.bits,
            flags: layout.flags.get(),
        }
    }

    /// The entry as bytes.
    pub fn encode(&self) -> [u8; Self::LEN] {
        bytemuck::cast(EntryLayout {
            index: self.index.into(),
            sub: self.sub,
            name: self.name,
            data_type: self.data_type,
            bits: self.bits,
            flags: self.flags.into(),
        })
    }
}

/// The objects of a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiiPdoEntries<'a>(&'a [[u8; SiiPdoEntry::LEN]]);

impl<'a> SiiPdoEntries<'a> {
    /// The entries in their order.
    pub fn iter(self) -> impl ExactSizeIterator<Item = SiiPdoEntry> + 'a {
        self.0.iter().map(SiiPdoEntry::decode)
    }
}

/// A PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiiPdo<'a> {
    /// The index of the PDO mapping object.
    pub index: u16,
    /// The sync manager that the PDO is assigned to; 0xFF: none.
    pub sync_manager: u8,
    /// The synchronization setting of the PDO. A raw value, which this crate does not use.
    pub sync_unit: u8,
    /// The number of the text with the PDO's name; 0: none.
    pub name: u8,
    /// Flags, not interpreted.
    pub flags: u16,
    /// The mapped objects.
    pub entries: SiiPdoEntries<'a>,
}

const HEADER_LEN: usize = 8;

/// Wire layout of a PDO in front of its entries.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PdoLayout {
    index: U16Le,
    entries: u8,
    sync_manager: u8,
    sync_unit: u8,
    name: u8,
    flags: U16Le,
}

impl<'a> SiiPdo<'a> {
    /// Length in bytes of the fixed part of a PDO, in front of its entries.
    pub const HEADER_LEN: usize = HEADER_LEN;

    /// Splits off the first PDO in `bytes`; also returns the bytes after it.
    ///
    /// # Errors
    /// [`WireError::Short`]: the bytes end before the PDO does.
    pub fn split(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), WireError> {
        let (header, rest) = split::<HEADER_LEN>(bytes, "PDO")?;
        let layout: &PdoLayout = bytemuck::cast_ref(header);
        let needed = usize::from(layout.entries) * SiiPdoEntry::LEN;
        let short = WireError::Short { part: "entries of a PDO", needed, found: rest.len() };
        let (entries, rest) = rest.split_at_checked(needed).ok_or(short)?;
        let pdo = Self {
            index: layout.index.get(),
            sync_manager: layout.sync_manager,
            sync_unit: layout.sync_unit,
            name: layout.name,
            flags: layout.flags.get(),
            entries: SiiPdoEntries(entries.as_chunks().0),
        };
        Ok((pdo, rest))
    }

    /// Writes the PDO with the entries in `entries`; those in `self.entries` are ignored. Returns the length in bytes.
    /// At most 255 entries are written, since the number of entries has one byte.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the PDO does not fit.
    pub fn encode(&self, entries: &[SiiPdoEntry], room: &mut [u8]) -> Result<usize, WireError> {
        let entries = &entries[..entries.len().min(usize::from(u8::MAX))];
        let len = Self::HEADER_LEN + entries.len() * SiiPdoEntry::LEN;
        let (header, places) = room_for(room, "PDO", len)?.split_at_mut(Self::HEADER_LEN);
        header.copy_from_slice(bytemuck::bytes_of(&PdoLayout {
            index: self.index.into(),
            entries: entries.len() as u8,
            sync_manager: self.sync_manager,
            sync_unit: self.sync_unit,
            name: self.name,
            flags: self.flags.into(),
        }));
        for (place, entry) in places.as_chunks_mut().0.iter_mut().zip(entries) {
            *place = entry.encode();
        }
        Ok(len)
    }

    /// A PDO to be encoded. Its field `entries` is empty, because [`Self::encode`] takes the entries as an argument.
    pub const fn new(index: u16, sync_manager: u8, name: u8) -> Self {
        Self { index, sync_manager, sync_unit: 0, name, flags: 0, entries: SiiPdoEntries(&[]) }
    }
}

/// Iterator over the PDOs of a category. If decoding fails, the error is the last item.
#[derive(Clone, Debug)]
pub struct SiiPdos<'a> {
    rest: &'a [u8],
}

impl<'a> SiiPdos<'a> {
    pub(super) const fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }
}

impl<'a> Iterator for SiiPdos<'a> {
    type Item = Result<SiiPdo<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let split = SiiPdo::split(core::mem::take(&mut self.rest));
        Some(split.map(|(pdo, rest)| {
            self.rest = rest;
            pdo
        }))
    }
}
