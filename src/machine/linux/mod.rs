//! A machine with Linux, read from its files in `/sys`, `/proc`, `/dev` and `/etc`. libusb is not used, so that the
//! checks also work where a board cannot be opened.
//!
//! [`Machine`] reads the facts ([`usb`], [`spi`], [`gpio`], [`gadget`], [`holders`], [`limits`], [`net`], [`udev`]); `findings/`
//! judges them.

mod findings;
pub mod gadget;
pub mod gpio;
pub mod holders;
pub mod limits;
pub mod net;
pub mod spi;
pub mod udev;
pub mod usb;

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use rustix::fs::Access as Wanted;

use super::printable;

/// \[OURS] The length of the longest file that is read, bytes (1 MiB). The system's files are far shorter.
const FILE_MAX: u64 = 1 << 20;

/// A machine with Linux, read from the files below a folder: `/`, or another one in tests.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Machine {
    root: PathBuf,
}

/// Whether this user may read and write a file, according to its permissions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The user may read and write the file.
    Granted,
    /// The user may not read and write the file.
    Denied,
    /// The file does not exist.
    Missing,
}

impl Machine {
    /// The machine that this process runs on.
    pub fn here() -> Self {
        Self::below("/")
    }

    /// A machine whose `/sys`, `/proc`, `/dev` and `/etc` are in the folder `root`.
    pub fn below(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The path of one of the machine's files, such as `/sys/bus/usb`.
    pub fn file(&self, name: &str) -> PathBuf {
        self.root.join(name.trim_start_matches('/'))
    }

    /// Whether there is a file of that name.
    pub fn has(&self, name: &str) -> bool {
        fs::symlink_metadata(self.file(name)).is_ok()
    }

    /// Whether this user may read and write a file, by its mode, groups and access list.
    pub fn access(&self, name: &str) -> Access {
        let file = self.file(name);
        match rustix::fs::access(&file, Wanted::READ_OK | Wanted::WRITE_OK) {
            Ok(()) => Access::Granted,
            Err(rustix::io::Errno::NOENT | rustix::io::Errno::NOTDIR) => Access::Missing,
            Err(_) => Access::Denied,
        }
    }

    /// The bytes of a file; `None` if it does not exist, cannot be read, is no regular file or is too long.
    fn bytes(&self, name: &str) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let file = self.file(name);
        // Opening a pipe would wait for a process at its other end.
        let is_file = fs::metadata(&file).is_ok_and(|data| data.is_file());
        let file = if is_file { File::open(file).ok()? } else { return None };
        file.take(FILE_MAX + 1).read_to_end(&mut bytes).ok()?;
        (bytes.len() as u64 <= FILE_MAX).then_some(bytes)
    }

    /// The text of a file; `None` as in [`Machine::bytes`].
    fn text(&self, name: &str) -> Option<String> {
        Some(String::from_utf8_lossy(&self.bytes(name)?).into_owned())
    }

    /// The first line of a file, safe to print; `None` if there is none.
    fn attribute(&self, name: &str) -> Option<String> {
        let text = self.text(name)?;
        let line = printable(text.lines().next()?.trim());
        (!line.is_empty()).then_some(line)
    }

    /// The number in the first line of a file; `None` if there is none.
    fn number(&self, name: &str) -> Option<i64> {
        self.attribute(name)?.parse().ok()
    }

    /// The hexadecimal number of at most 16 bits in the first line of a file; `None` if there is none.
    fn hexadecimal(&self, name: &str) -> Option<u16> {
        u16::from_str_radix(&self.attribute(name)?, 16).ok()
    }

    /// The names in a folder, sorted; none if there is no such folder.
    fn names(&self, folder: &str) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.file(folder)) else { return Vec::new() };
        let mut names: Vec<String> = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// The file name of a symbolic link's target: `usbhid` for `../../bus/usb/drivers/usbhid`.
    fn link_name(&self, name: &str) -> Option<String> {
        let target = fs::read_link(self.file(name)).ok()?;
        Some(printable(target.file_name()?.to_str()?))
    }

    /// The path of a shared library in the usual folders, including those of an architecture such as `x86_64-linux-gnu`.
    fn library(&self, name: &str) -> Option<String> {
        const FOLDERS: [&str; 5] = ["/usr/local/lib", "/usr/lib", "/lib", "/usr/lib64", "/lib64"];
        let kinds = |folder: &str| {
            let inside = self.names(folder).into_iter().filter(|inside| inside.contains("-linux-"));
            inside.map(|inside| format!("{folder}/{inside}")).collect::<Vec<_>>()
        };
        let folders = FOLDERS.into_iter().flat_map(|folder| [vec![folder.to_owned()], kinds(folder)].concat());
        folders.map(|folder| format!("{folder}/{name}")).find(|file| self.has(file))
    }

    /// The target of a symbolic link, unresolved.
    fn link(&self, file: &Path) -> Option<String> {
        fs::read_link(file).ok()?.into_os_string().into_string().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A text from a device is shown without control codes for the terminal, and a long text is cut.
    #[test]
    fn texts_from_outside_are_shown_harmlessly() {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("name"), b"  \x1b[31mRed\xff \nsecond\n").expect("a file");
        fs::write(folder.path().join("long"), "x".repeat(5000)).expect("a file");
        fs::write(folder.path().join("blank"), "\n").expect("a file");
        let machine = Machine::below(folder.path());
        assert_eq!(machine.attribute("/name").as_deref(), Some("\u{FFFD}[31mRed\u{FFFD}"));
        assert_eq!(machine.attribute("/long").map(|text| text.len()), Some(126));
        assert_eq!((machine.attribute("/blank"), machine.attribute("/none")), (None, None));
        assert_eq!(machine.attribute("/"), None, "a folder says nothing");
    }
}
