//! One row of an object dictionary, written as a chain of constant functions, and the tables that are made of rows.

use crate::ethercat::AlState;
use crate::ethercat::coe::{AbortCode, ObjectAddress};

/// Data type of an object (ETG.1000.6 5.6.7, CiA 301 7.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataType {
    /// BOOLEAN, one byte in an SDO.
    Bool,
    /// INTEGER8.
    I8,
    /// UNSIGNED8.
    U8,
    /// INTEGER16.
    I16,
    /// UNSIGNED16.
    U16,
    /// INTEGER32.
    I32,
    /// UNSIGNED32.
    U32,
    /// INTEGER64.
    I64,
    /// UNSIGNED64. Numbers are `i64` with the same bits here, so that a row of this type has no range.
    U64,
    /// VISIBLE_STRING, of any length.
    Text,
}

impl DataType {
    /// The size of a value, bytes; 0 for a text, which has no fixed size.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 => 4,
            Self::I64 | Self::U64 => 8,
            Self::Text => 0,
        }
    }

    /// The size of a value in process data, bits: there a BOOLEAN is one bit (ETG.1000.6 5.6.7).
    pub const fn bits(self) -> u8 {
        match self {
            Self::Bool => 1,
            other => other.bytes() * 8,
        }
    }

    /// The least and the greatest value.
    pub const fn range(self) -> (i64, i64) {
        match self {
            Self::Bool => (0, 1),
            Self::I8 => (i8::MIN as i64, i8::MAX as i64),
            Self::U8 => (0, u8::MAX as i64),
            Self::I16 => (i16::MIN as i64, i16::MAX as i64),
            Self::U16 => (0, u16::MAX as i64),
            Self::I32 => (i32::MIN as i64, i32::MAX as i64),
            Self::U32 => (0, u32::MAX as i64),
            Self::I64 | Self::U64 | Self::Text => (i64::MIN, i64::MAX),
        }
    }

    /// The number whose low bytes are in `bits`.
    pub(in crate::slave) const fn decode(self, bits: u64) -> i64 {
        match self {
            Self::Bool | Self::U8 => bits as u8 as i64,
            Self::I8 => bits as i8 as i64,
            Self::I16 => bits as i16 as i64,
            Self::U16 => bits as u16 as i64,
            Self::I32 => bits as i32 as i64,
            Self::U32 => bits as u32 as i64,
            Self::I64 | Self::U64 | Self::Text => bits as i64,
        }
    }

    /// The bytes of a number as they are transferred, zero-extended.
    pub(super) const fn encode(self, number: i64) -> u64 {
        match self.bytes() {
            1 => number as u8 as u64,
            2 => number as u16 as u64,
            4 => number as u32 as u64,
            _ => number as u64,
        }
    }
}

/// Whether an object can be read and written by SDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The object can only be read.
    ReadOnly,
    /// The object can be read and written.
    ReadWrite,
    /// The object can only be written.
    WriteOnly,
    /// The object can always be read, and written up to this AL state.
    ReadWriteUpTo(AlState),
}

/// The direction of a PDO, as the slave sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PdoDirection {
    /// RxPDO: outputs, from the master to the slave.
    Rx,
    /// TxPDO: inputs, from the slave to the master.
    Tx,
}

/// Checks whether a value may be stored at an address.
type Accept<D> = fn(&D, ObjectAddress, i64) -> Result<(), AbortCode>;

/// Writes a live value, or refuses.
type Setter<D> = fn(&mut D, i64) -> Result<(), AbortCode>;

/// Where the value of a row is kept.
pub(super) enum Cell<D: 'static> {
    Stored { accept: Option<Accept<D>>, changed: Option<fn(&mut D)> },
    Live { get: fn(&D) -> i64, set: Option<Setter<D>> },
    Text(fn(&D) -> &'static str),
}

// Written out because a derive would ask for `D: Copy`.
impl<D> Clone for Cell<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Cell<D> {}

/// One row: an object, or a run of sub-indices that differ in their values only.
///
/// A row begins as a read-only, stored, unmapped value of 0 with the range of its type; the chained functions say what
/// is different.
pub struct Object<D: 'static> {
    pub(super) index: u16,
    pub(super) first_sub: u8,
    pub(super) count: u8,
    pub(super) name: &'static str,
    pub(super) data: DataType,
    pub(super) access: Access,
    pub(super) pdo: Option<PdoDirection>,
    pub(super) min: i64,
    pub(super) max: i64,
    pub(super) default: i64,
    pub(super) only_if: Option<fn(&D) -> bool>,
    /// The value is kept without power.
    pub(super) backup: bool,
    /// How process data write the object; `None`: as an SDO does.
    pub(super) output: Option<fn(&mut D, i64)>,
    pub(super) cell: Cell<D>,
}

