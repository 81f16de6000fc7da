//! Access to the EEPROM: registers 0x0500 to 0x050F.

use super::sii::checksum;
use super::{Ns, OddSlave};

/// What a read behind the end of an EEPROM returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beyond {
    /// This byte, over and over.
    Byte(u8),
    /// No acknowledge.
    Nobody,
    /// The beginning of the EEPROM again.
    Again,
}

/// An EEPROM.
pub struct Eeprom {
    /// Its content.
    pub bytes: Vec<u8>,
    /// Duration of each command, ns.
    pub busy_ns: Ns,
    /// Time without an acknowledge after a word was written, ns.
    pub silent_ns: Ns,
    /// A read returns 8 bytes instead of 4.
    pub reads_8: bool,
    /// What reads behind its end return.
    pub beyond: Beyond,
    /// The slave's own controller takes the EEPROM when it is offered.
    pub is_taken: bool,
    /// Commands so far, with their words.
    pub commands: Vec<(u8, u16)>,
    status: u16,
    busy_until: Ns,
    silent_until: Ns,
}

const CHECKSUM_ERROR: u16 = 1 << 11;
const NOT_ACKNOWLEDGED: u16 = 1 << 13;
const NOT_ENABLED: u16 = 1 << 14;
const BUSY: u16 = 1 << 15;

impl Eeprom {
    pub(super) const fn new(bytes: Vec<u8>) -> Self {
        Self {
            bytes,
            busy_ns: 0,
            silent_ns: 0,
            reads_8: true,
            beyond: Beyond::Byte(0xFF),
            is_taken: true,
            commands: Vec::new(),
            status: 0,
            busy_until: 0,
            silent_until: 0,
        }
    }

    /// A word of it.
    pub fn word(&self, word: usize) -> u16 {
        let byte = |at: usize| self.bytes.get(at).copied().unwrap_or(0xFF);
        u16::from_le_bytes([byte(2 * word), byte(2 * word + 1)])
    }

    /// The bytes from a word on; `None`: no acknowledge.
    fn bytes_from(&self, word: usize, count: usize) -> Option<Vec<u8>> {
        let byte = |at: usize| match (self.bytes.get(at), self.beyond) {
            (Some(byte), _) => Some(*byte),
            (None, Beyond::Byte(byte)) => Some(byte),
            (None, Beyond::Nobody) => None,
            (None, Beyond::Again) => self.bytes.get(at % self.bytes.len()).copied(),
        };
        (2 * word..2 * word + count).map(byte).collect()
    }
}

impl OddSlave {
    /// Loads the EEPROM at power-on; nothing if the checksum is wrong.
    pub(super) fn load_eeprom(&mut self) {
        let word = |n| self.eeprom.word(n);
        let [kind, configuration, alias] = [word(0), word(1), word(4)];
        let is_right = word(7) == 0x88A4 || word(7) as u8 == checksum(&self.eeprom.bytes);
        self.eeprom.status = if is_right { 0 } else { CHECKSUM_ERROR };
        self.memory[0x0110] = self.memory[0x0110] & !1 | u8::from(is_right);
        if is_right {
            self.put(0x0140, &kind.to_le_bytes());
            self.put(0x0150, &configuration.to_le_bytes());
            self.put(0x0012, &alias.to_le_bytes());
        }
    }

    /// Whether the slave's own controller has the EEPROM, or a command runs.
    pub(super) fn is_eeprom_kept(&self) -> bool {
        self.memory[0x0501] & 1 != 0 || self.now < self.eeprom.busy_until
    }

    /// The master has offered the EEPROM, or has taken it.
    pub(super) fn pass_eeprom(&mut self) {
        match self.memory[0x0500] {
            byte if byte & 2 != 0 => self.memory[0x0501] = 0,
            1 if self.eeprom.is_taken => self.memory[0x0501] = 1,
            _ => self.memory[0x0501] = 0,
        }
    }

    pub(super) fn show_eeprom(&mut self) {
        let width = if self.eeprom.reads_8 { 1 << 6 } else { 0 };
        let busy = if self.now < self.eeprom.busy_until { BUSY } else { 0 };
        let status = self.eeprom.status | width | busy;
        self.put(0x0502, &status.to_le_bytes());
    }

    pub(super) fn command_eeprom(&mut self, control: u16) {
        let kept = self.eeprom.status & CHECKSUM_ERROR;
        let (command, word) = ((control >> 8) as u8 & 7, self.word(0x0504));
        self.eeprom.commands.push((command, word));
        self.eeprom.status = kept;
        if command == 0 {
            return;
        }
        self.eeprom.busy_until = self.now + self.eeprom.busy_ns;
        if self.now < self.eeprom.silent_until {
            self.eeprom.status |= NOT_ACKNOWLEDGED;
            return;
        }
        match command {
            1 => match self.eeprom.bytes_from(word.into(), if self.eeprom.reads_8 { 8 } else { 4 }) {
                Some(bytes) => self.put(0x0508, &bytes),
                None => self.eeprom.status |= NOT_ACKNOWLEDGED,
            },
            2 if control & 1 == 0 => self.eeprom.status |= NOT_ENABLED,
            2 => {
                let value = [self.memory[0x0508], self.memory[0x0509]];
                match self.eeprom.bytes.get_mut(2 * usize::from(word)..2 * usize::from(word) + 2) {
                    Some(place) => place.copy_from_slice(&value),
                    None => self.eeprom.status |= NOT_ACKNOWLEDGED,
                }
                self.eeprom.silent_until = self.now + self.eeprom.busy_ns + self.eeprom.silent_ns;
            }
            _ => {}
        }
    }
}
