//! `cargo xtask dist`: makes the packages of a release. The builds are reproducible: the same sources, compilers and release
//! time give the same bytes in any folder.
//!
//! Files:
//!
//! - `release.rs`: the version, and the one time that all packed files get
//! - `machine.rs`, `foreign.rs`: the machines for which Linux packages are made, and the test of those for other machines than
//!   this one, in an emulator
//! - `linux.rs`, `tarball.rs`, `windows_zip.rs`, `msi.rs`, `wheel.rs`, `nuget.rs`, `deb/`: the packages: for any Linux, for
//!   Windows (two), for Python, for .NET, for Debian
//! - `first_axis.rs`: puts a package in place and moves an axis with it
//! - `tree.rs`, `archive.rs`: a folder with fixed modes and times, and its archive
//! - `crates.rs`, `licences.rs`, `sbom.rs`: the crates in each file, their licences, and the list of components (SBOM)
//! - `contents.rs`, `again.rs`: check the contents of the packages, and that a second build gives the same bytes

mod again;
mod archive;
mod contents;
mod crates;
mod deb;
mod first_axis;
mod foreign;
mod licences;
mod linux;
mod machine;
mod msi;
mod nuget;
mod release;
mod sbom;
mod tarball;
mod tree;
mod wheel;
mod windows_zip;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::needs::{
    CARGO_DEBIAN, DEBOOTSTRAP, DPKG_DEV, GCC_ARM64, GCC_ARMHF, LINTIAN, MCS, MINGW_X64, MINGW_X86, MONO, MSIBUILD,
    MSIEXTRACT, Need, QEMU_USER, ROOT, RUSTC_DEBIAN, STRIP, UNZIP, WINE_X64, WIXL, ZIP, joined,
};
use crate::project::Project;
use crate::python_packages::WHEELS;
use crate::stage::{SLEEP_PACKAGE, TOOL_PACKAGE};
use crate::windows::Width;
use crate::{command, debian_rust, dotnet, features, needs, windows};
use crates::{Crate, Known};
use machine::Machine;
pub use nuget::Native;
use release::Release;
use sbom::{Artefact, Runtime};
use tree::Tree;

/// The programs that making the packages for this machine and for Windows needs.
const NEEDS: &[Need] = &joined::<{ 13 + WHEELS.len() }>(&[
    &[
        RUSTC_DEBIAN,
        CARGO_DEBIAN,
        MINGW_X86,
        MINGW_X64,
        MCS,
        STRIP,
        WIXL,
        MSIBUILD,
        MSIEXTRACT,
        ZIP,
        UNZIP,
        DPKG_DEV,
        LINTIAN,
    ],
    WHEELS,
]);
/// The further programs that the packages for other machines need.
const FOREIGN_NEEDS: &[Need] = &[GCC_ARM64, GCC_ARMHF];
/// The further programs and rights that `--check` needs.
const CHECK_NEEDS: &[Need] = &[DEBOOTSTRAP, ROOT, MONO, WINE_X64, QEMU_USER];
/// The programs and rights that `cargo xtask test --all` needs to make packages for this machine and for Windows, to install
/// them in a Debian system, and to run them under Wine.
pub const TEST_NEEDS: &[Need] = &joined::<{ NEEDS.len() + 4 }>(&[NEEDS, &[DEBOOTSTRAP, ROOT, MONO, WINE_X64]]);

/// The runtime identifier of .NET for this machine.
pub const RID_HERE: &str = if cfg!(target_arch = "aarch64") { "linux-arm64" } else { "linux-x64" };

/// The file with the checksums of all other files of the release.
const SUMS: &str = "SHA256SUMS";

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the packages, created if it does not exist [default: dist]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Put each package in place and move an axis with it, too, and make everything a second time in another folder: the
    /// bytes have to be the same
    #[arg(long)]
    check: bool,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    needs::require(project, &[NEEDS, FOREIGN_NEEDS, if arguments.check { CHECK_NEEDS } else { &[] }].concat())?;
    let out = arguments.out.clone().unwrap_or_else(|| project.root.join("dist"));
    let out = std::path::absolute(&out).map_err(Error::file("find", &out))?;
    let release = Release::find(project)?;
    let made = make(project, &release, &out)?;
    judge(project, &release, &made)?;
    if arguments.check {
        test_packages(project, &release, &made)?;
        compile_crates(project)?;
        again::compare(project, &release, &made)?;
    }
    for name in &made.names {
        println!("{}", out.join(name).display());
    }
    Ok(())
}

/// Makes all packages once, checks them, and puts them in place. For `cargo xtask test`.
pub fn test(project: &Project) -> Result<(), Error> {
    let release = Release::find(project)?;
    let made = make(project, &release, &folder(project).join("packages"))?;
    judge(project, &release, &made)?;
    test_packages(project, &release, &made)
}

