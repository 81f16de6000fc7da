//! `cargo xtask dist`: makes the packages of a release. The builds are reproducible: the same sources, compilers and release
//! time give the same bytes in any folder.
//!
//! Files:
//!
//! - `release.rs`: the version, and the one time that all packed files get
//! - `linux.rs`, `tarball.rs`, `windows_zip.rs`, `deb/`: the packages: for any Linux, for Windows, for Debian
//! - `tree.rs`, `archive.rs`: a folder with fixed modes and times, and its archive
//! - `crates.rs`, `licences.rs`, `sbom.rs`: the crates in each file, their licences, and the list of components (SBOM)
//! - `contents.rs`, `again.rs`: check the contents of the packages, and that a second build gives the same bytes

mod again;
mod archive;
mod contents;
mod crates;
mod deb;
mod licences;
mod linux;
mod release;
mod sbom;
mod tarball;
mod tree;
mod windows_zip;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::needs::{
    CARGO_DEBIAN, DEBOOTSTRAP, DPKG_DEV, LINTIAN, MCS, MINGW_X64, MINGW_X86, Need, ROOT, RUSTC_DEBIAN, STRIP, UNZIP,
    ZIP,
};
use crate::project::Project;
use crate::stage::TOOL_PACKAGE;
use crate::windows::Width;
use crate::{command, dotnet, features, needs, windows};
use crates::{Crate, Known};
use release::Release;
use sbom::{Artefact, Runtime};
use tree::Tree;

/// The programs that making the packages needs.
const NEEDS: &[Need] = &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, MCS, STRIP, ZIP, UNZIP, DPKG_DEV, LINTIAN];
/// The programs and rights that testing the packages needs. Beside those for making them these are for a Debian system to
/// install them in.
pub const TEST_NEEDS: &[Need] =
    &[RUSTC_DEBIAN, CARGO_DEBIAN, MINGW_X86, MINGW_X64, MCS, STRIP, ZIP, UNZIP, DPKG_DEV, LINTIAN, DEBOOTSTRAP, ROOT];

/// rustc's target triple for the Linux packages.
const LINUX: &str = "x86_64-unknown-linux-gnu";
/// The file with the checksums of all other files.
const SUMS: &str = "SHA256SUMS";

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the packages, created if it does not exist [default: dist]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Install the Debian packages in a fresh system, too, and make everything a second time in another folder: the bytes have
    /// to be the same
    #[arg(long)]
    check: bool,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    needs::require(project, if arguments.check { TEST_NEEDS } else { NEEDS })?;
    let out = arguments.out.clone().unwrap_or_else(|| project.root.join("dist"));
    let out = std::path::absolute(&out).map_err(Error::file("find", &out))?;
    let release = Release::find(project)?;
    let made = make(project, &release, &out)?;
    judge(project, &release, &made)?;
    if arguments.check {
        deb::install::test(project, &made.debs, release.version)?;
        again::compare(project, &release, &made)?;
    }
    for name in &made.names {
        println!("{}", out.join(name).display());
    }
    Ok(())
}

/// For `cargo xtask test`: makes the packages once, and installs them.
pub fn test(project: &Project) -> Result<(), Error> {
    let release = Release::find(project)?;
    let made = make(project, &release, &folder(project).join("packages"))?;
    judge(project, &release, &made)?;
    deb::install::test(project, &made.debs, release.version)
}

/// The packages and other files that [`make`] has made.
struct Made {
    folder: PathBuf,
    /// The names of all files for a release, [`SUMS`] last.
    names: Vec<String>,
    debs: Vec<PathBuf>,
}

/// The folder in which the contents of packages are put together.
fn folder(project: &Project) -> PathBuf {
    project.target.join("xtask/dist")
}

