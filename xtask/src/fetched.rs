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
    fn fetch(&self, project: &Project) -> Result<(), Error> {
        println!("fetching with {}: {} {} ({})", self.index.need().program, self.name, self.version, self.cost);
        let fetched = empty(self.folder(project).with_extension("fetched"))?;
        match self.index {
            Index::Pip => wheel::download(&[self], &fetched),
            Index::PipSources => wheel::download_sources(self, &fetched),
            Index::Npm { .. } => npm::download(self, &fetched),
        }?;
        self.unpack(project, &sums(&fetched)?)?;
        remove(&fetched)
    }

    /// Unpacks the archive of the package, which is one of these files.
    fn unpack(&self, project: &Project, fetched: &[Sum]) -> Result<(), Error> {
        let folder = self.folder(project);
        remove(&folder)?;
        let unpacked = empty(folder.with_extension("unpacking"))?;
        let archive = checked(fetched, self)?;
        match self.index {
            Index::Pip => wheel::unpack(self, &archive, &unpacked),
            Index::PipSources => wheel::unpack_sources(&archive, &unpacked),
            Index::Npm { parts } => npm::unpack(parts, &archive, &unpacked),
        }?;
        // The folder gets its final name last, so that a folder of that name is complete.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }
}

/// Fetches packages, checks them and unpacks them. Of those that cannot be had the errors are printed; the others are there.
pub fn fetch(project: &Project, packages: &[&Fetched]) {
    let wheels: Vec<&Fetched> = packages.iter().copied().filter(|package| package.index == Index::Pip).collect();
    let done = if wheels.len() > 1 { fetch_wheels(project, &wheels) } else { Ok(()) };
    if let Err(error) = done {
        println!("{error}");
    }
    for package in packages.iter().filter(|package| !package.is_there(project)) {
        if let Err(error) = package.fetch(project) {
            println!("{error}");
        }
    }
}

/// Fetches wheels with one call of pip, which takes longer to start than most of them to come.
fn fetch_wheels(project: &Project, wheels: &[&Fetched]) -> Result<(), Error> {
    for Fetched { name, version, cost, .. } in wheels {
        println!("fetching with {}: {name} {version} ({cost})", PIP.program);
    }
    let fetched = empty(project.target.join("xtask/wheels.fetched"))?;
    wheel::download(wheels, &fetched)?;
    let sums = sums(&fetched)?;
    wheels.iter().try_for_each(|wheel| wheel.unpack(project, &sums))?;
    remove(&fetched)
}

/// Makes the folder, without anything in it.
fn empty(folder: PathBuf) -> Result<PathBuf, Error> {
    remove(&folder)?;
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
    Ok(folder)
}

/// A file and its SHA-256.
struct Sum {
    file: PathBuf,
    sha256: String,
}

/// The files in a folder.
fn sums(folder: &Path) -> Result<Vec<Sum>, Error> {
    let files = fs::read_dir(folder).map_err(Error::file("list", folder))?.flatten().map(|entry| entry.path());
    let sum = |file: PathBuf| {
        let said = command::output(Command::new("sha256sum").arg("--").arg(&file))?;
        let sha256 = String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned();
        Ok(Sum { file, sha256 })
    };
    files.map(sum).collect()
}

/// The file with the checksum of the package.
///
/// # Errors
/// No file has it; the error names the one that has the name of the package.
fn checked(fetched: &[Sum], package: &Fetched) -> Result<PathBuf, Error> {
    if let Some(right) = fetched.iter().find(|sum| sum.sha256 == package.sha256) {
        return Ok(right.file.clone());
    }
    let begin = format!("{}-", package.name);
    let is_named = |sum: &&Sum| sum.file.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&begin));
    let (file, found) = match fetched.iter().find(is_named) {
        Some(other) => (other.file.clone(), other.sha256.clone()),
        None => (package.name.into(), "nothing".to_owned()),
    };
    Err(Error::Fetched { file, expected: package.sha256, found })
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
        let file = folder.path().join("a-1.whl");
        fs::write(&file, "a\n").unwrap();
        fs::write(folder.path().join("a_b-1.whl"), "b\n").unwrap();
        let right = "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7";
        let package = |name, sha256| Fetched { index: Index::Pip, name, version: "1", sha256, program: "a", cost: "" };
        let sums = sums(folder.path()).unwrap();
        assert_eq!(checked(&sums, &package("a", right)).unwrap(), file);
        let other = "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5";
        let error = checked(&sums, &package("a", other)).unwrap_err().to_string();
        assert!(error.contains("a-1.whl") && error.contains(right) && error.contains(other), "{error}");
        let error = checked(&sums, &package("c", other)).unwrap_err().to_string();
        assert!(error.starts_with("c is not") && error.contains("its SHA-256 is nothing"), "{error}");
    }
}
