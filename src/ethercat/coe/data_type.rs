//! Codes of data types in the object dictionary, as SDO information uses them.

use crate::ethercat::named_codes::named_codes;

/// The code of a data type in the object dictionary (ETG.1000.6 5.6.7.1).
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct DataTypeCode(pub u16);

named_codes! {
    DataTypeCode as "0x{:04X}";
    NONE = 0x0000, "no type of its own";
    BOOLEAN = 0x0001, "BOOLEAN";
    INTEGER8 = 0x0002, "INTEGER8";
    INTEGER16 = 0x0003, "INTEGER16";
    INTEGER32 = 0x0004, "INTEGER32";
    UNSIGNED8 = 0x0005, "UNSIGNED8";
    UNSIGNED16 = 0x0006, "UNSIGNED16";
    UNSIGNED32 = 0x0007, "UNSIGNED32";
    REAL32 = 0x0008, "REAL32";
    VISIBLE_STRING = 0x0009, "VISIBLE_STRING";
    OCTET_STRING = 0x000A, "OCTET_STRING";
    UNICODE_STRING = 0x000B, "UNICODE_STRING";
    TIME_OF_DAY = 0x000C, "TIME_OF_DAY";
    TIME_DIFFERENCE = 0x000D, "TIME_DIFFERENCE";
    DOMAIN = 0x000F, "DOMAIN";
    INTEGER24 = 0x0010, "INTEGER24";
    REAL64 = 0x0011, "REAL64";
    INTEGER40 = 0x0012, "INTEGER40";
    INTEGER48 = 0x0013, "INTEGER48";
    INTEGER56 = 0x0014, "INTEGER56";
    INTEGER64 = 0x0015, "INTEGER64";
    UNSIGNED24 = 0x0016, "UNSIGNED24";
    UNSIGNED40 = 0x0018, "UNSIGNED40";
    UNSIGNED48 = 0x0019, "UNSIGNED48";
    UNSIGNED56 = 0x001A, "UNSIGNED56";
    UNSIGNED64 = 0x001B, "UNSIGNED64";
    GUID = 0x001D, "GUID";
    BYTE = 0x001E, "BYTE";
    WORD = 0x001F, "WORD";
    DWORD = 0x0020, "DWORD";
    PDO_MAPPING = 0x0021, "PDO_MAPPING";
    IDENTITY = 0x0023, "IDENTITY";
    COMMAND_PARAMETER = 0x0025, "COMMAND_PAR";
    SYNC_MANAGER_PARAMETER = 0x0029, "SYNC_PAR";
    BITARR8 = 0x002D, "BITARR8";
    BITARR16 = 0x002E, "BITARR16";
    BITARR32 = 0x002F, "BITARR32";
    BIT1 = 0x0030, "BIT1";
    BIT2 = 0x0031, "BIT2";
    BIT3 = 0x0032, "BIT3";
    BIT4 = 0x0033, "BIT4";
    BIT5 = 0x0034, "BIT5";
    BIT6 = 0x0035, "BIT6";
    BIT7 = 0x0036, "BIT7";
    BIT8 = 0x0037, "BIT8";
}

impl core::fmt::Debug for DataTypeCode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "DataTypeCode({self})")
    }
}

/// How to interpret the bytes of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ValueForm {
    /// An unsigned integer.
    Unsigned,
    /// A signed integer in two's complement.
    Signed,
    /// An IEEE 754 floating-point number of 4 or 8 bytes.
    Real,
    /// Text, one byte per character.
    Text,
    /// Bytes with an unknown interpretation.
    Bytes,
}

impl DataTypeCode {
    /// How to interpret the bytes of a value of this type.
    pub const fn form(self) -> ValueForm {
        match self {
            Self::INTEGER8
            | Self::INTEGER16
            | Self::INTEGER24
            | Self::INTEGER32
            | Self::INTEGER40
            | Self::INTEGER48
            | Self::INTEGER56
            | Self::INTEGER64 => ValueForm::Signed,
            Self::BOOLEAN
            | Self::UNSIGNED8
            | Self::UNSIGNED16
            | Self::UNSIGNED24
            | Self::UNSIGNED32
            | Self::UNSIGNED40
            | Self::UNSIGNED48
            | Self::UNSIGNED56
            | Self::UNSIGNED64
            | Self::BYTE
            | Self::WORD
            | Self::DWORD
            | Self::BITARR8
            | Self::BITARR16
            | Self::BITARR32 => ValueForm::Unsigned,
            Self(0x0030..=0x0037) => ValueForm::Unsigned,
            Self::REAL32 | Self::REAL64 => ValueForm::Real,
            Self::VISIBLE_STRING => ValueForm::Text,
            _ => ValueForm::Bytes,
        }
    }
}
