//! Requests for the EEPROMs of slaves (SII).

use super::SlaveNumber;
use crate::xf::layout::layout;

layout! {
    /// EEPROM_GET, command code 39: returns the data that [`EepromRequest`] has read, up to 8 bytes, and an error code
    /// in the return byte (XF EN 1168).
    pub struct EepromGet;

    /// The operation of [`EepromRequest`].
    // These codes are the reverse of those in SDO_REQ (XF ZH 1096).
    pub enum EepromOperation by operation: u16 = at(0), "EEPROM_REQ operation", "0 read, 1 write" {
        /// Reads the EEPROM from the address `position` on; [`EepromGet`] then returns the data.
        Read = 0,
        /// Writes `value`, a word of 16 bits, to the address `position`.
        Write = 1 (value: u16 = at(6).hex().or(0)),
    }

    /// EEPROM_REQ, command code 38: reads or writes a slave's EEPROM (XF EN 1144, XF ZH 1096). Data, 12 bytes
    /// (@offset): @0 u16 operation, @2 u16 slave, @4 u16 position, @6 u16 word to write, @8 u32 timeout in us.
    pub struct EepromRequest {
        /// The slave whose EEPROM is accessed.
        pub slave: SlaveNumber = at(2).bytes(2),
        /// The address in the EEPROM, in words of 16 bits, of the first word to read or of the word to write.
        pub position: u16 = at(4).hex(),
        /// The timeout for the slave, in microseconds.
        pub timeout_us: u32 = at(8).or(1_000_000),
        /// The operation: read or write.
        pub operation: EepromOperation,
    }
}
