//! Answers about axes of the CiA 402 helper, and about enabled interrupts.

use super::answers;
use crate::ethercat::cia402::{DriveState, Statusword};
use crate::xf::fields::FieldKind;
use crate::xf::layout::field_values;
use crate::xf::request::InterruptEnable;

/// The answer to [`HelperStateGet`](crate::xf::request::HelperStateGet): state bits of the statusword, in the return
/// byte (XF EN 778).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DriveStateByte(pub u8);

impl DriveStateByte {
    /// The state; `None` for values that encode no state.
    ///
    /// `[OURS]` The manuals mask the statusword with 0x6F. Here bit 5 is ignored for Not ready, Switch on disabled,
    /// Fault reaction active and Fault, as in CiA 402.
    pub const fn state(self) -> Option<DriveState> {
        Statusword(self.0 as u16).state()
    }
}

impl From<DriveState> for DriveStateByte {
    fn from(state: DriveState) -> Self {
        Self(state.status_bits())
    }
}

field_values! {
    DriveStateByte, 1, FieldKind::DriveState, |state| state.0.into(), |code| Ok(DriveStateByte(code as u8));
}

answers! {
    /// The answer to ECAT_INT_GET_ENABLE: the polarity in the return byte, and 6 bytes of data as in
    /// ECAT_INT_SET_ENABLE (XF EN 1327).
    InterruptEnable;
}
