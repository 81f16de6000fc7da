//! The DLLs for Windows, and their tests under Wine.
//!
//! Everything is built on Linux. rustc builds for MinGW and Windows 7 or later, and builds the standard library from its
//! sources as well: Wine 8 lacks functions that the usual targets `*-pc-windows-gnu` import. The compiler comes from Debian,
//! because rustup does not provide these older targets. The results stay in `target/xtask/windows/`.
//!
//! Files:
//!
//! - `files.rs`, `implib.rs`, `version.rs`, `relocations.rs`: building the DLL and the tool: import libraries, version
//!   resource, relocations
//! - `wine.rs`, `dotnet.rs`, `usb.rs`: running the tests: under Wine, on .NET Core, with boards on USB in a guest
//! - `bench.rs`: measures how long the DLLs take to load

pub mod bench;
pub mod dotnet;
mod files;
mod implib;
mod relocations;
pub mod usb;
mod version;
mod wine;

use std::path::{Path, PathBuf};
use std::process::Command;

pub use files::{DLL, MODULE};
pub use implib::{MINGW, MSVC};

use crate::error::Error;
use crate::needs::{
    CARGO_DEBIAN, CLANG, DEBOOTSTRAP, DOTNET_CORE, DOTNET_WINDOWS_X64, DOTNET_WINDOWS_X86, GCC, LLD_LINK, MCS,
    MINGW_X64, MINGW_X86, MONO, NPM, Need, PIP, PYTHON, QEMU, ROOT, RUSTC_DEBIAN, STRIP, UNZIP, WINE_X64, XZ,
};
use crate::project::Project;
use crate::{command, stage};

/// The programs that building the DLLs needs besides cargo.
pub const BUILD_NEEDS: &[Need] = &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64];

/// The programs that the tests of 64-bit programs need.
pub const NEEDS_X64: &[Need] = &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, CLANG, LLD_LINK, WINE_X64];
/// The programs that the tests of 32-bit programs need.
pub const NEEDS_X86: &[Need] = &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, CLANG, LLD_LINK, DEBOOTSTRAP, ROOT];

/// The programs that the tests of 64-bit .NET programs need. VB.NET programs are tested on Linux, too, so .NET Core for
/// Linux is one of them.
pub const NEEDS_DOTNET_X64: &[Need] = &[
    RUSTC_DEBIAN,
    CARGO_DEBIAN,
    MINGW_X86,
    MINGW_X64,
    WINE_X64,
    MCS,
    MONO,
    PYTHON,
    PIP,
    DOTNET_CORE,
    NPM,
    DOTNET_WINDOWS_X64,
];
/// The programs that the tests of 32-bit .NET programs need.
pub const NEEDS_DOTNET_X86: &[Need] = &[
    RUSTC_DEBIAN,
    CARGO_DEBIAN,
    MINGW_X86,
    MINGW_X64,
    DEBOOTSTRAP,
    ROOT,
    WINE_X64,
    MCS,
    NPM,
    DOTNET_WINDOWS_X64,
    DOTNET_WINDOWS_X86,
];

/// The programs that the tests with boards on USB need: they build 32-bit Windows programs, and boot a guest system that has
/// the boards.
pub const NEEDS_USB: &[Need] =
    &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, DEBOOTSTRAP, ROOT, QEMU, XZ, STRIP, GCC];

/// The programs that the benches need, for both widths and the guest system.
pub const NEEDS_BENCH: &[Need] =
    &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, WINE_X64, DEBOOTSTRAP, ROOT, QEMU, XZ, STRIP, GCC];

/// The group of tests that needs the DLLs and Wine.
const TESTS: &str = "windows";

/// The width of Windows programs: 32 or 64 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    X86,
    X64,
}

impl Width {
    pub const ALL: [Self; 2] = [Self::X86, Self::X64];

    /// The name of the width in folders and tests.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X86 => "x86",
            Self::X64 => "x64",
        }
    }

    /// Whether a test with this name may be for this width: the module of the other width (`x86::` or `x64::`) is not in the
    /// name.
    fn has(self, name: &str) -> bool {
        !Self::ALL.into_iter().any(|other| other != self && name.contains(&format!("{}::", other.name())))
    }

    /// The prefix of the names of MinGW's programs for this width.
    pub const fn mingw(self) -> &'static str {
        match self {
            Self::X86 => "i686-w64-mingw32",
            Self::X64 => "x86_64-w64-mingw32",
        }
    }

    /// rustc's target triple for this width.
    pub const fn target(self) -> &'static str {
        match self {
            Self::X86 => "i686-win7-windows-gnu",
            Self::X64 => "x86_64-win7-windows-gnu",
        }
    }
}

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the results: x86/ and x64/, each with the DLL, the tool and its import libraries, and include/ with the C
    /// headers [default: in the target folder]
    #[arg(long, value_name = "DIR")]
    prefix: Option<PathBuf>,
}

/// `cargo xtask windows`: builds the DLLs and their import libraries.
pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    crate::needs::require(project, BUILD_NEEDS)?;
    let prefix = arguments.prefix.clone().unwrap_or_else(|| staged(project));
    build_into(project, &prefix)?;
    println!("installed into {}", prefix.display());
    Ok(())
}

/// The folder for everything that is built for Windows.
pub fn folder(project: &Project) -> PathBuf {
    project.target.join("xtask/windows")
}

/// Builds the DLLs, import libraries, headers and tools into `x86/`, `x64/` and `include/` of the folder `prefix`.
pub fn build_into(project: &Project, prefix: &Path) -> Result<(), Error> {
    for width in Width::ALL {
        build_width(project, width, prefix)?;
    }
    Ok(())
}

