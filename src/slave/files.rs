//! The files that a device serves by FoE: its firmware, which masters access in bootstrap, and the files that masters store.

use crate::ethercat::foe::FoeError;

/// The name of the firmware file. \[OURS] Any name that begins with it denotes the firmware, such as `firmware.bin`.
pub const FIRMWARE_NAME: &str = "firmware";
/// \[OURS] The maximum number of files of a device, including its firmware.
pub const FILES_MAX: usize = 8;
/// \[OURS] The maximum size of a file, bytes.
pub const FILE_BYTES_MAX: usize = 1 << 20;
/// \[OURS] The maximum length of a file name, bytes.
pub const FILE_NAME_BYTES_MAX: usize = 64;

/// A file with its name.
#[derive(Clone, Debug)]
struct File {
    name: Vec<u8>,
    bytes: Vec<u8>,
}

/// The non-volatile files of a device.
///
/// \[OURS] Firmware is written in bootstrap only, and read in bootstrap, PreOP, SafeOP and OP; other files are read and
/// written in PreOP, SafeOP and OP. No password is required. A written file is stored and has no effect on the device.
#[derive(Clone, Debug)]
pub struct FileStore {
    /// The files; the firmware is the first one.
    files: Vec<File>,
}

impl FileStore {
    /// The files of a device with this factory firmware.
    pub fn new(firmware: impl Into<Vec<u8>>) -> Self {
        Self { files: vec![File { name: FIRMWARE_NAME.into(), bytes: firmware.into() }] }
    }

    /// Whether a name denotes the firmware. In bootstrap every other name is an error.
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
    /// [`FoeError::NOT_FOUND`]: there is no such file. [`FoeError::NOT_BOOTSTRAP`]: the file is not the firmware, and the
    /// device is in bootstrap.
    pub fn read(&self, name: &[u8], in_bootstrap: bool) -> Result<&[u8], FoeError> {
        let is_firmware = Self::is_firmware(name, in_bootstrap)?;
        let file = self.place(name, is_firmware).and_then(|place| self.files.get(place));
        file.map(|file| &*file.bytes).ok_or(FoeError::NOT_FOUND)
    }

    /// Checks whether a file may be written.
    ///
    /// # Errors
    /// [`FoeError::BOOTSTRAP_ONLY`] for firmware outside bootstrap, [`FoeError::NOT_BOOTSTRAP`] for another file in
    /// bootstrap, [`FoeError::ILLEGAL`] for an empty or too long name, [`FoeError::DISK_FULL`] for a new file beyond
    /// [`FILES_MAX`].
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

    /// Writes a whole file, if [`Self::may_write`] allows it.
    ///
    /// # Errors
    /// The errors of [`Self::may_write`], and [`FoeError::DISK_FULL`] for a file longer than [`FILE_BYTES_MAX`].
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
