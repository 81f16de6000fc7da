//! CANopen over EtherCAT (CoE): object addresses, sizes of SDO transfers, abort codes, and the mailbox messages for SDOs,
//! SDO information and emergencies.
//!
//! The SDO slot of the ECM-SK, the simulated slaves and every fieldbus use these types. No I/O, no state, `no_std`.

mod data_type;
mod emergency;
mod information;
mod message;
mod sdo;

pub use data_type::{DataTypeCode, ValueForm};
pub use emergency::Emergency;
pub use information::{
    EntryDescription, EntryRequest, InformationFragment, InformationKind, ObjectAccess, ObjectCode, ObjectDescription,
    ObjectListType, ValueInfo, decode_abort, decode_u16,
};
pub use message::{COE_HEADER_LEN, CoeMessage, CoeService};
pub use sdo::{FIRST_OVERHEAD, SDO_LEN, SEGMENT_OVERHEAD, SdoRequest, SdoResponse, SdoValuePart};

use super::named_codes::named_codes;
use core::fmt;

/// The address of an entry in a slave's object dictionary. `0x6041:0` is index 0x6041, sub-index 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectAddress {
    /// Index, 0x0000..=0xFFFF.
    pub index: u16,
    /// Sub-index, 0..=255.
    pub sub: u8,
}

impl ObjectAddress {
    /// The entry `index:sub`.
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }
}

impl fmt::Display for ObjectAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{}", self.index, self.sub)
    }
}

/// The number of data bytes in an expedited SDO download. The ECM-SK allows 1, 2 and 4 (UG17 2.1.9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoSize {
    /// 8 bits.
    One = 1,
    /// 16 bits.
    Two = 2,
    /// 32 bits.
    Four = 4,
}

impl SdoSize {
    /// The size for `n` bytes; `None` unless `n` is 1, 2 or 4.
    pub const fn from_bytes(n: u8) -> Option<Self> {
        match n {
            1 => Some(Self::One),
            2 => Some(Self::Two),
            4 => Some(Self::Four),
            _ => None,
        }
    }

    /// The number of bytes: 1, 2 or 4.
    pub const fn bytes(self) -> u8 {
        self as u8
    }

    /// The mask for the low 8, 16 or 32 bits of a value, which a transfer of this size carries.
    pub const fn mask(self) -> u32 {
        match self {
            Self::One => 0xFF,
            Self::Two => 0xFFFF,
            Self::Four => 0xFFFF_FFFF,
        }
    }
}

/// Whether an SDO transfer carries one sub-index or the whole object (ETG.1000.6 5.6.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoScope {
    /// The value at one sub-index.
    Entry,
    /// Complete access: the values of all sub-indices, one after the other. The request says whether they begin with
    /// sub-index 0 or 1. A byte of padding follows sub-index 0, whose 8 bits are transferred as 16.
    Complete,
}

/// An SDO abort code (ETG.1000.6, table "SDO abort codes"; the same as CiA 301).
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct AbortCode(pub u32);

named_codes! {
    AbortCode as "0x{:08X}";
    TOGGLE_BIT = 0x0503_0000, "toggle bit not changed";
    TIMEOUT = 0x0504_0000, "SDO protocol timeout";
    COMMAND = 0x0504_0001, "client or server command specifier not valid or unknown";
    OUT_OF_MEMORY = 0x0504_0005, "out of memory";
    UNSUPPORTED_ACCESS = 0x0601_0000, "unsupported access to an object";
    WRITE_ONLY = 0x0601_0001, "attempt to read a write-only object";
    READ_ONLY = 0x0601_0002, "attempt to write a read-only object";
    SUB_INDEX_READ_ONLY = 0x0601_0003, "sub-index cannot be written, sub-index 0 must be 0 for write access";
    COMPLETE_ACCESS = 0x0601_0004, "complete access not supported for objects of variable length";
    OBJECT_TOO_LONG = 0x0601_0005, "object length exceeds mailbox size";
    MAPPED = 0x0601_0006, "object mapped to RxPDO, SDO download blocked";
    NO_OBJECT = 0x0602_0000, "object does not exist in the object dictionary";
    NOT_MAPPABLE = 0x0604_0041, "object cannot be mapped into the PDO";
    PDO_LENGTH = 0x0604_0042, "number and length of the objects to be mapped would exceed the PDO length";
    PARAMETER_INCOMPATIBLE = 0x0604_0043, "general parameter incompatibility";
    INTERNAL_INCOMPATIBLE = 0x0604_0047, "general internal incompatibility in the device";
    HARDWARE = 0x0606_0000, "access failed due to a hardware error";
    LENGTH = 0x0607_0010, "data type does not match, length of service parameter does not match";
    TOO_LONG = 0x0607_0012, "data type does not match, length of service parameter too high";
    TOO_SHORT = 0x0607_0013, "data type does not match, length of service parameter too low";
    NO_SUB_INDEX = 0x0609_0011, "sub-index does not exist";
    VALUE_RANGE = 0x0609_0030, "value range of parameter exceeded";
    VALUE_HIGH = 0x0609_0031, "value of parameter written too high";
    VALUE_LOW = 0x0609_0032, "value of parameter written too low";
    MODULE_LIST = 0x0609_0033, "configured module list does not match the detected one";
    MAX_LESS_THAN_MIN = 0x0609_0036, "maximum value is less than minimum value";
    GENERAL = 0x0800_0000, "general error";
    STORE = 0x0800_0020, "data cannot be transferred or stored to the application";
    LOCAL_CONTROL = 0x0800_0021, "data cannot be transferred or stored because of local control";
    DEVICE_STATE = 0x0800_0022, "data cannot be transferred or stored because of the present device state";
    NO_DICTIONARY = 0x0800_0023, "object dictionary dynamic generation fails or no object dictionary is present";
    NO_DATA = 0x0800_0024, "no data available";
}

impl fmt::Debug for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AbortCode({self})")
    }
}
