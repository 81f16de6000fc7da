//! Answers that are a number, bytes, or a type of another part of the crate.

use super::{Answer, DriveStateByte, Returned};
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::AbortCode;
use crate::xf::fields::{AnswerFields, FieldKind, FieldPosition};
use crate::xf::layout::{
    FieldContent, FieldReader, FieldValue, FieldWriter, Forms, ValueAnswer, field_values, ret, tail, value,
};
use crate::xf::request::{Analog, HelperControl};
use crate::xf::value::{EtherCatState, Switch};
use crate::xf::{Malformed, NetworkState, segment};

/// No result: the length is 0, and the return byte has no meaning.
impl Answer<'_> for () {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::NONE)
    }

    fn decode(_: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(())
    }
}

field_values! {
    NetworkState, 1, FieldKind::Named(EtherCatState::NAMES), |state| state.0.into(), |bits| Ok(NetworkState(bits as u8));
    Statusword, 2, FieldKind::Hex, |word| word.0.into(), |word| Ok(Statusword(word as u16));
}

/// Implements [`Answer`] for types that are a single value.
macro_rules! value_answers {
    ($($(#[$doc:meta])* $type:ty = $place:expr;)*) => {$(
        impl ValueAnswer for $type {
            const AT: FieldPosition = $place;
        }

        $(#[$doc])*
        impl Answer<'_> for $type {
            fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
                let mut to = FieldWriter::new(data);
                value("").returned::<Self>().put(self.number(), &mut to)?;
                Ok(to.returned())
            }

            fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
                let data = match Self::AT {
                    FieldPosition::Data(_) => returned.first(data, <Self as FieldContent<'_>>::BYTES.into())?,
                    _ => data,
                };
                Self::of(value("").returned::<Self>().take(&FieldReader::of(returned, data))?)
            }
        }
    )*};
}

value_answers! {
    /// The return byte as a number.
    u8 = FieldPosition::Return;
    /// The return byte as the state of the network or of a slave.
    NetworkState = FieldPosition::Return;
    /// The return byte as the helper's control byte.
    HelperControl = FieldPosition::Return;
    /// The return byte as the state of an axis.
    DriveStateByte = FieldPosition::Return;
    /// A u16 at byte 0 of the data.
    u16 = FieldPosition::Data(0);
    /// A u32 at byte 0 of the data.
    u32 = FieldPosition::Data(0);
    /// A statusword, u16 at byte 0 of the data.
    Statusword = FieldPosition::Data(0);
    /// The abort code of an SDO transfer, u32 at byte 0 of the data; 0 if the transfer did not fail.
    AbortCode = FieldPosition::Data(0);
    /// An analog value, 0..=4095, u32 at byte 0 of the data.
    Analog = FieldPosition::Data(0);
}

/// The fields of the return byte: the state in bits 0 to 3, and the error bit in bit 4.
impl Forms for NetworkState {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[
        ret().part(0, 4).of::<NetworkState>("state").field,
        ret().part(4, 1).one_of(Switch::NAMES).of::<u8>("error").field,
    ])];
}

const _: () = assert!(NetworkState::ERROR == 1 << 4);

/// A slice as an answer: the valid bytes of the data segment.
impl<'a> Answer<'a> for &'a [u8] {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        segment::put_at(data, 0, self).map(Returned::data)
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        returned.valid(data)
    }
}

impl Forms for &[u8] {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[tail(0).of::<&[u8]>("data").field])];
}
