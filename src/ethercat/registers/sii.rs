//! The EEPROM (SII) interface of a slave controller: its control/status word.

use crate::ethercat::bits;

/// The command that a master gives to the EEPROM interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiiCommand {
    /// 0: no command; clears the error bits.
    None,
    /// 1: read 4 or 8 bytes.
    Read,
    /// 2: write one word.
    Write,
    /// 4: load the configuration words at the beginning of the EEPROM into the registers of the controller again.
    Reload,
    /// Any other value, 0..=7.
    Unknown(u8),
}

bits! {
    /// EEPROM control/status, 0x0502: the command in bits 8 to 10, and flags.
    SiiControl(u16) {
        /// Bit 0: enables the write command that the same write to this register gives.
        WRITE_ENABLE = 1 << 0;
        /// Bit 5: the slave's processor emulates the EEPROM.
        EMULATION = 1 << 5;
        /// Bit 6: a read returns 8 bytes instead of 4.
        READS_8_BYTES = 1 << 6;
        /// Bit 7: the EEPROM has more than 16 kbit and takes two address bytes.
        TWO_ADDRESS_BYTES = 1 << 7;
        /// Bit 11: the checksum of the configuration words is wrong.
        CHECKSUM_ERROR = 1 << 11;
        /// Bit 12: the configuration words are not loaded.
        NOT_LOADED = 1 << 12;
        /// Bit 13: the EEPROM did not acknowledge, or the command is invalid.
        COMMAND_ERROR = 1 << 13;
        /// Bit 14: a write command came without [`Self::WRITE_ENABLE`].
        WRITE_ENABLE_ERROR = 1 << 14;
        /// Bit 15: a command is in progress.
        BUSY = 1 << 15;
    }
}

impl SiiControl {
    const COMMAND: u16 = 0b111 << 8;

    /// The command, bits 8 to 10.
    pub const fn command(self) -> SiiCommand {
        match self.0 >> 8 & 0b111 {
            0 => SiiCommand::None,
            1 => SiiCommand::Read,
            2 => SiiCommand::Write,
            4 => SiiCommand::Reload,
            code => SiiCommand::Unknown(code as u8),
        }
    }

    /// This word with another command.
    #[must_use]
    pub const fn with_command(self, command: SiiCommand) -> Self {
        let code = match command {
            SiiCommand::None => 0,
            SiiCommand::Read => 1,
            SiiCommand::Write => 2,
            SiiCommand::Reload => 4,
            SiiCommand::Unknown(code) => code & 0b111,
        };
        Self(self.0 & !Self::COMMAND | (code as u16) << 8)
    }
}
