//! How a device with distributed clocks is synchronized: objects 0x1C32:1 and 0x1C33:1 (ETG.1020 21).
//!
//! \[OURS] As in public stacks of slaves, a device goes by what its controller is set to, SYNC0 or none, until a master writes a
//! type. One that was told SYNC0 refuses OP without it: nothing would drive it. Other types make no difference, since the
//! simulated network has one clock.

use crate::ethercat::AlStatus;
use crate::ethercat::coe::AbortCode;
use crate::ethercat::registers::SyncActivation;

/// Synchronization types: of outputs free run, the event of sync manager 2, SYNC0; of inputs the same, and the event of sync
/// manager 2 as 0x22.
const SM_EVENT: u16 = 1;
const SYNC0: u16 = 2;
const SM2_EVENT: u16 = 0x22;

/// The types that a master has written, and what the network gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SyncTypes {
    /// Those of outputs and of inputs; `None`: a master has written none.
    written: [Option<u16>; 2],
    /// Whether there is a SYNC0; `None`: the network has not said so.
    has_sync0: Option<bool>,
}

impl SyncTypes {
    /// What the object shows. \[OURS] SYNC0 as long as nobody has said whether there is one.
    pub(super) fn shown(&self, n: usize) -> u16 {
        self.written[n].unwrap_or(match (self.has_sync0, n) {
            (Some(false), 0) => SM_EVENT,
            (Some(false), _) => SM2_EVENT,
            (Some(true) | None, _) => SYNC0,
        })
    }

    /// A master writes a type.
    ///
    /// # Errors
    /// [`AbortCode::VALUE_RANGE`] for a type that the device does not have.
    pub(super) fn write(&mut self, n: usize, code: u16) -> Result<(), AbortCode> {
        if code > SYNC0 && (n, code) != (1, SM2_EVENT) {
            return Err(AbortCode::VALUE_RANGE);
        }
        self.written[n] = Some(code);
        Ok(())
    }

    /// What the sync unit of the controller is set to, register 0x0981.
    pub(super) fn note_activation(&mut self, activation: u8) {
        let both = SyncActivation::ACTIVATE.0 | SyncActivation::SYNC0.0;
        self.note_sync0(activation & both == both);
    }

    /// Whether there is a SYNC0.
    pub(super) const fn note_sync0(&mut self, has_sync0: bool) {
        self.has_sync0 = Some(has_sync0);
    }

    /// Whether the device may go to OP.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_DC_SYNC`]: a master has told it to run by SYNC0, and there is none.
    pub(super) fn check(&self) -> Result<(), AlStatus> {
        let lacks_sync0 = self.has_sync0 == Some(false) && self.written.contains(&Some(SYNC0));
        if lacks_sync0 { Err(AlStatus::INVALID_DC_SYNC) } else { Ok(()) }
    }
}
