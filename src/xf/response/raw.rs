//! Answers with datagrams and EEPROM data.

use super::{Answer, Returned, answer_fields, answers};
use crate::xf::Malformed;
use crate::xf::fields::{AnswerFields, FieldKind};
use crate::xf::layout::{FieldLayout, FieldReader, Forms, layout};
use crate::xf::request::{RawOperation, raw_data};

layout! {
    /// The answer to [`RawGet`](crate::xf::request::RawGet): the layout of the request, with the working counter as i32
    /// at byte 16 (XF EN 1580).
    ///
    /// Both manuals give the length 4 + n, but their drawings need 20 + n. `[OURS]` The length is 20 + n. A host uses
    /// the number of data bytes at byte 2, whatever the length.
    pub struct RawAnswer<'d> {
        /// The datagram's EtherCAT command; see [`RawOperation::from_code`].
        pub operation: u8 = at(0).kind(FieldKind::Named(RawOperation::NAMES)),
        /// Auto-increment position or station address of the slave.
        pub adp: u16 = at(4).hex(),
        /// Register or memory address in the slave.
        pub ado: u16 = at(6).hex(),
        /// Logical address, for LRD, LWR and LRW.
        pub logical: u32 = at(8).hex(),
        /// The timeout of the request, in microseconds, as the chip repeats it.
        pub timeout_us: i32 = at(12),
        /// The working counter; negative if the datagram did not come back.
        pub working_counter: i32 = at(16),
        /// The datagram's data, at most 256 bytes.
        pub data: &'d [u8] = raw_data("RAW_ECAT_FUNC_GET data length"),
    }

    /// The answer to [`EepromGet`](crate::xf::request::EepromGet): an error code in the return byte, and up to 8 bytes
    /// (OBS) of data (XF EN 1168).
    pub struct EepromAnswer<'d> {
        /// The error code, which the manuals do not explain.
        pub error: u8 = ret(),
        /// The data read from the EEPROM.
        pub data: &'d [u8] = tail(0),
    }
}

answers! {
    EepromAnswer<'d>;
}

impl RawAnswer<'_> {
    /// The datagram's EtherCAT command; `None` for a code that is not in the manuals.
    pub const fn operation(&self) -> Option<RawOperation> {
        RawOperation::from_code(self.operation)
    }
}

impl<'a> Answer<'a> for RawAnswer<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.answered(data)
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Self::decoded(&FieldReader::of(returned, data).arguments, data)
    }
}

impl Forms for RawAnswer<'_> {
    const FORMS: &'static [AnswerFields] = &[answer_fields!(RawAnswer<'d>)];
}
