//! Datagrams and EEPROMs.

use super::{Answer, Returned};
use crate::xf::request::{RAW_DATA_MAX, RAW_HEAD, RawLayout, RawOperation};
use crate::xf::{Malformed, segment};

/// The answer to [`RawGet`](crate::xf::request::RawGet): the layout of the request, with the working counter @16 i32
/// (XF EN 1580).
///
/// Both manuals give its length as 4 + n, but what they draw needs 20 + n. `[OURS]` The length is 20 + n; a host goes
/// by @2, the number of data bytes, whatever the length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RawAnswer<'a> {
    /// The datagram's command; see [`RawOperation::from_code`].
    pub operation: u8,
    /// Position or station address of the slave.
    pub adp: u16,
    /// Offset in the slave's memory.
    pub ado: u16,
    /// Logical address.
    pub logical: u32,
    /// The time limit in microseconds.
    pub timeout_us: i32,
    /// The working counter; negative if the datagram did not come back.
    pub working_counter: i32,
    /// The data, 256 bytes at most.
    pub data: &'a [u8],
}

impl RawAnswer<'_> {
    /// The datagram's command; `None` if the manuals have no such code.
    pub const fn operation(&self) -> Option<RawOperation> {
        RawOperation::from_code(self.operation)
    }
}

impl<'a> Answer<'a> for RawAnswer<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let bytes = Malformed::at_most("RAW_ECAT_FUNC_GET data length", self.data.len(), RAW_DATA_MAX)?;
        let layout = RawLayout {
            operation: self.operation,
            reserved: 0,
            bytes: (bytes as u16).into(),
            adp: self.adp.into(),
            ado: self.ado.into(),
            logical: self.logical.into(),
            timeout_us: self.timeout_us.into(),
            working_counter: self.working_counter.into(),
        };
        segment::put(data, &layout)?;
        segment::put_at(data, RAW_HEAD, self.data).map(Returned::data)
    }

    fn decode(_: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        let layout: RawLayout = segment::get(data)?;
        let bytes = Malformed::at_most("RAW_ECAT_FUNC_GET data length", layout.bytes.get().into(), RAW_DATA_MAX)?;
        Ok(Self {
            operation: layout.operation,
            adp: layout.adp.get(),
            ado: layout.ado.get(),
            logical: layout.logical.get(),
            timeout_us: layout.timeout_us.get(),
            working_counter: layout.working_counter.get(),
            data: segment::get_at(data, RAW_HEAD, bytes)?,
        })
    }
}

/// The answer to [`EepromGet`](crate::xf::request::EepromGet): `ret` error code, the data up to 8 bytes (OBS) that were
/// read (XF EN 1168).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EepromAnswer<'a> {
    /// The error code, which the manuals do not explain.
    pub error: u8,
    /// What was read.
    pub data: &'a [u8],
}

impl<'a> Answer<'a> for EepromAnswer<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned { ret: self.error, len: segment::put_at(data, 0, self.data)? })
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Ok(Self { error: returned.ret, data: returned.valid(data)? })
    }
}
