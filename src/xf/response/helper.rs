//! States of axes of the CiA 402 helper, and enabled interrupts.

use super::{Answer, Returned};
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::xf::Malformed;
use crate::xf::request::InterruptEnable;

/// The answer to [`HelperStateGet`](crate::xf::request::HelperStateGet): `ret` bits of the statusword (XF EN 778).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DriveStateByte(pub u8);

impl DriveStateByte {
    /// The state; `None` for values that stand for none.
    ///
    /// `[OURS]` The manuals mask the statusword with 0x6F. Here bit 5 is ignored for Not ready, Switch on disabled,
    /// Fault reaction active and Fault, as CiA 402 has it.
    pub const fn state(self) -> Option<DriveState> {
        Statusword(self.0 as u16).state()
    }
}

impl From<DriveState> for DriveStateByte {
    fn from(state: DriveState) -> Self {
        Self(state.status_bits())
    }
}

impl Answer<'_> for DriveStateByte {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(self.0))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(Self(returned.ret))
    }
}

/// `ret` polarity; 6 bytes as in the command (XF EN 1327).
impl Answer<'_> for InterruptEnable {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned { ret: self.polarity.0, len: self.write(data)? })
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        Self::read(returned.ret, returned.valid(data)?)
    }
}
