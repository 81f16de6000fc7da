//! EtherCAT datagrams as they are.

use crate::xf::Allowed;
use crate::xf::layout::{Spot, at, layout, tail};
use crate::xf::value::choices;

layout! {
    /// RAW_ECAT_FUNC_GET, code 138: what came back of [`RawRequest`]'s datagram (XF EN 1580).
    pub struct RawGet;
}

choices! {
    /// The command of a datagram.
    pub RawOperation(u8), "RAW_ECAT_FUNC_REQ operation", "1, 2, 4, 5, 7, 8 or 10 to 14" {
        /// 1: APRD.
        Aprd = 1,
        /// 2: APWR.
        Apwr = 2,
        /// 4: FPRD.
        Fprd = 4,
        /// 5: FPWR.
        Fpwr = 5,
        /// 7: BRD.
        Brd = 7,
        /// 8: BWR.
        Bwr = 8,
        /// 10: LRD.
        Lrd = 10,
        /// 11: LWR.
        Lwr = 11,
        /// 12: LRW.
        Lrw = 12,
        /// 13: ARMW.
        Armw = 13,
        /// 14: FRMW.
        Frmw = 14,
    }
}

/// Where the data of [`RawRequest`] and of its answer begin.
pub(crate) const RAW_HEAD: usize = 20;

/// The most data of a datagram.
pub const RAW_DATA_MAX: usize = 256;

/// The data at [`RAW_HEAD`], counted @2. `name` is what an error calls the count.
pub(in crate::xf) const fn raw_data(name: &'static str) -> Spot {
    tail(RAW_HEAD as u16).counted(at(2), name, Allowed::AtMost(RAW_DATA_MAX as u32))
}

layout! {
    /// RAW_ECAT_FUNC_REQ, code 137: sends a datagram (XF EN 1560, XF ZH 1474). 20 bytes and the data: @0 operation, @2 u16
    /// bytes, @4 u16 ADP, @6 u16 ADO, @8 u32 logical address, @12 i32 time limit in us, @20 data.
    ///
    /// A datagram that reads has data too, as many bytes as shall be read.
    pub struct RawRequest<'d> {
        /// The datagram's command.
        pub operation: RawOperation = at(0),
        /// Position or station address of the slave.
        pub adp: u16 = at(4).hex().or(0),
        /// Offset in the slave's memory.
        pub ado: u16 = at(6).hex().or(0),
        /// Logical address, with LRD, LWR and LRW.
        pub logical: u32 = at(8).hex().or(0),
        /// How long the chip waits for the datagram, in microseconds.
        pub timeout_us: i32 = at(12).or(10_000),
        /// The data, [`RAW_DATA_MAX`] bytes at most.
        pub data: &'d [u8] = raw_data("RAW_ECAT_FUNC_REQ data length"),
    }
}
