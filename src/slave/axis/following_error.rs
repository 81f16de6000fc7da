//! Monitoring of the following error (CiA 402-2): the drive has a fault with error code 0x8611 when the following error is
//! outside its window for longer than the timeout.

use super::{Axis, Settings};
use crate::ethercat::Ns;
use crate::slave::state_machine::DeviceFault;

/// Error code of a following error (CiA 402-2, 0x603F).
pub const FOLLOWING_ERROR: u16 = 0x8611;
/// Value of 0x6065 that switches the monitoring off (CiA 402-2).
pub const NO_FOLLOWING_WINDOW: u32 = u32::MAX;

/// The values of 0x6065 and 0x6066, stored next to the fields that a cycle in CSP uses.
#[derive(Clone, Copy, Debug)]
pub(super) struct FollowingErrorWindow {
    counts: u32,
    timeout_ms: u16,
}

impl FollowingErrorWindow {
    pub(super) const fn of(settings: &Settings) -> Self {
        Self { counts: settings.following_window, timeout_ms: settings.following_timeout_ms }
    }
}

impl Axis {
    /// Checks the following error after `ns`. An error outside the window for longer than the timeout raises the fault;
    /// with 0x6066 = 0 immediately.
    pub(super) fn monitor_following_error(&mut self, ns: Ns) {
        let FollowingErrorWindow { counts, timeout_ms } = self.following;
        let outside = self.following_error().unsigned_abs() > counts.into();
        if !outside || counts == NO_FOLLOWING_WINDOW {
            self.outside_ns = 0;
            return;
        }
        self.outside_ns += ns;
        if self.outside_ns > Ns::from(timeout_ms) * 1_000_000 {
            self.machine.raise(DeviceFault { code: FOLLOWING_ERROR, resettable: true });
        }
    }
}