/// Puts the packages in place as their users do, moves an axis with each, and runs those for other machines in an emulator.
fn test_packages(project: &Project, release: &Release, made: &Made) -> Result<(), Error> {
    let place = folder(project).join("in-place");
    if place.exists() {
        fs::remove_dir_all(&place).map_err(Error::file("remove", &place))?;
    }
    for packages in &made.linux {
        if let Some(emulator) = packages.machine.emulator() {
            foreign::test(project, packages, emulator, release.version)?;
            continue;
        }
        first_axis::of_the_tarball(&made.folder.join(&packages.tar), &place)?;
        wheel::first_axis(project, &packages.wheel, &place.join("environment"))?;
        deb::install::test(project, &packages.debs, release.version)?;
    }
    let package = made.folder.join(format!("Ecmsk.{}.nupkg", release.version));
    nuget::first_axis(project, &package, &place.join("nuget"))?;
    let program = format!("ecmsk-{}-windows/x64/ecmsk.exe", release.version);
    first_axis::timed("the zip file under Wine", first_axis::MOVED, || {
        windows::run_from_zip(project, &made.zip, &program, &first_axis::MOVE)
    })?;
    made.installers.iter().try_for_each(|(width, installer)| msi::first_axis(project, *width, installer))
}

/// The packages that are published as crates, in an order that works.
const PUBLISHED: [&str; 2] = ["ecmsk", TOOL_PACKAGE];

/// Packs the crates as for crates.io, and compiles them from what is packed; publishes nothing.
fn compile_crates(project: &Project) -> Result<(), Error> {
    let mut cargo = project.cargo();
    cargo.args(["publish", "--dry-run", "--locked", "--allow-dirty"]);
    command::run(cargo.args(PUBLISHED.iter().flat_map(|package| ["--package", package])))
}

/// Builds the library and the tool that the Linux packages for this machine contain.
pub fn build_for_linux(project: &Project) -> Result<(), Error> {
    build_for(project, &Release::find(project)?, Machine::Amd64).map(drop)
}

/// Builds what the Linux packages for a machine contain; returns the folder in which it is installed. [`Machine::Amd64`] has to
/// be built first, because its tool writes the manual pages.
fn build_for(project: &Project, release: &Release, machine: Machine) -> Result<PathBuf, Error> {
    let stage = |machine: Machine| folder(project).join("linux").join(machine.debian());
    let tool = machine.is_foreign().then(|| stage(Machine::Amd64).join("bin/ecmsk"));
    linux::build_into(project, release, machine, tool.as_deref(), &stage(machine))?;
    Ok(stage(machine))
}

/// Sets up the Debian system in which the packages are installed, if that was not done before.
pub fn set_up_debian(project: &Project) -> Result<(), Error> {
    deb::install::set_up_debian(project).map(drop)
}

/// What [`make`] has made: the packages of a release, its bill of materials and its checksums.
struct Made {
    folder: PathBuf,
    /// The names of all files for a release, [`SUMS`] last.
    names: Vec<String>,
    /// The path of the package for Windows.
    zip: PathBuf,
    /// The paths of the packages for Windows' installer.
    installers: Vec<(Width, PathBuf)>,
    /// The paths of the wheels for Windows; a quick build has none.
    on_windows: Vec<PathBuf>,
    linux: Vec<ForLinux>,
}

/// The packages for Linux on one machine.
struct ForLinux {
    machine: Machine,
    /// The file name of the `.tar.gz` package.
    tar: String,
    /// The path of the wheel.
    wheel: PathBuf,
    /// The paths of the Debian packages.
    debs: Vec<PathBuf>,
    /// The folder that is packed as `.tar.gz`.
    tree: Tree,
}

/// The folder in which the contents of packages are put together.
fn folder(project: &Project) -> PathBuf {
    project.target.join("xtask/dist")
}

