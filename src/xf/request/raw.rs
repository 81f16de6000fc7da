//! EtherCAT datagrams as they are.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, plain};
use crate::ethercat::{I32Le, U16Le, U32Le};
use crate::xf::response::RawAnswer;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// RAW_ECAT_FUNC_GET, code 138: what came back of [`RawRequest`]'s datagram (XF EN 1580).
    RawGet, RawGet -> RawAnswer<'a>;
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

/// What the heads of [`RawRequest`] and of its answer look like; the data follow.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::xf) struct RawLayout {
    /// @0.
    pub operation: u8,
    /// @1.
    pub reserved: u8,
    /// @2.
    pub bytes: U16Le,
    /// @4.
    pub adp: U16Le,
    /// @6.
    pub ado: U16Le,
    /// @8.
    pub logical: U32Le,
    /// @12.
    pub timeout_us: I32Le,
    /// @16: in the answer.
    pub working_counter: I32Le,
}

pub(crate) const RAW_HEAD: usize = size_of::<RawLayout>();
const _: () = assert!(RAW_HEAD == 20 && align_of::<RawLayout>() == 1);

/// The most data of a datagram.
pub const RAW_DATA_MAX: usize = 256;

/// RAW_ECAT_FUNC_REQ, code 137: sends a datagram (XF EN 1560, XF ZH 1474). 20 bytes and the data: @0 operation, @2 u16
/// bytes, @4 u16 ADP, @6 u16 ADO, @8 u32 logical address, @12 i32 time limit in us, @20 data.
///
/// A datagram that reads has data too, as many bytes as shall be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RawRequest<'d> {
    /// The datagram's command.
    pub operation: RawOperation,
    /// Position or station address of the slave.
    pub adp: u16,
    /// Offset in the slave's memory.
    pub ado: u16,
    /// Logical address, with LRD, LWR and LRW.
    pub logical: u32,
    /// How long the chip waits for the datagram, in microseconds.
    pub timeout_us: i32,
    /// The data, [`RAW_DATA_MAX`] bytes at most.
    pub data: &'d [u8],
}

impl<'d> Call<'d> for RawRequest<'d> {
    const CODE: CommandCode = CommandCode::RawRequest;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let bytes = Malformed::at_most("RAW_ECAT_FUNC_REQ data length", self.data.len(), RAW_DATA_MAX)?;
        let layout = RawLayout {
            operation: self.operation.code(),
            reserved: 0,
            bytes: (bytes as u16).into(),
            adp: self.adp.into(),
            ado: self.ado.into(),
            logical: self.logical.into(),
            timeout_us: self.timeout_us.into(),
            working_counter: 0.into(),
        };
        segment::put(data, &layout)?;
        Ok(Arguments::NONE.len(segment::put_at(data, RAW_HEAD, self.data)?))
    }

    fn decode(_: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
        let layout: RawLayout = segment::get(data)?;
        let bytes = Malformed::at_most("RAW_ECAT_FUNC_REQ data length", layout.bytes.get().into(), RAW_DATA_MAX)?;
        Ok(Self {
            operation: RawOperation::decode(layout.operation)?,
            adp: layout.adp.get(),
            ado: layout.ado.get(),
            logical: layout.logical.get(),
            timeout_us: layout.timeout_us.get(),
            data: segment::get_at(data, RAW_HEAD, bytes)?,
        })
    }
}
