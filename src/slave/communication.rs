//! The registers of an EtherCAT slave controller that the firmware of a device checks before it changes its state.
//!
//! A network without controllers sets only the lengths of the sync managers for process data, see
//! [`Slave::set_sync_managers`](super::Slave::set_sync_managers). A device then assumes that all other registers are
//! right.

use crate::ethercat::Ns;

/// The settings of one sync manager (ETG.1000.4 6.7.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncManagerSettings {
    /// Start address in the memory of the slave controller.
    pub start: u16,
    /// The length of the area in the memory of the slave controller, bytes.
    pub length: u16,
    /// The control byte: buffer mode, direction, watchdog.
    pub control: u8,
    /// Whether the sync manager is active.
    pub enabled: bool,
}

impl SyncManagerSettings {
    /// Whether the areas of two sync managers overlap. A disabled or empty sync manager overlaps nothing.
    pub fn overlaps(&self, other: &Self) -> bool {
        let span = |settings: &Self| {
            let length = if settings.enabled { settings.length } else { 0 };
            (u32::from(settings.start), u32::from(settings.start) + u32::from(length))
        };
        let ((start, end), (other_start, other_end)) = (span(self), span(other));
        start.max(other_start) < end.min(other_end)
    }
}

/// A synchronization event. The controller reports it to its device if the device runs by SYNC0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncEvent {
    /// A SYNC0 pulse came in time, and the device has run its cycle at this pulse.
    InTime,
    /// Outputs have come between the last two SYNC0 pulses. This is reported at the second of the two.
    Outputs {
        /// The time from the newest outputs to the second pulse, ns.
        ago_ns: Ns,
    },
    /// A SYNC0 cycle began too early or too late. The simulated controller never deviates, so only tests report this
    /// event.
    Deviation,
    /// The first SYNC0 pulse has not come within the time limit after the change to SafeOP or during the change to OP,
    /// see [`Slave::sync_lock_limit_ns`](super::Slave::sync_lock_limit_ns).
    NotLocked,
    /// SYNC0 was switched off while it triggered the cycles of the device.
    LockLost,
}

/// A level change at a latch input of the controller that its device has caused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatchChange {
    /// The latch input, from 0.
    pub input: usize,
    /// Whether the new level is 1.
    pub is_on: bool,
    /// The time from the change to the end of the device's last step, ns.
    pub ago_ns: Ns,
}

/// The registers of a slave controller that concern the device behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Communication {
    /// Sync managers 0 to 3: mailbox out, mailbox in, outputs, inputs.
    pub sync_managers: [SyncManagerSettings; 4],
    /// The watchdog time for outputs, from registers 0x0400 and 0x0420, ns; `None`: the watchdog is off.
    pub watchdog_ns: Option<Ns>,
    /// The activation of the sync unit, register 0x0981: bit 0 activates the unit, bit 1 switches SYNC0 on.
    pub dc_activation: u8,
    /// The cycle of SYNC0, register 0x09A0, ns.
    pub sync0_cycle_ns: u32,
}
