//! The interface to the EEPROM (SII): its control and status word.

use crate::ethercat::bits;

/// What a master asks of the EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiiCommand {
    /// 0: nothing; errors are cleared.
    None,
    /// 1: 4 or 8 bytes are read.
    Read,
    /// 2: one word is written.
    Write,
    /// 4: the first words are loaded again.
    Reload,
    /// Another value, 0..=7.
    Unknown(u8),
}

bits! {
    /// Control and status, 0x0502: the command in bits 8 to 10, and flags.
    SiiControl(u16) {
        /// Bit 0: a write is allowed that comes with this.
        WRITE_ENABLE = 1 << 0;
        /// Bit 5: the slave's own controller emulates the EEPROM.
        EMULATION = 1 << 5;
        /// Bit 6: a read gives 8 bytes, not 4.
        READS_8_BYTES = 1 << 6;
        /// Bit 7: the EEPROM has more than 16 kbit.
        TWO_ADDRESS_BYTES = 1 << 7;
        /// Bit 11: the checksum of the first words is wrong.
        CHECKSUM_ERROR = 1 << 11;
        /// Bit 12: the first words are not loaded.
        NOT_LOADED = 1 << 12;
        /// Bit 13: the EEPROM did not answer, or the command is not valid.
        COMMAND_ERROR = 1 << 13;
        /// Bit 14: a write without the bit that allows it.
        WRITE_ENABLE_ERROR = 1 << 14;
        /// Bit 15: a command runs.
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

    /// The word with a command.
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
