//! A folder that is packed into an archive or a Debian package. Its files get fixed modes and times, so that the package
//! does not depend on this machine.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use crate::error::Error;
use crate::system::{self, symlink};

/// A folder that is packed, with fixed file modes.
pub struct Tree {
    root: PathBuf,
}

/// The file mode of data: everybody may read it.
pub const DATA: u32 = 0o644;
/// The file mode of programs and folders: everybody may read and execute it.
pub const PROGRAM: u32 = 0o755;

impl Tree {
    /// Makes an empty tree at `root`, which is a folder for build results; an older tree there is removed.
    pub fn new(root: PathBuf) -> Result<Self, Error> {
        if root.exists() {
            fs::remove_dir_all(&root).map_err(Error::file("remove", &root))?;
        }
        let tree = Self { root };
        tree.folder(Path::new(""))?;
        Ok(tree)
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Converts a path in the tree to a path on this machine.
    pub fn at(&self, path: &str) -> PathBuf {
        self.root.join(path)
    }

    pub fn write(&self, path: &str, content: impl AsRef<[u8]>) -> Result<(), Error> {
        let file = self.place(path)?;
        fs::write(&file, content).map_err(Error::file("write", &file))?;
        set_mode(&file, DATA)
    }

    pub fn copy(&self, from: &Path, path: &str, mode: u32) -> Result<(), Error> {
        let file = self.place(path)?;
        fs::copy(from, &file).map_err(Error::file("copy", from))?;
        set_mode(&file, mode)
    }

    /// Copies the files of a folder whose names end in one of `endings`.
    pub fn copy_all(&self, folder: &Path, path: &str, endings: &[&str]) -> Result<(), Error> {
        for file in files(folder)? {
            let name = file.to_string_lossy();
            if endings.iter().any(|ending| name.ends_with(ending)) {
                self.copy(&folder.join(&file), &format!("{path}/{name}"), DATA)?;
            }
        }
        Ok(())
    }

    /// Makes a symbolic link.
    pub fn link(&self, path: &str, target: &str) -> Result<(), Error> {
        let link = self.place(path)?;
        symlink(target, &link).map_err(Error::file("make the link", &link))
    }

    /// Gives all files the modification time `epoch`, in seconds since 1970.
    pub fn set_time(&self, epoch: u64) -> Result<(), Error> {
        let time = UNIX_EPOCH + Duration::from_secs(epoch);
        for file in self.files()?.iter().map(|file| self.root.join(file)).filter(|file| !file.is_symlink()) {
            let set = File::options().write(true).open(&file).and_then(|opened| opened.set_modified(time));
            set.map_err(Error::file("set the time of", &file))?;
        }
        Ok(())
    }

    /// Gives all files this mode, whatever the umask of the program was that has written them.
    pub fn set_modes(&self, mode: u32) -> Result<(), Error> {
        self.files()?.iter().try_for_each(|file| set_mode(&self.root.join(file), mode))
    }

    /// The files and links in the tree, by their paths relative to its root, sorted by name.
    pub fn files(&self) -> Result<Vec<PathBuf>, Error> {
        files(&self.root)
    }

    /// Like [`Self::at`], and makes the folder of the path.
    fn place(&self, path: &str) -> Result<PathBuf, Error> {
        self.folder(Path::new(path).parent().unwrap_or(Path::new("")))?;
        Ok(self.at(path))
    }

    fn folder(&self, path: &Path) -> Result<(), Error> {
        let mut folder = self.root.clone();
        fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
        set_mode(&folder, PROGRAM)?;
        for part in path.components() {
            folder.push(part);
            if !folder.exists() {
                fs::create_dir(&folder).map_err(Error::file("make", &folder))?;
                set_mode(&folder, PROGRAM)?;
            }
        }
        Ok(())
    }
}

/// The files and links below a folder, relative to it, sorted by name.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut found = Vec::new();
    collect(folder, Path::new(""), &mut found)?;
    found.sort();
    Ok(found)
}

fn collect(root: &Path, below: &Path, found: &mut Vec<PathBuf>) -> Result<(), Error> {
    let folder = root.join(below);
    for entry in fs::read_dir(&folder).map_err(Error::file("list", &folder))? {
        let entry = entry.map_err(Error::file("list", &folder))?;
        let path = below.join(entry.file_name());
        if entry.file_type().map_err(Error::file("look at", &folder))?.is_dir() {
            collect(root, &path, found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

fn set_mode(path: &Path, mode: u32) -> Result<(), Error> {
    system::set_mode(path, mode).map_err(Error::file("set the mode of", path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::mode_of;

    #[test]
    fn modes_and_times_are_those_that_were_said() {
        let folder = tempfile::tempdir().unwrap();
        let secret = folder.path().join("secret");
        fs::write(&secret, "x").unwrap();
        set_mode(&secret, 0o600).unwrap();
        let tree = Tree::new(folder.path().join("tree")).unwrap();
        tree.copy(&secret, "a/b/program", PROGRAM).unwrap();
        tree.write("a/text", "text").unwrap();
        tree.link("a/link", "text").unwrap();
        tree.set_time(1_000_000_000).unwrap();
        assert_eq!(tree.files().unwrap(), ["a/b/program", "a/link", "a/text"].map(PathBuf::from));
        for (path, mode) in [("", 0o755), ("a/b", 0o755), ("a/b/program", 0o755), ("a/text", 0o644)] {
            let metadata = fs::metadata(tree.at(path)).unwrap();
            assert_eq!(mode_of(&metadata), mode, "{path}");
            if metadata.is_file() {
                assert_eq!(metadata.modified().unwrap(), UNIX_EPOCH + Duration::from_secs(1_000_000_000));
            }
        }
    }
}
