//! The properties of a simulated slave controller: its registers at power-on, its EEPROM and the frequency error of its clock.

use crate::ethercat::Ns;
use crate::ethercat::registers::Features;

/// The minimum mailbox length with which most devices go to PreOP, bytes (public slave stacks): the default of
/// [`EscSettings::mailbox_bytes_min`].
pub const MAILBOX_BYTES_MIN: u16 = 34;

/// The properties of a slave controller and its device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EscSettings {
    /// Type of the slave controller, register 0x0000.
    pub controller_type: u8,
    /// Revision of the slave controller, register 0x0001.
    pub revision: u8,
    /// Build number of the slave controller, register 0x0002.
    pub build: u16,
    /// The number of FMMUs, 0..=16.
    pub fmmus: u8,
    /// The number of sync managers, 0..=16.
    pub sync_managers: u8,
    /// The size of the process data RAM, KiB, 1..=60.
    pub ram_kib: u8,
    /// The features, register 0x0008. Without [`Features::CLOCK`] the controller has no registers of distributed clocks.
    pub features: Features,
    /// Word 0 of the EEPROM, loaded into registers 0x0140 and 0x0141.
    pub pdi_control: u16,
    /// Word 1 of the EEPROM, loaded into registers 0x0150 and 0x0151.
    pub pdi_configuration: u16,
    /// The minimum mailbox length with which the device goes to PreOP, bytes.
    pub mailbox_bytes_min: u16,
    /// The type of each port, register 0x0007: 0 and 1 none, 2 EBUS, 3 MII.
    pub ports: [u8; 4],
    /// The fixed value of the watchdog divider, register 0x0400, which the master cannot write. `None`: the master can
    /// write the register.
    pub fixed_watchdog_divider: Option<u16>,
    /// Whether a read of the EEPROM returns 8 bytes instead of 4.
    pub reads_8_bytes: bool,
    /// The duration of an EEPROM command, ns.
    pub eeprom_ns: Ns,
    /// The duration of the internal write cycle after a write command, ns. During this time, every EEPROM command
    /// fails.
    pub eeprom_silence_ns: Ns,
    /// The local time (the free-running clock, without the offset of the system time) at power-on, ns.
    pub local_time_ns: u64,
    /// The frequency error of the crystal, parts per billion; positive if it is too fast.
    pub drift_ppb: i32,
    /// The device identification, which a master requests by AL control; 0: none, and such a request is ignored.
    pub device_id: u16,
    /// The duration of a change of the AL state, ns: how long the device takes to read AL control. Until then the
    /// controller refuses further writes to AL control, except with device emulation.
    pub state_change_ns: Ns,
    /// Whether the device reports its errors by emergencies. Some masters mistake an emergency for an SDO response.
    pub emergencies: bool,
}

impl Default for EscSettings {
    /// \[OURS] A controller with two ports, 8 FMMUs, 8 sync managers, 8 KiB of RAM and 64-bit clocks. EEPROM commands and
    /// changes of state take no time, and the clock does not drift.
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
            // 0x05: SPI is the process data interface; 0x0C00: the SYNC unit and the latch unit of the distributed clocks are
            // enabled.
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
