//! Writes the archive of the guest's root: cpio in the format "newc" (Documentation/driver-api/early-userspace/
//! buffer-format.rst of Linux).

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::error::Error;
use crate::system::mode_of;

const FOLDER: u32 = 0o040_755;
const FILE: u32 = 0o100_000;
const LINK: u32 = 0o120_777;
const END: &str = "TRAILER!!!";

/// A cpio archive to which files are added.
#[derive(Default)]
pub struct Archive {
    bytes: Vec<u8>,
    folders: BTreeSet<String>,
    entries: u32,
}

impl Archive {
    /// Adds a folder and those above it; `path` does not begin with `/`.
    pub fn folder(&mut self, path: &str) {
        if path.is_empty() || !self.folders.insert(path.to_owned()) {
            return;
        }
        self.folder(path.rsplit_once('/').map_or("", |(above, _)| above));
        self.entry(path, FOLDER, &[]);
    }

    /// Adds a file with these permissions and this content.
    pub fn file(&mut self, path: &str, permissions: u32, content: &[u8]) {
        self.folder(path.rsplit_once('/').map_or("", |(above, _)| above));
        self.entry(path, FILE | permissions, content);
    }

    /// Adds a copy of a file, with its permissions.
    pub fn copy(&mut self, path: &str, from: &Path) -> Result<(), Error> {
        let read = || Ok((fs::read(from)?, mode_of(&fs::metadata(from)?) & 0o777));
        let (content, permissions) = read().map_err(Error::file("read", from))?;
        self.file(path, permissions, &content);
        Ok(())
    }

    /// Adds a symbolic link.
    pub fn link(&mut self, path: &str, target: &str) {
        self.folder(path.rsplit_once('/').map_or("", |(above, _)| above));
        self.entry(path, LINK, target.as_bytes());
    }

    /// Completes the archive and returns its bytes.
    pub fn finish(mut self) -> Vec<u8> {
        self.entry(END, 0, &[]);
        self.bytes
    }

    fn entry(&mut self, path: &str, mode: u32, content: &[u8]) {
        self.entries += 1;
        let (size, name) = (content.len() as u32, path.len() as u32 + 1);
        // The header fields: inode number, mode, owner, group, links, time, size, four device numbers, length of the name, an
        // unused checksum.
        let fields = [self.entries, mode, 0, 0, 1, 0, size, 0, 0, 0, 0, name, 0];
        self.bytes.extend_from_slice(b"070701");
        for field in fields {
            self.bytes.extend_from_slice(format!("{field:08X}").as_bytes());
        }
        self.bytes.extend_from_slice(path.as_bytes());
        self.bytes.push(0);
        self.align();
        self.bytes.extend_from_slice(content);
        self.align();
    }

    fn align(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_is_aligned_and_its_folders_come_before_it() {
        let mut archive = Archive::default();
        archive.file("a/b/c", 0o755, b"12345");
        archive.file("a/b/d", 0o644, b"");
        let bytes = archive.finish();
        assert_eq!(bytes.len() % 4, 0);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let at = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what} is missing in {text}"));
        assert!(at("a\0") < at("a/b\0") && at("a/b\0") < at("a/b/c\0") && at("a/b/d\0") < at("TRAILER!!!"));
        assert_eq!(text.matches("070701").count(), 5, "each folder once");
        // An entry of a cpio archive in the format newc: a magic number of 6 digits and 13 fields of 8 digits (110 bytes),
        // the name with its terminating 0 padded to a multiple of 4, the content.
        let entry = at("a/b/c\0") - 110;
        assert_eq!(entry % 4, 0);
        assert_eq!(&text[entry + 6 + 8..entry + 6 + 16], "000081ED");
        assert_eq!(&text[entry + 6 + 48..entry + 6 + 56], "00000005");
        assert_eq!(&bytes[(entry + 110 + 6).next_multiple_of(4)..][..6], b"12345\0");
    }
}