/// Builds the module of the Python package for a width into the folder `place`; returns its path.
pub fn build_module(project: &Project, width: Width, place: &Path) -> Result<PathBuf, Error> {
    std::fs::create_dir_all(place).map_err(Error::file("make", place))?;
    MODULE.build(project, width, place)
}

/// Runs `program` of the zip file `zip` under 64-bit Wine; returns what it prints. Both are paths, that of the program is one
/// in the file.
pub fn run_from_zip(project: &Project, zip: &Path, program: &str, words: &[&str]) -> Result<String, Error> {
    let wine = wine::set_up(project, Width::X64)?;
    // An earlier run that has failed has left its files.
    wine.clear()?;
    command::output(Command::new(UNZIP.program).arg("-q").arg(zip).arg("-d").arg(wine.programs.join("unpacked")))?;
    let said = wine.output("unpacked", &[&[program], words].concat())?;
    wine.clear()?;
    Ok(said)
}

/// Puts a package of Windows' installer in place under Wine, runs the program `words` that PATH then finds, and removes the
/// package again; returns what the program prints.
///
/// # Errors
/// The package makes no `folder` under Program Files, or leaves it behind.
pub fn run_installed(
    project: &Project,
    width: Width,
    installer: &Path,
    folder: &str,
    words: &[&str],
) -> Result<String, Error> {
    let wine = wine::set_up(project, width)?;
    wine.clear()?;
    let place = wine.programs.join("installer");
    std::fs::create_dir_all(&place).map_err(Error::file("make", &place))?;
    std::fs::copy(installer, place.join("package.msi")).map_err(Error::file("copy", installer))?;
    let run = |words: &[&str]| wine.output("installer", words);
    // Both of Windows' folders for programs.
    let is_there = || {
        let listed = run(&["cmd.exe", "/c", "dir", "/b", r"C:\Program Files", r"C:\Program Files (x86)"])?;
        Ok::<_, Error>(listed.lines().any(|name| name == folder))
    };
    // A run that was interrupted has left its package.
    let _ = run(&["msiexec.exe", "/x", "package.msi", "/qn"]);
    run(&["msiexec.exe", "/i", "package.msi", "/qn"])?;
    let was_there = is_there()?;
    let said = run(words);
    run(&["msiexec.exe", "/x", "package.msi", "/qn"])?;
    let is_left = is_there()?;
    wine.clear()?;
    match (was_there, is_left) {
        (true, false) => said,
        (true, true) => Err(Error::Package(format!("{} leaves files behind", installer.display()))),
        (false, _) => Err(Error::Package(format!("{} installs no folder {folder}", installer.display()))),
    }
}

/// The folder into which [`build_into`] builds for the tests.
pub fn staged(project: &Project) -> PathBuf {
    folder(project).join("stage")
}

/// Sets up the Debian system in which Wine runs 32-bit programs, if that was not done before.
pub fn set_up_debian(project: &Project) -> Result<(), Error> {
    wine::set_up_debian(project).map(drop)
}

fn build_width(project: &Project, width: Width, prefix: &Path) -> Result<(), Error> {
    let place = prefix.join(width.name());
    std::fs::create_dir_all(&place).map_err(Error::file("make", &place))?;
    files::BUILT.iter().try_for_each(|file| file.build(project, width, &place).map(drop))?;
    implib::write(width, &place)?;
    stage::install_headers(project, &prefix.join("include"))
}

/// Whether `name` (the beginning of a test's name) selects tests of this width that run under Wine without .NET.
pub fn takes(width: Width, name: &str) -> bool {
    width.has(name) && !usb::takes(name) && !dotnet::is_of_it(name)
}

/// Runs the tests of a width: those whose names contain one of `names`, or all.
pub fn test(project: &Project, width: Width, names: &[String]) -> Result<(), Error> {
    let wine = wine::set_up(project, width)?;
    let prefix = staged(project);
    build_width(project, width, &prefix)?;
    let tool = stage::build_tool(project)?;
    run_tests(project, width, names, &[dotnet::MODULE], |cargo| {
        cargo.env("ECMSK_WINDOWS_STAGE", &prefix).env("ECMSK_WINDOWS_HOST_TOOL", &tool);
        cargo.env("ECMSK_WINE", &wine.script).env("ECMSK_WINE_PROGRAMS", &wine.programs);
    })?;
    wine.clear()
}

/// Runs the tests of a width whose names contain one of `names` and none of `but`. `tell` adds environment variables to the
/// cargo command, by which the tests find Wine and the built files.
fn run_tests(
    project: &Project,
    width: Width,
    names: &[String],
    but: &[&str],
    tell: impl FnOnce(&mut Command),
) -> Result<(), Error> {
    let others = Width::ALL.into_iter().filter(|other| *other != width).map(|other| format!("{}::", other.name()));
    let skipped: Vec<String> = others.chain(but.iter().map(|&name| name.to_owned())).collect();
    let tests = |how: &str| {
        let mut cargo = project.cargo_as_in_tests("test", TESTS, &["--", how]);
        cargo.args(skipped.iter().map(|name| format!("--skip={name}"))).args(names);
        cargo
    };
    let listed = command::output(&mut tests("--list"))?;
    // The tests are listed first: a filter that matches no test is an error and must not pass.
    if !String::from_utf8_lossy(&listed).lines().any(|line| line.ends_with(": test")) {
        return Err(Error::NoTest { names: names.join(" ") });
    }
    let mut cargo = tests("--quiet");
    tell(&mut cargo);
    command::run(&mut cargo)
}
