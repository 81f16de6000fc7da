//! The EEPROMs of slaves (SII).

use super::SlaveNumber;
use crate::xf::layout::layout;

layout! {
    /// EEPROM_GET, code 39: what [`EepromRequest`] has read, up to 8 bytes, and an error code in `ret` (XF EN 1168).
    pub struct EepromGet;

    /// What [`EepromRequest`] does.
    // It is the reverse of SDO_REQ (XF ZH 1096).
    pub enum EepromOperation by operation: u16 = at(0), "EEPROM_REQ operation", "0 read, 1 write" {
        /// Reads from the position on; [`EepromGet`] gives the data.
        Read = 0,
        /// Writes this word.
        Write = 1 (value: u16 = at(6).hex().or(0)),
    }

    /// EEPROM_REQ, code 38: reads or writes a slave's EEPROM (XF EN 1144, XF ZH 1096). 12 bytes: @0 u16 operation, @2 u16
    /// slave, @4 u16 position, @6 u16 word to write, @8 u32 time limit in us.
    pub struct EepromRequest {
        /// Which slave.
        pub slave: SlaveNumber = at(2).bytes(2),
        /// The position in the EEPROM.
        pub position: u16 = at(4).hex(),
        /// How long the chip waits for the slave, in microseconds.
        pub timeout_us: u32 = at(8).or(1_000_000),
        /// Read or write.
        pub operation: EepromOperation,
    }
}