/// Makes all packages in `out`.
fn make(project: &Project, release: &Release, out: &Path) -> Result<Made, Error> {
    fs::create_dir_all(out).map_err(Error::file("make", out))?;
    let work = folder(project);
    let stage = work.join("linux");
    linux::build_into(project, release, &stage)?;
    let windows = work.join("windows");
    windows::build_into(project, &windows)?;
    let assemblies = dotnet::compile_into(project, &work.join("dotnet"))?;

    let known = Known::find(project)?;
    let on_linux = both(known.linked(project, "NEXTWUSBLib", LINUX)?, known.linked(project, TOOL_PACKAGE, LINUX)?);
    let on_linux = licences::text(&on_linux)?;
    let mut on_windows = Vec::new();
    for width in Width::ALL {
        on_windows = both(on_windows, known.linked(project, "NEXTWUSBLib", triple(width))?);
        on_windows = both(on_windows, known.linked(project, TOOL_PACKAGE, triple(width))?);
    }
    let on_windows = licences::text(&on_windows)?;

    let tar = Tree::new(work.join("tar").join(format!("ecmsk-{}-x86_64-linux", release.version)))?;
    tarball::fill(project, release, &tar, &stage, &on_linux)?;
    let zip = Tree::new(work.join("zip").join(format!("ecmsk-{}-windows", release.version)))?;
    windows_zip::fill(project, release, &zip, &windows, &assemblies, &on_windows)?;

    let mut names = vec![
        format!("ecmsk-{}-windows.zip", release.version),
        format!("ecmsk-{}-x86_64-linux.tar.gz", release.version),
    ];
    archive::zip(release, &zip, &out.join(&names[0]))?;
    archive::tar(release, &tar, &out.join(&names[1]))?;
    let debs = deb::build(project, release, &stage, &on_linux, out)?;
    names.extend(debs.iter().filter_map(|deb| Some(deb.file_name()?.to_string_lossy().into_owned())));
    let list = format!("ecmsk-{}.cdx.json", release.version);
    let text = sbom::text(release, &artefacts(project, &known, &tar, &zip)?)?;
    fs::write(out.join(&list), text).map_err(Error::file("write", out))?;
    names.push(list);
    features::write_into(project, out)?;
    names.extend(features::FILES.map(str::to_owned));
    let sums = archive::sums(out, &names)?;
    fs::write(out.join(SUMS), sums).map_err(Error::file("write", out))?;
    names.push(SUMS.to_owned());
    Ok(Made { folder: out.to_owned(), names, debs })
}

/// Checks the packages that were made: their contents, checksums and, for Debian packages, lintian.
fn judge(project: &Project, release: &Release, made: &Made) -> Result<(), Error> {
    command::output(
        Command::new("sha256sum").current_dir(&made.folder).args(["--check", "--strict", "--quiet", SUMS]),
    )?;
    contents::check(project, release, made)?;
    deb::lintian(&made.debs)
}

fn both(some: Vec<Crate>, others: Vec<Crate>) -> Vec<Crate> {
    let mut all = some;
    all.extend(others);
    all.sort();
    all.dedup();
    all
}

/// The target triple with which cargo lists the linked crates of the Windows files. The real triples of the DLLs link the same
/// crates, but need another compiler.
fn triple(width: Width) -> &'static str {
    match width {
        Width::X86 => "i686-pc-windows-gnu",
        Width::X64 => "x86_64-pc-windows-gnu",
    }
}

/// The shipped libraries and programs, each with its crates, for the list of components.
fn artefacts(project: &Project, known: &Known, tar: &Tree, zip: &Tree) -> Result<Vec<Artefact>, Error> {
    let mut found = Vec::new();
    let std = |rustc: &str| Ok::<_, Error>(Runtime::rust(version_of(Command::new(rustc).current_dir(&project.root))?));
    let (here, debians) = (std("rustc")?, std(windows::RUSTC)?);
    let files = [
        ("bin/ecmsk", TOOL_PACKAGE),
        ("lib/libNEXTWUSBLib.so.0", "NEXTWUSBLib"),
        ("lib/libNEXTWUSBLib.a", "NEXTWUSBLib"),
    ];
    for (file, package) in files {
        found.push(Artefact {
            name: format!("linux/{file}"),
            kind: if package == TOOL_PACKAGE { "application" } else { "library" },
            file: tar.at(file),
            crates: known.linked(project, package, LINUX)?,
            runtimes: [here.clone()].into_iter().chain(Runtime::of_the_tool(package == TOOL_PACKAGE)).collect(),
        });
    }
    for width in Width::ALL {
        let mingw = Runtime::mingw(width)?;
        let of_the_width = |program: &&&str| program.starts_with(width.name());
        let programs =
            windows_zip::PROGRAMS.iter().filter(of_the_width).map(|&program| (program.to_owned(), TOOL_PACKAGE));
        let dll = (format!("{}/{}", width.name(), windows::DLL), "NEXTWUSBLib");
        for (file, package) in programs.chain([dll]) {
            found.push(Artefact {
                kind: if package == TOOL_PACKAGE { "application" } else { "library" },
                file: zip.at(&file),
                name: format!("windows/{file}"),
                crates: known.linked(project, package, triple(width))?,
                runtimes: [debians.clone()]
                    .into_iter()
                    .chain(mingw.clone())
                    .chain(Runtime::of_the_tool(package == TOOL_PACKAGE))
                    .collect(),
            });
        }
    }
    let is_assembly = |file: &Path| {
        let begins = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("NEXTWUSB_dotNET"));
        begins && file.extension().is_some_and(|extension| extension == "dll")
    };
    for file in zip.files()?.iter().filter(|file| is_assembly(file)) {
        found.push(Artefact {
            name: format!("windows/{}", file.display()),
            kind: "library",
            file: zip.root().join(file),
            crates: Vec::new(),
            runtimes: Vec::new(),
        });
    }
    Ok(found)
}

/// The second word of a program's `--version`.
fn version_of(program: &mut Command) -> Result<String, Error> {
    let said = command::output(program.arg("--version"))?;
    Ok(String::from_utf8_lossy(&said).split_whitespace().nth(1).unwrap_or_default().to_owned())
}
