//! Requests for objects of slaves, by SDO.

use super::SlaveNumber;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::xf::Allowed;
use crate::xf::fields::FieldKind;
use crate::xf::layout::{field_values, layout};
use crate::xf::value::Switch;

layout! {
    /// ECAT_SDO_GET, command code 11: returns the data that [`SdoRequest`] has read (XF EN 606).
    pub struct SdoGet;

    /// ECAT_SDO_ABORTCODE_GET, command code 69: reads the abort code of the last failed [`SdoRequest`] (XF EN 1358).
    /// Answer: u32 at byte 0 of the data.
    pub struct SdoAbortCodeGet;
}

/// The maximum number of bytes that [`SdoRequest`] writes.
pub const SDO_DATA_MAX: usize = 256;
/// The offset of the data to write, after the fields of [`SdoRequest`], in bytes.
pub(crate) const SDO_HEAD: usize = 12;

layout! {
    /// The operation of [`SdoRequest`].
    pub enum SdoOperation<'d> by operation: u8 = at(0), "operation", "0 write, 1 read" {
        /// Writes these bytes, at most [`SDO_DATA_MAX`].
        Write = 0 (data: &'d [u8] = tail(SDO_HEAD as u16)
            .counted(at(6), "SDO_REQ data length", Allowed::AtMost(SDO_DATA_MAX as u32))
            .all_valid("SDO_REQ valid data length")),
        /// Reads the object; [`SdoGet`] then returns the data.
        Read = 1 {
            /// The number of bytes to read. The modelled chip returns at most this many bytes of a longer object, and
            /// all bytes for 0.
            bytes: u16 = at(6),
        },
    }

    /// ECAT_SDO_REQ, command code 10: reads or writes an object of a slave (XF EN 579). If it fails, the answer that
    /// ends it has [`Errors::NON_IMMEDIATE`](crate::xf::Errors::NON_IMMEDIATE) set, and [`SdoAbortCodeGet`] reads the
    /// reason.
    ///
    /// Data, 12 bytes and the data to write (@offset): @0 0 write, 1 read, @1 slave, @2 u16 index, @4 sub-index, @5
    /// complete access, @6 u16 bytes, @8 u32 timeout in us, @12 data (the manual prints 0x12). The length field gives
    /// the end of the data.
    pub struct SdoRequest<'d> {
        /// The slave whose object is accessed.
        pub slave: SlaveNumber = at(1),
        /// The object to read or write.
        pub object: ObjectAddress,
        /// One entry of the object, or all of them (complete access).
        // The byte is reserved in the manual, and the flag for complete access in the vendor's driver (OBS).
        pub scope: SdoScope = at(5).named("complete").or(0),
        /// The timeout for the slave, in microseconds.
        pub timeout_us: u32 = at(8).or(1_000_000),
        /// The operation: read or write.
        pub operation: SdoOperation<'d>,
    }

    impl ObjectAddress {
        index: u16 = at(2).hex(),
        sub: u8 = at(4).or(0),
    }
}

field_values! {
    SdoScope, 1, FieldKind::Choice(Switch::NAMES), |scope| (scope == SdoScope::Complete).into(),
        |flag| Ok(if flag == 0 { SdoScope::Entry } else { SdoScope::Complete });
    AbortCode, 4, FieldKind::Abort, |code| code.0, |code| Ok(AbortCode(code));
}
