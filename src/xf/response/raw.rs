//! Datagrams and EEPROMs.

use super::{Answer, Returned, answer_fields, answers};
use crate::xf::Malformed;
use crate::xf::fields::{AnswerFields, Kind};
use crate::xf::layout::{Forms, Layout, Reader, layout};
use crate::xf::request::{RawOperation, raw_data};

layout! {
    /// The answer to [`RawGet`](crate::xf::request::RawGet): the layout of the request, with the working counter @16 i32
    /// (XF EN 1580).
    ///
    /// Both manuals give its length as 4 + n, but what they draw needs 20 + n. `[OURS]` The length is 20 + n; a host goes
    /// by @2, the number of data bytes, whatever the length.
    pub struct RawAnswer<'d> {
        /// The datagram's command; see [`RawOperation::from_code`].
        pub operation: u8 = at(0).kind(Kind::Named(RawOperation::NAMES)),
        /// Position or station address of the slave.
        pub adp: u16 = at(4).hex(),
        /// Offset in the slave's memory.
        pub ado: u16 = at(6).hex(),
        /// Logical address.
        pub logical: u32 = at(8).hex(),
        /// The time limit in microseconds.
        pub timeout_us: i32 = at(12),
        /// The working counter; negative if the datagram did not come back.
        pub working_counter: i32 = at(16),
        /// The data, 256 bytes at most.
        pub data: &'d [u8] = raw_data("RAW_ECAT_FUNC_GET data length"),
    }

    /// The answer to [`EepromGet`](crate::xf::request::EepromGet): `ret` error code, the data up to 8 bytes (OBS) that were
    /// read (XF EN 1168).
    pub struct EepromAnswer<'d> {
        /// The error code, which the manuals do not explain.
        pub error: u8 = ret(),
        /// What was read.
        pub data: &'d [u8] = tail(0),
    }
}

answers! {
    EepromAnswer<'d>;
}

impl RawAnswer<'_> {
    /// The datagram's command; `None` if the manuals have no such code.
    pub const fn operation(&self) -> Option<RawOperation> {
        RawOperation::from_code(self.operation)
    }
}

impl<'a> Answer<'a> for RawAnswer<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.answered(data)
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Self::decoded(&Reader::of(returned, data).arguments, data)
    }
}

impl Forms for RawAnswer<'_> {
    const FORMS: &'static [AnswerFields] = &[answer_fields!(RawAnswer<'d>)];
}