/// Makes all packages in `out`.
fn make(project: &Project, release: &Release, out: &Path) -> Result<Made, Error> {
    fs::create_dir_all(out).map_err(Error::file("make", out))?;
    let work = folder(project);
    let known = Known::find(project)?;
    let mut linux = Vec::new();
    for &machine in Machine::made(project) {
        linux.push(make_for_linux(project, release, &known, machine, out)?);
    }
    let windows = work.join("windows");
    windows::build_into(project, &windows)?;
    let assemblies = dotnet::compile_into(project, &work.join("dotnet"))?;
    let mut on_windows = Vec::new();
    for width in Width::ALL {
        on_windows = both(on_windows, known.linked(project, "NEXTWUSBLib", triple(width))?);
        on_windows = both(on_windows, known.linked(project, TOOL_PACKAGE, triple(width))?);
    }
    let on_windows = licences::text(&on_windows)?;
    let tree = Tree::new(work.join("zip").join(format!("ecmsk-{}-windows", release.version)))?;
    windows_zip::fill(project, release, &tree, &windows, &assemblies, &on_windows)?;

    let mut names = vec![format!("ecmsk-{}-windows.zip", release.version)];
    let zip = out.join(&names[0]);
    archive::zip(release, project.archive_level(), &tree, &zip)?;
    let mut installers = Vec::new();
    for width in Width::ALL {
        installers.push((width, msi::make(release, &tree, width, &work.join("msi"), out)?));
    }
    let mut in_dotnet = Vec::new();
    let machines = linux.iter().map(|packages| packages.machine).filter(|machine| machine.rid().is_some());
    for triple in Width::ALL.map(triple).into_iter().chain(machines.map(Machine::target)) {
        in_dotnet = both(in_dotnet, known.linked(project, "NEXTWUSBLib", triple)?);
    }
    let in_dotnet = licences::text(&in_dotnet)?;
    let natives = natives(&linux, &windows);
    names.extend(nuget::make(project, release, &assemblies, &natives, &in_dotnet, &work.join("nuget"), out)?);
    let modules = if project.quick { Vec::new() } else { modules_for_windows(project)? };
    let mut wheels = Vec::new();
    for (width, module) in &modules {
        wheels.push(wheel_for_windows(project, release, &known, *width, module, out)?);
    }
    let name_of = |path: &PathBuf| Some(path.file_name()?.to_string_lossy().into_owned());
    names.extend(installers.iter().map(|(_, installer)| installer).chain(&wheels).filter_map(name_of));
    for packages in &linux {
        names.push(packages.tar.clone());
        names.extend([&packages.wheel].into_iter().chain(&packages.debs).filter_map(name_of));
    }
    let list = format!("ecmsk-{}.cdx.json", release.version);
    let mut artefacts = artefacts(project, &known, &linux, &tree, &modules)?;
    artefacts.push(Artefact {
        name: "Ecmsk.dll".to_owned(),
        kind: "library",
        file: assemblies.ecmsk.join("Ecmsk.dll"),
        crates: Vec::new(),
        runtimes: Vec::new(),
    });
    let text = sbom::text(release, &artefacts)?;
    fs::write(out.join(&list), text).map_err(Error::file("write", out))?;
    names.push(list);
    features::write_into(project, out)?;
    names.extend(features::FILES.map(str::to_owned));
    let sums = archive::sums(out, &names)?;
    fs::write(out.join(SUMS), sums).map_err(Error::file("write", out))?;
    names.push(SUMS.to_owned());
    Ok(Made { folder: out.to_owned(), names, zip, installers, on_windows: wheels, linux })
}

/// Builds the modules of the Python package for Windows.
fn modules_for_windows(project: &Project) -> Result<Vec<(Width, PathBuf)>, Error> {
    let place = folder(project).join("modules");
    let built = |width: Width| Ok((width, windows::build_module(project, width, &place.join(width.name()))?));
    Width::ALL.into_iter().map(built).collect()
}

/// Makes the wheel of a module for Windows; returns its path.
fn wheel_for_windows(
    project: &Project,
    release: &Release,
    known: &Known,
    width: Width,
    module: &Path,
    out: &Path,
) -> Result<PathBuf, Error> {
    let tag = match width {
        Width::X86 => "win32",
        Width::X64 => "win_amd64",
    };
    let platform = wheel::Platform { tag, module: wheel::ON_WINDOWS };
    let others = licences::text(&known.linked(project, wheel::PACKAGE, triple(width))?)?;
    wheel::make(project, release, &platform, module, &others, &folder(project).join("wheels"), out)
}

/// Makes the NuGet packages in a folder of `out`, which is returned, with these native libraries alone: for tests.
pub fn nuget_packages(
    project: &Project,
    compiled: &dotnet::Compiled,
    natives: &[Native],
    out: &Path,
) -> Result<PathBuf, Error> {
    let quick = Project { quick: true, ..project.clone() };
    let others = "See THIRD-PARTY-LICENSES.txt in the packages of a release.\n";
    let packages = out.join("nuget");
    let release = Release::find(project)?;
    nuget::make(&quick, &release, compiled, natives, others, &out.join("nuget-trees"), &packages)?;
    Ok(packages)
}

/// The native libraries of the NuGet packages, from the folders in which the others were put together.
fn natives(linux: &[ForLinux], windows: &Path) -> Vec<Native> {
    let mut natives = Vec::new();
    for (rid, width) in [("win-x86", Width::X86), ("win-x64", Width::X64)] {
        natives.push(Native { rid, file: windows.join(width.name()).join(windows::DLL) });
    }
    for ForLinux { machine, tree, .. } in linux {
        natives.extend(machine.rid().map(|rid| Native { rid, file: tree.at("lib/libNEXTWUSBLib.so.0") }));
    }
    natives
}