impl<D> Clone for Object<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Object<D> {}

macro_rules! begin_row {
    ($($function:ident $data:ident $words:literal;)*) => {
        $(#[doc = concat!("A row of type ", $words, ".")]
        pub const fn $function(index: u16, sub: u8, name: &'static str) -> Self {
            Self::row(index, sub, name, DataType::$data)
        })*
    };
}

impl<D> Object<D> {
    begin_row! {
        bool Bool "BOOLEAN";
        i8 I8 "INTEGER8";
        u8 U8 "UNSIGNED8";
        i16 I16 "INTEGER16";
        u16 U16 "UNSIGNED16";
        i32 I32 "INTEGER32";
        u32 U32 "UNSIGNED32";
        i64 I64 "INTEGER64";
        u64 U64 "UNSIGNED64";
    }

    /// A row with a read-only text.
    pub const fn text(index: u16, sub: u8, name: &'static str, text: fn(&D) -> &'static str) -> Self {
        let mut row = Self::row(index, sub, name, DataType::Text);
        row.cell = Cell::Text(text);
        row
    }

    const fn row(index: u16, first_sub: u8, name: &'static str, data: DataType) -> Self {
        let (min, max) = data.range();
        let cell = Cell::Stored { accept: None, changed: None };
        let (access, pdo, only_if, output, backup) = (Access::ReadOnly, None, None, None, false);
        Self {
            index,
            first_sub,
            count: 1,
            name,
            data,
            access,
            pdo,
            min,
            max,
            default: 0,
            only_if,
            backup,
            output,
            cell,
        }
    }

    /// The row is for that many sub-indices, its own and those that follow.
    pub const fn array(mut self, count: u8) -> Self {
        self.count = count;
        self
    }

    /// Only those devices have the object for which the function is true.
    pub const fn only_if(mut self, has: fn(&D) -> bool) -> Self {
        self.only_if = Some(has);
        self
    }

    /// The device keeps the value without power.
    pub const fn backup(mut self) -> Self {
        self.backup = true;
        self
    }

    /// The object can be written.
    pub const fn rw(mut self) -> Self {
        self.access = Access::ReadWrite;
        self
    }

    /// The object can be written and not read.
    pub const fn wo(mut self) -> Self {
        self.access = Access::WriteOnly;
        self
    }

    /// The object can be written up to that AL state.
    pub const fn rw_up_to(mut self, highest: AlState) -> Self {
        self.access = Access::ReadWriteUpTo(highest);
        self
    }

    /// The object may be mapped into an RxPDO.
    pub const fn rx(mut self) -> Self {
        self.pdo = Some(PdoDirection::Rx);
        self
    }

    /// The object may be mapped into an RxPDO, and process data write it by that function instead of as an SDO does.
    pub const fn rx_by(mut self, output: fn(&mut D, i64)) -> Self {
        self.output = Some(output);
        self.rx()
    }

    /// The object may be mapped into a TxPDO.
    pub const fn tx(mut self) -> Self {
        self.pdo = Some(PdoDirection::Tx);
        self
    }

    /// A download may write values in `min..=max`.
    pub const fn range(mut self, min: i64, max: i64) -> Self {
        self.min = min;
        self.max = max;
        self
    }

    /// The stored value at power-on.
    pub const fn default(mut self, value: i64) -> Self {
        self.default = value;
        self
    }

    /// The value is a field of the device that `get` reads. It cannot be written unless the row has a
    /// [`setter`](Self::setter), too.
    pub const fn live(mut self, get: fn(&D) -> i64) -> Self {
        self.cell = Cell::Live { get, set: None };
        self
    }

    /// A live value is written by this function, which may refuse it.
    pub const fn setter(mut self, set: Setter<D>) -> Self {
        self.cell = match self.cell {
            Cell::Live { get, .. } => Cell::Live { get, set: Some(set) },
            _ => panic!("only a live row has a setter"),
        };
        self
    }

    /// A value has to pass this check, besides its range, before it is stored.
    pub const fn accept(mut self, accept: Accept<D>) -> Self {
        self.cell = match self.cell {
            Cell::Stored { changed, .. } => Cell::Stored { accept: Some(accept), changed },
            _ => panic!("only a stored row has a check of its own"),
        };
        self
    }

