//! What kind of controller a slave has, and what its crystal is like.

use crate::ethercat::Ns;
use crate::ethercat::registers::Features;

/// The shortest mailbox of most devices (public stacks of slaves), see [`EscSettings`].
pub const MAILBOX_BYTES_MIN: u16 = 34;

/// The settings of a controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EscSettings {
    /// Type, register 0x0000.
    pub controller_type: u8,
    /// Revision, register 0x0001.
    pub revision: u8,
    /// Build, register 0x0002.
    pub build: u16,
    /// How many FMMUs there are, 0..=16.
    pub fmmus: u8,
    /// How many sync managers there are, 0..=16.
    pub sync_managers: u8,
    /// The process data RAM, KiB, 1..=60.
    pub ram_kib: u8,
    /// What the controller can do, register 0x0008. Without [`Features::CLOCK`] it has no registers of distributed clocks.
    pub features: Features,
    /// Word 0 of the EEPROM of a device, loaded into registers 0x0140 and 0x0141.
    pub pdi_control: u16,
    /// Word 1 of the EEPROM of a device, loaded into registers 0x0150 and 0x0151.
    pub pdi_configuration: u16,
    /// The shortest mailbox with which a device goes to PreOP, bytes.
    pub mailbox_bytes_min: u16,
    /// What each port is, register 0x0007: 0 and 1 none, 2 EBUS, 3 MII.
    pub ports: [u8; 4],
    /// What register 0x0400 has if a master cannot write it, as in controllers that were built without that; `None`: a master can.
    pub fixed_watchdog_divider: Option<u16>,
    /// A read of the EEPROM gives 8 bytes, not 4.
    pub reads_8_bytes: bool,
    /// How long a command for the EEPROM takes.
    pub eeprom_ns: Ns,
    /// How long the EEPROM acknowledges nothing after a word was written.
    pub eeprom_silence_ns: Ns,
    /// The local time at power-on, ns.
    pub local_time_ns: u64,
    /// By how much the crystal is too fast, parts per billion; negative: too slow.
    pub drift_ppb: i32,
    /// The device's identification, which a master asks for by AL control; 0: it has none, and does not answer that.
    pub device_id: u16,
    /// How long a change of the AL state takes.
    pub state_change_ns: Ns,
    /// Whether errors of the device are told by emergencies. Some masters take one for the answer to an SDO.
    pub emergencies: bool,
}

impl Default for EscSettings {
    /// \[OURS] A controller with two ports, 8 FMMUs, 8 sync managers, 8 KiB and clocks of 64 bits, which is fast and exact.
    fn default() -> Self {
        Self {
            controller_type: 0x11,
            revision: 0,
            build: 0,
            fmmus: 8,
            sync_managers: 8,
            ram_kib: 8,
            features: Features::CLOCK
                | Features::CLOCK_64_BITS
                | Features::ENHANCED_LINK_MII
                | Features::SEPARATE_CHECK_ERRORS
                | Features::ENHANCED_SYNC,
            // Behind SPI, with SYNC and latch units.
            pdi_control: 0x0C05,
            pdi_configuration: 0,
            mailbox_bytes_min: MAILBOX_BYTES_MIN,
            ports: [3, 3, 0, 0],
            fixed_watchdog_divider: None,
            reads_8_bytes: true,
            eeprom_ns: 0,
            eeprom_silence_ns: 0,
            local_time_ns: 0,
            drift_ppb: 0,
            device_id: 0,
            state_change_ns: 0,
            emergencies: true,
        }
    }
}