/// Makes the Linux packages for a machine in `out`.
fn make_for_linux(
    project: &Project,
    release: &Release,
    known: &Known,
    machine: Machine,
    out: &Path,
) -> Result<ForLinux, Error> {
    let stage = build_for(project, release, machine)?;
    let linked = |package| known.linked(project, package, machine.target());
    let others = licences::text(&both(linked("NEXTWUSBLib")?, linked(TOOL_PACKAGE)?))?;
    let name = format!("ecmsk-{}-{}-linux", release.version, machine.processor());
    let tree = Tree::new(folder(project).join("tar").join(&name))?;
    tarball::fill(project, release, machine, &tree, &stage, &others)?;
    let tar = format!("{name}.tar.gz");
    archive::tar(release, project.archive_level(), &tree, &out.join(&tar))?;
    let debs = deb::build(project, release, machine, &stage, &others, out)?;
    let module = linux::module(project, machine);
    let platform = wheel::Platform { tag: machine.wheel(), module: wheel::ON_LINUX };
    let others = licences::text(&linked(wheel::PACKAGE)?)?;
    let wheel = wheel::make(project, release, &platform, &module, &others, &folder(project).join("wheels"), out)?;
    Ok(ForLinux { machine, tar, wheel, debs, tree })
}

/// Checks the packages that were made: their contents, checksums and, for Debian packages, lintian.
fn judge(project: &Project, release: &Release, made: &Made) -> Result<(), Error> {
    command::output(
        Command::new("sha256sum").current_dir(&made.folder).args(["--check", "--strict", "--quiet", SUMS]),
    )?;
    contents::check(project, release, made)?;
    let mut wheels = made.linux.iter().map(|packages| &packages.wheel).chain(&made.on_windows);
    wheels.try_for_each(|file| wheel::judge(project, file))?;
    // lintian reads the symbols of all objects in the static library, which takes minutes if they are little optimised. So
    // a quick build leaves out the package that has it.
    let has_archive = |deb: &&PathBuf| deb.to_string_lossy().contains(deb::DEVELOPMENT);
    let debs = made.linux.iter().flat_map(|packages| &packages.debs);
    let (with, without): (Vec<&PathBuf>, Vec<&PathBuf>) = debs.partition(has_archive);
    deb::lintian(&without)?;
    if project.quick { Ok(()) } else { deb::lintian(&with) }
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
fn artefacts(
    project: &Project,
    known: &Known,
    linux: &[ForLinux],
    zip: &Tree,
    modules: &[(Width, PathBuf)],
) -> Result<Vec<Artefact>, Error> {
    let mut found = Vec::new();
    let std = |rustc: &str| Ok::<_, Error>(Runtime::rust(version_of(Command::new(rustc).current_dir(&project.root))?));
    let debians = std(debian_rust::RUSTC)?;
    let files = [
        ("bin/ecmsk", TOOL_PACKAGE),
        ("lib/libNEXTWUSBLib.so.0", "NEXTWUSBLib"),
        ("lib/libNEXTWUSBLib.a", "NEXTWUSBLib"),
        ("lib/ecmsk/libecmsk_sleep.so", SLEEP_PACKAGE),
    ];
    for ForLinux { machine, tree, .. } in linux {
        for (file, package) in files {
            found.push(Artefact {
                name: format!("linux-{}/{file}", machine.debian()),
                kind: if package == TOOL_PACKAGE { "application" } else { "library" },
                file: tree.at(file),
                crates: known.linked(project, package, machine.target())?,
                runtimes: [std(machine.rustc())?]
                    .into_iter()
                    .chain(Runtime::of_the_tool(package == TOOL_PACKAGE))
                    .collect(),
            });
        }
        found.push(Artefact {
            name: format!("linux-{}/{}", machine.debian(), wheel::ON_LINUX),
            kind: "library",
            file: linux::module(project, *machine),
            crates: known.linked(project, wheel::PACKAGE, machine.target())?,
            runtimes: vec![std(machine.rustc())?],
        });
    }
    for (width, module) in modules {
        found.push(Artefact {
            name: format!("windows/{}/{}", width.name(), wheel::ON_WINDOWS),
            kind: "library",
            file: module.clone(),
            crates: known.linked(project, wheel::PACKAGE, triple(*width))?,
            runtimes: [debians.clone()].into_iter().chain(Runtime::mingw(*width)?).collect(),
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

/// The version of a program: the second word that `--version` prints, as in `rustc 1.85.0`.
fn version_of(program: &mut Command) -> Result<String, Error> {
    let said = command::output(program.arg("--version"))?;
    Ok(String::from_utf8_lossy(&said).split_whitespace().nth(1).unwrap_or_default().to_owned())
}
