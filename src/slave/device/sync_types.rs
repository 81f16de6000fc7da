//! Synchronization types of a device with distributed clocks: objects 0x1C32:1 and 0x1C33:1 (ETG.1020 21).
//!
//! \[OURS] Like public slave stacks, a device uses the setting of its slave controller, SYNC0 or none, until a master
//! writes a type. If the master has written the type SYNC0, the device refuses OP without SYNC0, because nothing would
//! trigger its cycles. All other types behave alike, because the simulated network has one clock.

use crate::ethercat::AlStatus;
use crate::ethercat::coe::AbortCode;
use crate::ethercat::registers::SyncActivation;

/// Synchronization types. Outputs: 0 free run, 1 sync manager 2 event, 2 SYNC0. Inputs: the same, but 0x22 for the sync
/// manager 2 event.
const SM_EVENT: u16 = 1;
const SYNC0: u16 = 2;
const SM2_EVENT: u16 = 0x22;

/// The types that a master has written, and whether the network has a SYNC0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SyncTypes {
    /// The types that a master has written: `[0]` for outputs (0x1C32:1), `[1]` for inputs (0x1C33:1). `None`: none was
    /// written.
    written: [Option<u16>; 2],
    /// Whether there is a SYNC0; `None` until the network has reported it.
    has_sync0: Option<bool>,
}

impl SyncTypes {
    /// The value of 0x1C32:1 (`n` = 0) or 0x1C33:1 (`n` = 1). \[OURS] It is SYNC0 until the network has reported whether
    /// there is one.
    pub(super) fn shown(&self, n: usize) -> u16 {
        self.written[n].unwrap_or(match (self.has_sync0, n) {
            (Some(false), 0) => SM_EVENT,
            (Some(false), _) => SM2_EVENT,
            (Some(true) | None, _) => SYNC0,
        })
    }

    /// Handles a master's write to 0x1C32:1 (`n` = 0) or 0x1C33:1 (`n` = 1).
    ///
    /// # Errors
    /// [`AbortCode::VALUE_RANGE`] for a type that the device does not support.
    pub(super) fn write(&mut self, n: usize, code: u16) -> Result<(), AbortCode> {
        if code > SYNC0 && (n, code) != (1, SM2_EVENT) {
            return Err(AbortCode::VALUE_RANGE);
        }
        self.written[n] = Some(code);
        Ok(())
    }

    /// Records whether register 0x0981 of the slave controller has activated SYNC0.
    pub(super) fn note_activation(&mut self, activation: u8) {
        let both = SyncActivation::ACTIVATE.0 | SyncActivation::SYNC0.0;
        self.note_sync0(activation & both == both);
    }

    /// Records whether the network has a SYNC0.
    pub(super) const fn note_sync0(&mut self, has_sync0: bool) {
        self.has_sync0 = Some(has_sync0);
    }

    /// Checks whether the device may go to OP.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_DC_SYNC`]: a master has set the type SYNC0, and there is no SYNC0.
    pub(super) fn check(&self) -> Result<(), AlStatus> {
        let lacks_sync0 = self.has_sync0 == Some(false) && self.written.contains(&Some(SYNC0));
        if lacks_sync0 { Err(AlStatus::INVALID_DC_SYNC) } else { Ok(()) }
    }
}
