//! The folder of a flight recorder. Tests use a folder in memory instead, which simulates a power cut.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The subfolder with the kept moments.
pub(super) const KEPT: &str = "kept";

/// The operations of a flight recorder on its folder. File names are relative to the folder; a file in a subfolder is
/// `kept/NAME`.
pub(super) trait Folder: Send + Sync + 'static {
    /// Creates a file, or empties it if it exists.
    fn create(&self, name: &str) -> io::Result<Box<dyn Output>>;

    /// Opens a file to be read from its beginning.
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + Send>>;

    /// The names of all files with their lengths in bytes, in any order.
    fn list(&self) -> io::Result<Vec<(String, u64)>>;

    /// Renames a file; an existing file with the new name is replaced.
    fn rename(&self, from: &str, to: &str) -> io::Result<()>;

    fn remove(&self, name: &str) -> io::Result<()>;

    /// Has the system write the contents of a file to the disk.
    fn sync(&self, name: &str) -> io::Result<()>;

    /// Has the system write the directory entries to the disk, that is the names of the files.
    fn sync_names(&self) -> io::Result<()>;
}

/// An open file that only grows.
pub(super) trait Output: Send {
    /// Appends bytes: all of them, or none if that fails.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// A folder on a disk.
pub(super) struct Disk(PathBuf);

impl Disk {
    /// Creates the folder if it does not exist; its parent folder must exist.
    pub fn make(path: &Path) -> io::Result<Self> {
        for folder in [path, &path.join(KEPT)] {
            match fs::create_dir(folder) {
                Err(error) if !folder.is_dir() => return Err(error),
                _ => {}
            }
        }
        Ok(Self::at(path))
    }

    /// A folder that exists already.
    pub fn at(path: &Path) -> Self {
        Self(path.to_owned())
    }
}

impl Folder for Disk {
    fn create(&self, name: &str) -> io::Result<Box<dyn Output>> {
        let file = OpenOptions::new().write(true).create(true).truncate(true).open(self.0.join(name))?;
        Ok(Box::new(Growing { file, length: 0 }))
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Read + Send>> {
        Ok(Box::new(File::open(self.0.join(name))?))
    }

    fn list(&self) -> io::Result<Vec<(String, u64)>> {
        let mut found = Vec::new();
        for (folder, before) in [(self.0.clone(), String::new()), (self.0.join(KEPT), format!("{KEPT}/"))] {
            let entries = match fs::read_dir(folder) {
                Err(error) if error.kind() == io::ErrorKind::NotFound && !before.is_empty() => continue,
                entries => entries?,
            };
            for entry in entries {
                let entry = entry?;
                // Left out are files that were removed meanwhile, and names that are not UTF-8: all names of this crate
                // are ASCII.
                if let (Ok(metadata), Some(name)) = (entry.metadata(), entry.file_name().to_str())
                    && metadata.is_file()
                {
                    found.push((format!("{before}{name}"), metadata.len()));
                }
            }
        }
        Ok(found)
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        fs::rename(self.0.join(from), self.0.join(to))
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        fs::remove_file(self.0.join(name))
    }

    fn sync(&self, name: &str) -> io::Result<()> {
        // Windows syncs only a file that is open for writing.
        OpenOptions::new().write(true).open(self.0.join(name))?.sync_data()
    }

    fn sync_names(&self) -> io::Result<()> {
        // Windows has no such call; NTFS keeps file names in a journal.
        if cfg!(unix) {
            for folder in [self.0.clone(), self.0.join(KEPT)] {
                File::open(folder)?.sync_all()?;
            }
        }
        Ok(())
    }
}

struct Growing {
    file: File,
    length: u64,
}

impl Output for Growing {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        use std::io::{Seek, SeekFrom};

        if let Err(error) = self.file.write_all(bytes) {
            // If this fails as well, the error of the write is the one that is reported.
            let _ = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            return Err(error);
        }
        self.length += bytes.len() as u64;
        Ok(())
    }
}

/// The name of a segment of the ring.
pub(super) fn segment(number: u64) -> String {
    format!("segment-{number:08}.ecmrec")
}

/// The name of a segment's compressed form until it replaces the uncompressed one.
pub(super) fn packed(number: u64) -> String {
    format!("segment-{number:08}.packed")
}

/// The name of the recording of a kept moment.
pub(super) fn moment(number: u64) -> String {
    format!("{KEPT}/moment-{number:08}.ecmrec")
}

/// The name of a kept moment's recording while it is being written.
pub(super) fn unfinished(number: u64) -> String {
    format!("{KEPT}/moment-{number:08}.tmp")
}

/// The name of the text with the reasons of a kept moment.
pub(super) fn note(number: u64) -> String {
    format!("{KEPT}/moment-{number:08}.txt")
}

/// Whether the name is a temporary one: a recorder writes such a file and then renames it. A power cut may leave the
/// file under its temporary name.
pub(super) fn is_unfinished(name: &str) -> bool {
    let is_text = [".txt.tmp", ".mark.tmp"].iter().any(|ending| name.ends_with(ending));
    is_text || number(name, packed).or(number(name, unfinished)).is_some()
}

/// The largest number of a segment or a moment; a file with a larger number is not from a recorder. \[OURS] The limit
/// leaves room for next numbers, and no recorder counts that far.
const NUMBER_MAX: u64 = u64::MAX / 2;

/// The number in a file name; `of` is the function above that makes such names. `None` for any other name.
pub(super) fn number(name: &str, of: fn(u64) -> String) -> Option<u64> {
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    digits.parse().ok().filter(|number| *number <= NUMBER_MAX && of(*number) == name)
}

/// Reads a short text, at most `max` bytes of it.
pub(super) fn text(folder: &dyn Folder, name: &str, max: u64) -> io::Result<String> {
    let mut bytes = Vec::new();
    folder.open(name)?.take(max).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Writes a short text under a temporary name and renames it, so that a reader never finds an incomplete text.
pub(super) fn put_text(folder: &dyn Folder, name: &str, text: &str) -> io::Result<()> {
    let beside = format!("{name}.tmp");
    folder.create(&beside)?.append(text.as_bytes())?;
    folder.sync(&beside)?;
    folder.rename(&beside, name)
}
