//! Answers about the chip: its version and series, the limit of working counter errors, registers of PHYs, the size of
//! packets.

use super::{Answer, Returned};
use crate::xf::fields::{AnswerFields, FieldKind};
use crate::xf::layout::{FieldLayout, FieldList, Forms, field_slice, field_values, layout, ret, value};
use crate::xf::request::{WkcErrorLimit, data_size};
use crate::xf::{DataSize, Malformed};

/// The answer to FW_VERSION_GET (XF EN 1285): the version in the return byte; newer firmware adds 20 bytes of data,
/// older firmware has none (XF ZH 1208).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FirmwareVersion {
    /// The firmware version, such as 0x22.
    pub version: u8,
    /// The identity that newer firmware adds.
    pub identity: Option<FirmwareIdentity>,
}

layout! {
    /// The identity of the chip in answers of newer firmware.
    pub struct FirmwareIdentity {
        /// Bytes 0..1 of the data: the extended version.
        // The manual's drawing lacks a column. That these two bytes are the extended version is an interpretation.
        pub extended: u16 = at(0).hex(),
        /// Byte 3 of the data: the type of the chip.
        pub series: Series = at(3),
        /// Bytes 4..19 of the data: identification for the vendor's own use.
        pub identification: [u8; 16] = at(4),
    }
}

/// The type of the chip. The manual names ECM-XF, ECM-XFL, ECM-XFU and ECM-XM without their numbers (XF EN 1285).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Series(pub u8);

field_values! {
    Series, 1, FieldKind::Number, |series| series.0.into(), |number| Ok(Series(number as u8));
}

impl Answer<'_> for FirmwareVersion {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let identity = self.identity.map_or(Ok(Returned::NONE), |identity| identity.answered(data))?;
        Ok(Returned { ret: self.version, ..identity })
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        let identity = match returned.valid(data)?.len() {
            0 => None,
            FirmwareIdentity::END => Some(FirmwareIdentity::of_answer(returned, data)?),
            _ => return Err(Malformed::only("FW_VERSION_GET valid data length", returned.len.into(), "0 or 20")),
        };
        Ok(Self { version: returned.ret, identity })
    }
}

impl Forms for FirmwareVersion {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(field_slice!(
        FieldList::of(ret().hex().of::<u8>("version")).and(<FirmwareIdentity as FieldLayout<'static>>::FIELDS)
    ))];
}

/// The answer to MDIO (XF EN 1455): the value read, u16 at byte 0 of the data; `None` after a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MdioAnswer(pub Option<u16>);

impl Answer<'_> for MdioAnswer {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.0.map_or(Ok(Returned::NONE), |value| value.encode(data))
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        match returned.len {
            0 => Ok(Self(None)),
            _ => u16::decode(returned, data).map(|value| Self(Some(value))),
        }
    }
}

impl Forms for MdioAnswer {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[value("value").hex().returned::<u16>()])];
}

/// The answer to ECAT_WKC_CONTI_ERR_MAX_GET: the limit is the return byte.
impl Answer<'_> for WkcErrorLimit {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(self.code()))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(Self::from_code(returned.ret))
    }
}

impl Forms for WkcErrorLimit {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[ret().of::<WkcErrorLimit>("limit").field])];
}

/// The answer to SPI_PACK_SIZE_GET: n, the size of the data segment, is the u16 at byte 0 of the data.
impl Answer<'_> for DataSize {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.get().encode(data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        data_size("SPI_PACK_SIZE_GET size", u16::decode(returned, data)?)
    }
}

impl Forms for DataSize {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[value("bytes").returned::<u16>()])];
}
