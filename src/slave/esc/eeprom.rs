//! The EEPROM of a slave and its interface, registers 0x0500 to 0x050F.

use super::EscSettings;
use super::memory::Memory;
use crate::ethercat::Ns;
use crate::ethercat::registers::{self, SII_ADDRESS, SII_CONTROL, SII_DATA, SiiCommand, SiiControl};
use crate::ethercat::sii::{CHECKED_LEN, Sii, SiiInfo, checksum};

/// The bits of the control word that a master can set.
const WRITABLE: SiiControl = SiiControl(SiiControl::WRITE_ENABLE.0 | 0b111 << 8);
/// The error bits that report the result of a command; the next command clears them.
const COMMAND_ERRORS: SiiControl = SiiControl(SiiControl::COMMAND_ERROR.0 | SiiControl::WRITE_ENABLE_ERROR.0);
/// The error bits that report the result of loading the configuration words; commands do not clear them.
const LOADING_ERRORS: SiiControl = SiiControl(SiiControl::CHECKSUM_ERROR.0 | SiiControl::NOT_LOADED.0);

/// The byte offset of the station alias, word 4.
const ALIAS: usize = 8;

/// The content of the EEPROM, and the state of the registers through which the master accesses it.
#[derive(Clone, Debug)]
pub(super) struct Eeprom {
    content: Vec<u8>,
    reads_8_bytes: bool,
    takes_ns: Ns,
    /// `silence_ns`: the duration of the internal write cycle after a write command, ns. `silent_until`: the end of the newest
    /// write cycle. In a write cycle the EEPROM acknowledges no command, and the command fails.
    silence_ns: Ns,
    silent_until: Ns,
    /// The running command: the value that was written to the control register, and the time when the command is done.
    running: Option<(SiiControl, Ns)>,
}

impl Eeprom {
    pub(super) fn new(content: Vec<u8>, settings: &EscSettings) -> Self {
        let EscSettings { reads_8_bytes, eeprom_ns: takes_ns, eeprom_silence_ns: silence_ns, .. } = *settings;
        Self { content, reads_8_bytes, takes_ns, silence_ns, silent_until: 0, running: None }
    }

    pub(super) fn content(&self) -> &[u8] {
        &self.content
    }

    /// Loads the configuration words (words 0 to 7), at power-on or by a reload command, and resets the control register.
    /// Returns `None`, and shows an error in that register, if their checksum is wrong.
    pub(super) fn load(&mut self, memory: &mut Memory) -> Option<SiiInfo> {
        self.running = None;
        let info = Sii::new(&self.content).ok().filter(Sii::has_right_checksum).map(|sii| sii.info());
        let errors = if info.is_some() { SiiControl::NONE } else { LOADING_ERRORS };
        memory.set_u16(SII_CONTROL, (self.fixed_bits() | errors).0);
        info
    }

    /// Stores a station alias in word 4 and updates the checksum. An EEPROM with a wrong checksum is left unchanged.
    pub(super) fn store_alias(&mut self, alias: u16) {
        if !Sii::new(&self.content).is_ok_and(|sii| sii.has_right_checksum()) {
            return;
        }
        self.content[ALIAS..ALIAS + 2].copy_from_slice(&alias.to_le_bytes());
        if let Some(first) = self.content.first_chunk::<CHECKED_LEN>() {
            self.content[CHECKED_LEN] = checksum(first);
        }
    }

    fn fixed_bits(&self) -> SiiControl {
        let reads = if self.reads_8_bytes { SiiControl::READS_8_BYTES } else { SiiControl::NONE };
        if self.content.len() > 2048 { reads | SiiControl::TWO_ADDRESS_BYTES } else { reads }
    }

    /// Whether the master may write to the interface now: the EEPROM is assigned to the master, and no command is
    /// running.
    pub(super) fn is_free(&self, memory: &Memory) -> bool {
        memory.u8(registers::SII_PDI_ACCESS) & 1 == 0 && self.running.is_none()
    }

    /// Handles a write to only the lower byte of the control register. It starts no command; the only bit that a master can
    /// change there is write enable.
    pub(super) fn written_in_part(&mut self, memory: &mut Memory) {
        let written = SiiControl(memory.u16(SII_CONTROL));
        let kept = SiiControl(written.0 & (0xFF00 | SiiControl::WRITE_ENABLE.0));
        memory.set_u16(SII_CONTROL, (kept | self.fixed_bits()).0);
    }

    /// Handles a write of the control word: starts the command that it contains, if any.
    pub(super) fn command(&mut self, written: SiiControl, now: Ns, memory: &mut Memory) {
        let kept = SiiControl(memory.u16(SII_CONTROL) & LOADING_ERRORS.0) | self.fixed_bits();
        let written = SiiControl(written.0 & WRITABLE.0);
        if written.command() == SiiCommand::None {
            memory.set_u16(SII_CONTROL, (kept | SiiControl(written.0 & SiiControl::WRITE_ENABLE.0)).0);
            return;
        }
        memory.set_u16(SII_CONTROL, (kept | SiiControl::BUSY | written).0);
        self.running = Some((written, now + self.takes_ns));
    }

    /// Completes the running command if it is done by `now`. Returns true if the configuration words must be loaded again.
    pub(super) fn advance(&mut self, now: Ns, memory: &mut Memory) -> bool {
        let Some((written, _)) = self.running.take_if(|(_, due)| *due <= now) else { return false };
        let at = (memory.u32(SII_ADDRESS) as usize).saturating_mul(2);
        let error = match written.command() {
            _ if now < self.silent_until => SiiControl::COMMAND_ERROR,
            SiiCommand::Read => {
                let len = if self.reads_8_bytes { 8 } else { 4 };
                for n in 0..len {
                    // Beyond its end the EEPROM reads as erased (0xFF).
                    let byte = self.content.get(at.saturating_add(n)).copied().unwrap_or(0xFF);
                    memory.set_u8(SII_DATA + n as u16, byte);
                }
                SiiControl::NONE
            }
            SiiCommand::Write if !written.contains(SiiControl::WRITE_ENABLE) => SiiControl::WRITE_ENABLE_ERROR,
            SiiCommand::Write => {
                let word: [u8; 2] = memory.get(SII_DATA);
                match self.content.get_mut(at..at.saturating_add(2)) {
                    Some(place) => {
                        place.copy_from_slice(&word);
                        self.silent_until = now + self.silence_ns;
                        SiiControl::NONE
                    }
                    None => SiiControl::COMMAND_ERROR,
                }
            }
            SiiCommand::Reload => SiiControl::NONE,
            SiiCommand::None | SiiCommand::Unknown(_) => SiiControl::COMMAND_ERROR,
        };
        let kept = SiiControl(memory.u16(SII_CONTROL) & LOADING_ERRORS.0) | self.fixed_bits();
        memory.set_u16(SII_CONTROL, (kept | SiiControl(error.0 & COMMAND_ERRORS.0)).0);
        written.command() == SiiCommand::Reload
    }

    /// The time when the running command is done; `None` if no command is running.
    pub(super) fn due(&self) -> Option<Ns> {
        self.running.map(|(_, due)| due)
    }
}
