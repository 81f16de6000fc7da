//! Requests for single EtherCAT datagrams.

use crate::xf::Allowed;
use crate::xf::layout::{FieldDecl, at, layout, tail};
use crate::xf::value::choices;

layout! {
    /// RAW_ECAT_FUNC_GET, command code 138: returns the datagram of [`RawRequest`] as it came back (XF EN 1580).
    pub struct RawGet;
}

choices! {
    /// The EtherCAT command of a datagram.
    pub RawOperation(u8), "RAW_ECAT_FUNC_REQ operation", "1, 2, 4, 5, 7, 8 or 10 to 14" {
        /// 1: APRD, reads a slave by its position.
        Aprd = 1,
        /// 2: APWR, writes a slave by its position.
        Apwr = 2,
        /// 4: FPRD, reads a slave by its station address.
        Fprd = 4,
        /// 5: FPWR, writes a slave by its station address.
        Fpwr = 5,
        /// 7: BRD, reads all slaves; their data are combined by OR.
        Brd = 7,
        /// 8: BWR, writes all slaves.
        Bwr = 8,
        /// 10: LRD, reads logical addresses.
        Lrd = 10,
        /// 11: LWR, writes logical addresses.
        Lwr = 11,
        /// 12: LRW, reads and writes logical addresses.
        Lrw = 12,
        /// 13: ARMW, reads one slave by its position, and writes the value to all other slaves.
        Armw = 13,
        /// 14: FRMW, reads one slave by its station address, and writes the value to all other slaves.
        Frmw = 14,
    }
}

/// The offset of the datagram's data in [`RawRequest`] and in its answer, in bytes.
pub(crate) const RAW_HEAD: usize = 20;

/// The maximum size of a datagram's data, in bytes.
pub const RAW_DATA_MAX: usize = 256;

/// The datagram's data at [`RAW_HEAD`], whose size is the u16 at byte 2. `name` is the name of that size in errors.
pub(in crate::xf) const fn raw_data(name: &'static str) -> FieldDecl {
    tail(RAW_HEAD as u16).counted(at(2), name, Allowed::AtMost(RAW_DATA_MAX as u32))
}

layout! {
    /// RAW_ECAT_FUNC_REQ, command code 137: sends a datagram (XF EN 1560, XF ZH 1474). Data, 20 bytes and the
    /// datagram's data (@offset): @0 operation, @2 u16 bytes, @4 u16 ADP, @6 u16 ADO, @8 u32 logical address, @12 i32
    /// timeout in us, @20 data.
    ///
    /// A datagram that reads needs data too: their length is the number of bytes to read.
    pub struct RawRequest<'d> {
        /// The datagram's EtherCAT command.
        pub operation: RawOperation = at(0),
        /// Auto-increment position or station address of the slave, depending on the datagram's command.
        pub adp: u16 = at(4).hex().or(0),
        /// Register or memory address in the slave.
        pub ado: u16 = at(6).hex().or(0),
        /// Logical address, for LRD, LWR and LRW.
        pub logical: u32 = at(8).hex().or(0),
        /// The timeout for the datagram, in microseconds.
        pub timeout_us: i32 = at(12).or(10_000),
        /// The datagram's data, at most [`RAW_DATA_MAX`] bytes.
        pub data: &'d [u8] = raw_data("RAW_ECAT_FUNC_REQ data length"),
    }
}
