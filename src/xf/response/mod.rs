//! Answers of the chip: the result of each request, decoded from the return byte, the length and the data segment.
//!
//! [`Call::Answer`](super::Call::Answer) names the type of a request's answer. Some are plain types: `()` is no result,
//! `u8` the return byte, `u16` and `u32` a number at byte 0 of the data, a slice the valid bytes of the data segment.
//! The files correspond to those of the requests:
//!
//! | file | answers |
//! | --- | --- |
//! | `plain` | numbers, bytes and words that other parts of the crate have types for |
//! | `network` | items about slaves |
//! | `pdo` | process data and their configuration |
//! | `chip` | version, limit of working counter errors, PHY, size of packets |
//! | `helper` | states of axes; interrupts |
//! | `raw` | datagrams and EEPROMs |
//! | `mailbox` | emergencies, sets of slaves |

mod chip;
mod helper;
mod mailbox;
mod network;
mod pdo;
mod plain;
mod raw;

pub use chip::{FirmwareIdentity, FirmwareVersion, MdioAnswer, Series};
pub use helper::DriveStateByte;
pub use mailbox::{Emergencies, Emergency};
pub use network::SlaveInfo;
pub use pdo::PdoExchange;
pub use raw::{EepromAnswer, RawAnswer};

use core::fmt;

use super::{Malformed, segment};

/// The fields of an answer's header that belong to the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Returned {
    /// The return byte `ret`, byte 0x0D.
    pub ret: u8,
    /// Word 0x0E: the number of valid bytes in the data segment.
    pub len: u16,
}

impl Returned {
    /// The header fields of an answer without a result: return byte and length are 0.
    pub const NONE: Self = Self { ret: 0, len: 0 };

    /// A result in the return byte alone.
    pub(super) const fn value(ret: u8) -> Self {
        Self { ret, len: 0 }
    }

    /// A result in the data segment alone.
    pub(super) const fn data(len: u16) -> Self {
        Self { ret: 0, len }
    }

    /// The valid bytes of the data segment.
    ///
    /// # Errors
    /// The length field exceeds the segment.
    pub(super) fn valid(self, data: &[u8]) -> Result<&[u8], Malformed> {
        let len = Malformed::at_most("valid data length", self.len.into(), data.len())?;
        Ok(&data[..len])
    }

    /// The first `n` bytes of the data segment, which have to be valid.
    ///
    /// # Errors
    /// The length field is less than `n`, or exceeds the segment.
    pub(super) fn first(self, data: &[u8], n: usize) -> Result<&[u8], Malformed> {
        let valid = self.valid(data)?;
        Malformed::at_least("valid data length", valid.len(), n)?;
        segment::get_at(valid, 0, n)
    }
}

/// The result of a request. `'a` is the lifetime of its data, if it has any.
pub trait Answer<'a>: Copy + fmt::Debug + PartialEq {
    /// Writes the data into a segment that is all 0, and returns the fields of the header.
    ///
    /// # Errors
    /// The data do not fit into the segment.
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed>;

    /// Decodes the result from the fields of the header and the whole data segment.
    ///
    /// # Errors
    /// A field has a value that the manuals do not allow.
    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed>;
}

/// Expands to the `AnswerFields` of a type whose layout describes an answer.
macro_rules! answer_fields {
    ($($type:tt)*) => {
        $crate::xf::fields::AnswerFields::of($crate::xf::layout::field_slice!(
            <$crate::xf::layout::type_of!($($type)*) as $crate::xf::layout::FieldLayout<'static>>::FIELDS.returned()
        ))
    };
}

/// Implements [`Answer`] for types whose layout describes the whole answer.
macro_rules! answers {
    ($($(#[$doc:meta])* $name:ident $(<$life:lifetime>)?;)*) => {$(const _: () = {
        use $crate::xf::layout::{Forms, FieldLayout, type_of};
        use $crate::xf::response::{Answer, Returned, answer_fields};
        use $crate::xf::{Malformed, fields::AnswerFields};

        $(#[$doc])*
        impl<'d> Answer<'d> for $name $(<$life>)? {
            fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
                self.answered(data)
            }

            fn decode(returned: Returned, data: &'d [u8]) -> Result<Self, Malformed> {
                Self::of_answer(returned, data)
            }
        }

        impl Forms for type_of!($name $(<$life>)?) {
            const FORMS: &'static [AnswerFields] = &[answer_fields!($name $(<$life>)?)];
        }
    };)*};
}

use {answer_fields, answers};
