//! Answers with process data and their configuration.

use super::{Answer, Returned, answers};
use crate::xf::Malformed;
use crate::xf::fields::{AnswerFields, Field};
use crate::xf::layout::{Forms, field_slice, layout};
use crate::xf::request::{PdoConfig, PdoConfigForm, PdoOperation};

layout! {
    /// The answer to [`PdoDataFifo`](crate::xf::request::PdoDataFifo) and [`PdoData`](crate::xf::request::PdoData): the
    /// executed operation in the return byte, the TxPDOs in the data (XF EN 436 and 452).
    ///
    /// `[OURS]` If a request reads several PDOs, the chip answers with as many whole TxPDOs as it has, up to that
    /// number.
    pub struct PdoExchange<'d> {
        /// The executed operation: written, read, or failed.
        pub done: PdoOperation = ret(),
        /// The TxPDOs, one after the other.
        pub data: &'d [u8] = tail(0),
    }
}

answers! {
    PdoExchange<'d>;
}

/// The length of the answer decides its form: 112 bytes for 3 PDOs (XF EN 533), 148 bytes for 4 PDOs of newer firmware
/// (OBS).
impl Answer<'_> for PdoConfig {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.write(data).map(Returned::data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        let valid = returned.valid(data)?;
        for form in [PdoConfigForm::Three, PdoConfigForm::Four] {
            if valid.len() == form.bytes() {
                return Self::read(valid, form);
            }
        }
        Err(Malformed::only("PDO_CONFIG_GET valid data length", returned.len.into(), "112 or 148"))
    }
}

impl Forms for PdoConfig {
    const FORMS: &'static [AnswerFields] = {
        const fn form(form: PdoConfigForm, fields: &'static [Field]) -> AnswerFields {
            AnswerFields { len: Some(form.bytes() as u16), every: None, fields }
        }
        const THREE: &[Field] = field_slice!(PdoConfigForm::Three.fields());
        const FOUR: &[Field] = field_slice!(PdoConfigForm::Four.fields());
        &[form(PdoConfigForm::Three, THREE), form(PdoConfigForm::Four, FOUR)]
    };
}
