//! Fetches programs with pip or npm into the target folder, checks their checksums and unpacks them. Nothing is installed, and
//! no program is run before its checksum was compared.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs::{NPM, Need, PIP};
use crate::project::Project;
use crate::{npm, wheel};

/// A fixed version of a package of a registry, and the program in it that `cargo xtask` or a test runs.
#[derive(Debug, PartialEq, Eq)]
pub struct Fetched {
    pub index: Index,
    pub name: &'static str,
    pub version: &'static str,
    pub sha256: &'static str,
    /// The path of the program in the package.
    pub program: &'static str,
    /// The size of the download and the disk space, for the user.
    pub cost: &'static str,
}

/// The registry and the form in which a package is fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// As a Python wheel, with pip.
    Pip,
    /// As the sources of a Python package, with pip.
    PipSources,
    /// As a package of npm.
    Npm {
        /// The paths in the package that are unpacked.
        parts: &'static [&'static str],
    },
}

impl Index {
    /// The program that fetches packages from this registry: pip or npm.
    pub const fn need(self) -> Need {
        match self {
            Self::Pip | Self::PipSources => PIP,
            Self::Npm { .. } => NPM,
        }
    }
}

impl Fetched {
    /// The folder into which the package is unpacked.
    pub fn folder(&self, project: &Project) -> PathBuf {
        // [`Self::fetch`] derives the names of temporary folders by replacing the extension. Without the extension `.d` it
        // would replace the last part of the version.
        let what = if self.index == Index::PipSources { "-sources" } else { "" };
        project.target.join("xtask").join(format!("{}-{}{what}.d", self.name, self.version))
    }

    /// The path of the program after unpacking.
    pub fn program(&self, project: &Project) -> PathBuf {
        self.folder(project).join(self.program)
    }

    pub fn is_there(&self, project: &Project) -> bool {
        self.program(project).is_file()
    }

    /// Fetches the package, checks it and unpacks it.
    pub fn fetch(&self, project: &Project) -> Result<(), Error> {
        let folder = self.folder(project);
        let [fetched, unpacked] = ["fetched", "unpacking"].map(|extension| folder.with_extension(extension));
        for folder in [&folder, &fetched, &unpacked] {
            remove(folder)?;
        }
        for folder in [&fetched, &unpacked] {
            fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        }
        println!("fetching with {}: {} {} ({})", self.index.need().program, self.name, self.version, self.cost);
        match self.index {
            Index::Pip => wheel::download(self, &fetched),
            Index::PipSources => wheel::download_sources(self, &fetched),
            Index::Npm { .. } => npm::download(self, &fetched),
        }?;
        let archive = checked(&fetched, self.sha256)?;
        match self.index {
            Index::Pip => wheel::unpack(self, &archive, &unpacked),
            Index::PipSources => wheel::unpack_sources(&archive, &unpacked),
            Index::Npm { parts } => npm::unpack(parts, &archive, &unpacked),
        }?;
        remove(&fetched)?;
        // The folder gets its final name last, so that a folder of that name is complete.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }
}

/// The only file in `folder`.
///
/// # Errors
/// The file does not have the expected checksum.
fn checked(folder: &Path, expected: &'static str) -> Result<PathBuf, Error> {
    let entry = fs::read_dir(folder).and_then(|mut entries| entries.next().transpose());
    let file = entry.map_err(Error::file("list", folder))?.map(|entry| entry.path()).unwrap_or_default();
    let said = command::output(Command::new("sha256sum").arg("--").arg(&file))?;
    let found = String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned();
    if found == expected { Ok(file) } else { Err(Error::Fetched { file, expected, found }) }
}

/// Removes a folder, if it is there.
pub fn remove(folder: &Path) -> Result<(), Error> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::file("remove", folder)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_with_other_bytes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.whl");
        fs::write(&file, "a\n").unwrap();
        let right = "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7";
        assert_eq!(checked(folder.path(), right).unwrap(), file);
        let other = "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5";
        let error = checked(folder.path(), other).unwrap_err().to_string();
        assert!(error.contains("a.whl") && error.contains(right) && error.contains(other), "{error}");
    }
}