    /// This function is called after a download has changed the stored value.
    pub const fn changed(mut self, changed: fn(&mut D)) -> Self {
        self.cell = match self.cell {
            Cell::Stored { accept, .. } => Cell::Stored { accept, changed: Some(changed) },
            _ => panic!("only a stored row can be told that it changed"),
        };
        self
    }

    /// The address of the first sub-index of the row.
    pub const fn address(&self) -> ObjectAddress {
        ObjectAddress::new(self.index, self.first_sub)
    }

    /// Whether the row is for that address.
    pub const fn has(&self, at: ObjectAddress) -> bool {
        self.index == at.index && at.sub >= self.first_sub && at.sub - self.first_sub < self.count
    }

    /// How many sub-indices the row is for.
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// The name of the object in its profile.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The data type of the object.
    pub const fn data_type(&self) -> DataType {
        self.data
    }

    /// Whether the object can be read and written.
    pub const fn access(&self) -> Access {
        self.access
    }

    /// The direction of the PDOs that the object may be mapped into; `None`: it cannot be mapped.
    pub const fn pdo(&self) -> Option<PdoDirection> {
        self.pdo
    }
}

/// The number of rows of all parts of a table: the `N` of [`join`].
pub const fn rows<D>(parts: &[&[Object<D>]]) -> usize {
    let (mut rows, mut n) = (0, 0);
    while n < parts.len() {
        rows += parts[n].len();
        n += 1;
    }
    rows
}

/// The same rows, for those devices only for which the function is true, see [`Object::only_if`].
pub const fn only_if<D, const N: usize>(has: fn(&D) -> bool, mut rows: [Object<D>; N]) -> [Object<D>; N] {
    let mut n = 0;
    while n < N {
        rows[n].only_if = Some(has);
        n += 1;
    }
    rows
}

/// One table made of several parts, in ascending order of the addresses.
///
/// # Panics
/// If `N` is more than [`rows`]: in a constant, when compiling.
pub const fn join<D, const N: usize>(parts: &[&[Object<D>]]) -> [Object<D>; N] {
    let mut table = [parts[0][0]; N];
    let (mut part, mut row, mut n) = (0, 0, 0);
    while n < N {
        if row < parts[part].len() {
            let new = parts[part][row];
            let mut place = n;
            while place > 0 && new.precedes(&table[place - 1]) {
                table[place] = table[place - 1];
                place -= 1;
            }
            table[place] = new;
            (row, n) = (row + 1, n + 1);
        } else {
            (part, row) = (part + 1, 0);
        }
    }
    table
}

/// Checks a table when it is compiled: addresses ascend without overlap, ranges fit their data types, defaults fit their
/// ranges, and every object that can be written has a place for its value.
pub const fn check<D>(objects: &[Object<D>]) {
    let mut n = 0;
    let mut free_from = 0;
    while n < objects.len() {
        let object = &objects[n];
        let at = ((object.index as u32) << 8) + object.first_sub as u32;
        assert!(at >= free_from, "objects must ascend by index and sub-index");
        assert!(object.count > 0 && object.first_sub as u32 + object.count as u32 <= 256, "too many sub-indices");
        free_from = at + object.count as u32;
        let (min, max) = object.data.range();
        assert!(min <= object.min && object.min <= object.max && object.max <= max, "range outside the data type");
        assert!(min <= object.default && object.default <= max, "default outside the data type");
        let read_only = matches!(object.access, Access::ReadOnly);
        let mappable_text = object.pdo.is_some() && matches!(object.data, DataType::Text);
        assert!(!mappable_text, "a text has no fixed length in process data");
        let is_output = matches!(object.pdo, Some(PdoDirection::Rx));
        assert!(!is_output || !read_only || object.output.is_some(), "outputs have nowhere to go");
        if !read_only {
            assert!(object.min <= object.default && object.default <= object.max || object.is_live(), "bad default");
            assert!(!matches!(object.cell, Cell::Text(_) | Cell::Live { set: None, .. }), "nowhere to write to");
        }
        n += 1;
    }
}

impl<D> Object<D> {
    const fn precedes(&self, other: &Self) -> bool {
        self.index < other.index || self.index == other.index && self.first_sub < other.first_sub
    }

    const fn is_live(&self) -> bool {
        matches!(self.cell, Cell::Live { .. })
    }
}
