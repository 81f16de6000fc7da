//! The files of a device that has some, which masters read and write by FoE: its firmware, in bootstrap, and others.

use crate::ethercat::foe::FoeError;

/// The name of the firmware. \[OURS] A name that begins with it is the firmware, too, e.g. `firmware.bin`.
pub const FIRMWARE_NAME: &str = "firmware";
/// \[OURS] The most files of a device, its firmware included.
pub const FILES_MAX: usize = 8;
/// \[OURS] The longest file, bytes.
pub const FILE_BYTES_MAX: usize = 1 << 20;
/// \[OURS] The longest name, bytes.
pub const FILE_NAME_BYTES_MAX: usize = 64;

/// A file with its name.
#[derive(Clone, Debug)]
struct File {
    name: Vec<u8>,
    bytes: Vec<u8>,
}

/// The files of a device. They are kept without power.
///
/// \[OURS] Firmware is written in bootstrap alone, and read there and in PreOP, SafeOP and OP; other files are read and written in
/// PreOP, SafeOP and OP. No password is asked for. What is written is kept as it is: the device goes on as it was.
#[derive(Clone, Debug)]
pub struct FileStore {
    /// The firmware first.
    files: Vec<File>,
}

impl FileStore {
    /// The files of a device that comes from its factory with this firmware.
    pub fn new(firmware: impl Into<Vec<u8>>) -> Self {
        Self { files: vec![File { name: FIRMWARE_NAME.into(), bytes: firmware.into() }] }
    }

    /// Whether a file is the firmware, and may be used in this state at all.
    fn is_firmware(name: &[u8], in_bootstrap: bool) -> Result<bool, FoeError> {
        match (name.starts_with(FIRMWARE_NAME.as_bytes()), in_bootstrap) {
            (false, true) => Err(FoeError::NOT_BOOTSTRAP),
            (is_firmware, _) => Ok(is_firmware),
        }
    }

    fn place(&self, name: &[u8], is_firmware: bool) -> Option<usize> {
        if is_firmware { Some(0) } else { self.files.iter().position(|file| file.name == name) }
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// [`FoeError::NOT_FOUND`]; [`FoeError::NOT_BOOTSTRAP`]: it is no firmware, and the device is in bootstrap.
    pub fn read(&self, name: &[u8], in_bootstrap: bool) -> Result<&[u8], FoeError> {
        let is_firmware = Self::is_firmware(name, in_bootstrap)?;
        let file = self.place(name, is_firmware).and_then(|place| self.files.get(place));
        file.map(|file| &*file.bytes).ok_or(FoeError::NOT_FOUND)
    }

    /// Whether a file may be written.
    ///
    /// # Errors
    /// [`FoeError::BOOTSTRAP_ONLY`] for firmware outside bootstrap, [`FoeError::NOT_BOOTSTRAP`] for another file in bootstrap,
    /// [`FoeError::ILLEGAL`] for a name that is empty or too long, [`FoeError::DISK_FULL`] if there are as many files as there may
    /// be.
    pub fn may_write(&self, name: &[u8], in_bootstrap: bool) -> Result<(), FoeError> {
        let is_firmware = Self::is_firmware(name, in_bootstrap)?;
        if is_firmware && !in_bootstrap {
            return Err(FoeError::BOOTSTRAP_ONLY);
        }
        if name.is_empty() || name.len() > FILE_NAME_BYTES_MAX {
            return Err(FoeError::ILLEGAL);
        }
        if self.place(name, is_firmware).is_none() && self.files.len() >= FILES_MAX {
            return Err(FoeError::DISK_FULL);
        }
        Ok(())
    }

    /// Writes a whole file, as [`Self::may_write`] allows.
    ///
    /// # Errors
    /// As [`Self::may_write`], and [`FoeError::DISK_FULL`] beyond [`FILE_BYTES_MAX`].
    pub fn write(&mut self, name: &[u8], in_bootstrap: bool, bytes: &[u8]) -> Result<(), FoeError> {
        self.may_write(name, in_bootstrap)?;
        if bytes.len() > FILE_BYTES_MAX {
            return Err(FoeError::DISK_FULL);
        }
        match self.place(name, in_bootstrap) {
            Some(place) => self.files[place].bytes = bytes.to_vec(),
            None => self.files.push(File { name: name.to_vec(), bytes: bytes.to_vec() }),
        }
        Ok(())
    }
}
