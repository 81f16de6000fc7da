//! One row of an object dictionary, built by chained constant functions, and the tables made of rows.

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
    /// UNSIGNED64. Values are kept as `i64` with the same bits. A value above `i64::MAX` is then negative, so a row of
    /// this type cannot have a range.
    U64,
    /// VISIBLE_STRING, of any length.
    Text,
}

impl DataType {
    /// The size of a value in bytes; 0 for a text, which has no fixed size.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 => 4,
            Self::I64 | Self::U64 => 8,
            Self::Text => 0,
        }
    }

    /// The size of a value in process data, bits. There a BOOLEAN is one bit (ETG.1000.6 5.6.7).
    pub const fn bits(self) -> u8 {
        match self {
            Self::Bool => 1,
            other => other.bytes() * 8,
        }
    }

    /// The minimum and the maximum value of the type.
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

    /// Decodes the low bytes of `bits`, as many as the type has, as a number; sign-extended if the type is signed.
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
    /// The object can always be read. It can be written in this AL state and in the lower ones (Init, PreOP, SafeOP,
    /// OP).
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

/// An additional check of a value before it is stored at an address, both by SDO and by process data.
type Accept<D> = fn(&D, ObjectAddress, i64) -> Result<(), AbortCode>;

/// Writes a live value, or returns an abort code.
type Setter<D> = fn(&mut D, i64) -> Result<(), AbortCode>;

/// Where the value of a row comes from: a cell in [`Values`](super::Values), or functions of the device.
pub(super) enum Cell<D: 'static> {
    Stored { accept: Option<Accept<D>>, changed: Option<fn(&mut D)> },
    Live { get: fn(&D) -> i64, set: Option<Setter<D>> },
    Text(fn(&D) -> &'static str),
}

// Written by hand, because a derived implementation would require `D: Copy`.
impl<D> Clone for Cell<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Cell<D> {}

/// One row of the table: an object, or several consecutive sub-indices of an object that have all properties but their
/// values in common.
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
    /// Whether the device keeps the value without power.
    pub(super) backup: bool,
    /// The function by which process data write the object; `None`: process data write the object as an SDO does.
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

    /// A row for a read-only text object, whose text the function `text` returns.
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

    /// Makes the row describe `count` consecutive sub-indices instead of one.
    pub const fn array(mut self, count: u8) -> Self {
        self.count = count;
        self
    }

    /// Restricts the object to devices for which the function returns true.
    pub const fn only_if(mut self, has: fn(&D) -> bool) -> Self {
        self.only_if = Some(has);
        self
    }

    /// Marks the value in SDO information as kept without power (backup). This only sets the mark: the device itself
    /// has to store the value.
    pub const fn backup(mut self) -> Self {
        self.backup = true;
        self
    }

    /// Makes the object readable and writable.
    pub const fn rw(mut self) -> Self {
        self.access = Access::ReadWrite;
        self
    }

    /// Makes the object write-only.
    pub const fn wo(mut self) -> Self {
        self.access = Access::WriteOnly;
        self
    }

    /// Makes the object readable always, and writable in the AL state `highest` and in the lower ones (Init, PreOP,
    /// SafeOP, OP).
    pub const fn rw_up_to(mut self, highest: AlState) -> Self {
        self.access = Access::ReadWriteUpTo(highest);
        self
    }

    /// Makes the object mappable into an RxPDO.
    pub const fn rx(mut self) -> Self {
        self.pdo = Some(PdoDirection::Rx);
        self
    }

    /// Makes the object mappable into an RxPDO. Process data call `output` instead of writing as an SDO does.
    pub const fn rx_by(mut self, output: fn(&mut D, i64)) -> Self {
        self.output = Some(output);
        self.rx()
    }

    /// Makes the object mappable into a TxPDO.
    pub const fn tx(mut self) -> Self {
        self.pdo = Some(PdoDirection::Tx);
        self
    }

    /// Sets the allowed range for writing, both ends included.
    pub const fn range(mut self, min: i64, max: i64) -> Self {
        self.min = min;
        self.max = max;
        self
    }

    /// Sets the default, which is the stored value at power-on.
    pub const fn default(mut self, value: i64) -> Self {
        self.default = value;
        self
    }

    /// Makes the value live: `get` reads it from a field of the device. The object is read-only unless the row has a
    /// [`setter`](Self::setter) too.
    pub const fn live(mut self, get: fn(&D) -> i64) -> Self {
        self.cell = Cell::Live { get, set: None };
        self
    }

    /// Sets the function that writes a live value and may refuse it.
    pub const fn setter(mut self, set: Setter<D>) -> Self {
        self.cell = match self.cell {
            Cell::Live { get, .. } => Cell::Live { get, set: Some(set) },
            _ => panic!("only a live row has a setter"),
        };
        self
    }

    /// Sets an additional check that a value has to pass, besides its range, before it is stored.
    pub const fn accept(mut self, accept: Accept<D>) -> Self {
        self.cell = match self.cell {
            Cell::Stored { changed, .. } => Cell::Stored { accept: Some(accept), changed },
            _ => panic!("only a stored row has a check of its own"),
        };
        self
    }

    /// Sets a function that is called after an SDO download has stored a value, and after process data have stored a
    /// different value.
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

    /// Whether the row contains the sub-index with this address.
    pub const fn has(&self, at: ObjectAddress) -> bool {
        self.index == at.index && at.sub >= self.first_sub && at.sub - self.first_sub < self.count
    }

    /// The number of sub-indices of the row.
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// The name of the object in its profile.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The data type of the value.
    pub const fn data_type(&self) -> DataType {
        self.data
    }

    /// Whether SDOs can read and write the object.
    pub const fn access(&self) -> Access {
        self.access
    }

    /// The direction of the PDOs that the object can be mapped into; `None`: it cannot be mapped.
    pub const fn pdo(&self) -> Option<PdoDirection> {
        self.pdo
    }
}

/// The total number of rows of several tables: the `N` of [`join`].
pub const fn rows<D>(parts: &[&[Object<D>]]) -> usize {
    let (mut rows, mut n) = (0, 0);
    while n < parts.len() {
        rows += parts[n].len();
        n += 1;
    }
    rows
}

/// The rows, restricted to devices for which the function returns true, see [`Object::only_if`].
pub const fn only_if<D, const N: usize>(has: fn(&D) -> bool, mut rows: [Object<D>; N]) -> [Object<D>; N] {
    let mut n = 0;
    while n < N {
        rows[n].only_if = Some(has);
        n += 1;
    }
    rows
}

/// Joins several tables into one, in ascending order of address.
///
/// # Panics
/// If `N` is greater than [`rows`] of the tables. In a constant this is a compile-time error.
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

/// Checks a table at compile time: addresses ascend without overlap, ranges fit their data types, defaults fit their
/// ranges, and every writable object is stored or has a setter.
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
