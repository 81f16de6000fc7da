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

    /// Fetches the package, checks it and unpacks it. Wheels are fetched by [`fetch_wheels`].
    fn fetch(&self, project: &Project) -> Result<(), Error> {
        self.announce();
        let fetched = empty(self.folder(project).with_extension("fetched"))?;
        match self.index {
            Index::Pip => wheel::download(&[self], &fetched),
            Index::PipSources => wheel::download_sources(self, &fetched),
            Index::Npm { .. } => npm::download(self, &fetched),
        }?;
        self.unpack(project, &fetched)?;
        remove(&fetched)
    }

    fn announce(&self) {
        println!("fetching with {}: {} {} ({})", self.index.need().program, self.name, self.version, self.cost);
    }

    /// Unpacks the archive of the package, which is in the folder `fetched`.
    fn unpack(&self, project: &Project, fetched: &Path) -> Result<(), Error> {
        let folder = self.folder(project);
        remove(&folder)?;
        let unpacked = empty(folder.with_extension("unpacking"))?;
        let archive = checked(fetched, self.name, self.sha256)?;
        match self.index {
            Index::Pip => wheel::unpack(self, &archive, &unpacked),
            Index::PipSources => wheel::unpack_sources(&archive, &unpacked),
            Index::Npm { parts } => npm::unpack(parts, &archive, &unpacked),
        }?;
        // The folder gets its final name last, so that a folder of that name is complete.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }
}

/// Fetches packages, checks them and unpacks them: all wheels with one call of pip, which takes longer to start than most of
/// them to come.
pub fn fetch(project: &Project, packages: &[&Fetched]) -> Result<(), Error> {
    let (wheels, others): (Vec<&Fetched>, Vec<&Fetched>) =
        packages.iter().partition(|package| package.index == Index::Pip);
    if !wheels.is_empty() {
        wheels.iter().for_each(|wheel| wheel.announce());
        let fetched = empty(project.target.join("xtask/wheels.fetched"))?;
        wheel::download(&wheels, &fetched)?;
        wheels.iter().try_for_each(|wheel| wheel.unpack(project, &fetched))?;
        remove(&fetched)?;
    }
    others.iter().try_for_each(|package| package.fetch(project))
}

/// Makes the folder, without anything in it.
fn empty(folder: PathBuf) -> Result<PathBuf, Error> {
    remove(&folder)?;
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
    Ok(folder)
}

/// The file in `folder` with the expected checksum.
///
/// # Errors
/// No file has it; the error names the one that has the name of the package.
fn checked(folder: &Path, name: &str, expected: &'static str) -> Result<PathBuf, Error> {
    let mut other = (folder.join(name), "nothing".to_owned());
    for entry in fs::read_dir(folder).map_err(Error::file("list", folder))?.flatten() {
        let file = entry.path();
        let said = command::output(Command::new("sha256sum").arg("--").arg(&file))?;
        let found = String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned();
        if found == expected {
            return Ok(file);
        }
        if entry.file_name().to_string_lossy().to_lowercase().starts_with(name) {
            other = (file, found);
        }
    }
    let (file, found) = other;
    Err(Error::Fetched { file, expected, found })
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
        fs::write(folder.path().join("b.whl"), "b\n").unwrap();
        assert_eq!(checked(folder.path(), "a", right).unwrap(), file);
        let other = "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5";
        let error = checked(folder.path(), "a", other).unwrap_err().to_string();
        assert!(error.contains("a.whl") && error.contains(right) && error.contains(other), "{error}");
        let error = checked(folder.path(), "c", other).unwrap_err().to_string();
        assert!(error.contains("/c ") && error.contains("its SHA-256 is nothing"), "{error}");
    }
}
