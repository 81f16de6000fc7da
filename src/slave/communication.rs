//! What the firmware of a device reads from the registers of its EtherCAT slave controller before it changes its state.
//!
//! A network without controllers sets no more than the lengths of the sync managers for process data, see
//! [`Slave::set_sync_managers`](super::Slave::set_sync_managers); a device then takes the rest for right.

use crate::ethercat::Ns;

/// The settings of one sync manager (ETG.1000.4 6.7.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncManagerSettings {
    /// Start address in the memory of the controller.
    pub start: u16,
    /// Length, bytes.
    pub length: u16,
    /// The control byte: buffer mode, direction, watchdog.
    pub control: u8,
    /// Whether the sync manager is active.
    pub enabled: bool,
}

impl SyncManagerSettings {
    /// Whether the buffers of two sync managers have a byte in common. One that is off, or has no length, has none.
    pub fn overlaps(&self, other: &Self) -> bool {
        let span = |settings: &Self| {
            let length = if settings.enabled { settings.length } else { 0 };
            (u32::from(settings.start), u32::from(settings.start) + u32::from(length))
        };
        let ((start, end), (other_start, other_end)) = (span(self), span(other));
        start.max(other_start) < end.min(other_end)
    }
}

/// What a controller tells its device of the synchronization, while it runs by SYNC0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncEvent {
    /// A cycle began in time: the device has just done its work of it.
    InTime,
    /// Outputs came since the last cycle, the newest ones so long before this one, ns.
    Outputs {
        /// How long before, ns.
        ago_ns: Ns,
    },
    /// A cycle began too early or too late.
    Deviation,
    /// The clock of the device was not synchronized within the time that it has for that.
    NotLocked,
    /// The clock of the device is not synchronized any more.
    LockLost,
}

/// A change at a latch input of a controller that its device has caused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatchChange {
    /// The input, from 0.
    pub input: usize,
    /// Whether it went on.
    pub is_on: bool,
    /// How long before the end of the device's last step, ns.
    pub ago_ns: Ns,
}

/// The registers of a controller that concern the device behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Communication {
    /// Sync managers 0 to 3: mailbox out, mailbox in, outputs, inputs.
    pub sync_managers: [SyncManagerSettings; 4],
    /// The time of the watchdog of outputs, from registers 0x0400 and 0x0420; `None`: it is off.
    pub watchdog_ns: Option<Ns>,
    /// Activation of the sync unit, register 0x0981.
    pub dc_activation: u8,
    /// The cycle of SYNC0, register 0x09A0, ns.
    pub sync0_cycle_ns: u32,
}
