//! Process data and their configuration.

use super::{Answer, Returned};
use crate::xf::request::{PdoConfig, PdoConfigForm, PdoOperation};
use crate::xf::{Malformed, segment};

/// The answer to [`PdoDataFifo`](crate::xf::request::PdoDataFifo) and [`PdoData`](crate::xf::request::PdoData): `ret`
/// what was done, the data TxPDOs (XF EN 436 and 452).
///
/// `[OURS]` To a read of several PDOs the chip answers with as many whole TxPDOs as it has, but not more than that.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PdoExchange<'a> {
    /// What was done: written, read; or that it failed.
    pub done: PdoOperation,
    /// The TxPDOs one after the other.
    pub data: &'a [u8],
}

impl<'a> Answer<'a> for PdoExchange<'a> {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned { ret: self.done.0, len: segment::put_at(data, 0, self.data)? })
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        Ok(Self { done: PdoOperation(returned.ret), data: returned.valid(data)? })
    }
}

/// 112 bytes for 3 PDOs (XF EN 533), 148 bytes for 4 of newer firmware (OBS): the length says which.
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
