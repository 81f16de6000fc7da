//! The Debian packages: library, development files and tool. They are split as Debian splits a library: programs depend on the
//! library's package alone, and a later library with another binary interface can be installed beside this one.

mod control;
pub mod install;
mod lintian;
mod parts;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::machine::Machine;
use super::release::Release;
use super::tree::{DATA, Tree};
use crate::command;
use crate::error::Error;
use crate::project::Project;
use parts::Part;

pub use lintian::check as lintian;
pub use parts::DEVELOPMENT;

/// The Debian revision, which follows the version of the project in a package's version. \[OURS]
const REVISION: u32 = 1;

/// The lintian warning that all packages override: the changelog closes no bug report, which is required only of packages
/// that are uploaded to Debian.
const OVERRIDDEN: &str = "initial-upload-closes-no-bugs";
const OVERRIDDEN_BECAUSE: &str = "The package is not uploaded to Debian, and answers no request there.";

/// Builds all packages from the files in `stage` into `folder`; returns their paths.
pub fn build(
    project: &Project,
    release: &Release,
    machine: Machine,
    stage: &Path,
    others: &str,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    let version = format!("{}-{REVISION}", release.version);
    let mut packages = Vec::new();
    for part in parts::PARTS {
        let tree = Tree::new(super::folder(project).join("deb").join(machine.debian()).join(part.package))?;
        (part.fill)(project, machine, stage, &tree)?;
        documents(project, release, &version, part, others, &tree)?;
        let depends = depends(project, part, machine, &tree)?;
        control::write(part, machine, &version, depends.as_deref(), &tree)?;
        tree.set_time(release.epoch)?;
        let file = folder.join(format!("{}_{version}_{}.deb", part.package, machine.debian()));
        let mut dpkg = release.command("dpkg-deb");
        // dpkg-deb's own level is 6. The lowest level takes a tenth of the time, and makes larger packages, which only
        // tests use.
        let level = if project.quick { "-z0" } else { "-z6" };
        dpkg.args(["--root-owner-group", "-Zxz", level, "--threads-max=1", "--build"]).arg(tree.root()).arg(&file);
        command::output(&mut dpkg)?;
        packages.push(file);
    }
    Ok(packages)
}

/// Writes the documents that Debian requires in every package: changelogs and licences.
fn documents(
    project: &Project,
    release: &Release,
    version: &str,
    part: &Part,
    others: &str,
    tree: &Tree,
) -> Result<(), Error> {
    let folder = format!("usr/share/doc/{}", part.package);
    let changelog = format!(
        "ecmsk ({version}) unstable; urgency=medium\n\n  * Version {}: see changelog.gz.\n\n -- {}  {}\n",
        release.version,
        control::MAINTAINER,
        release.date("-R")?
    );
    tree.write(&format!("{folder}/changelog.Debian"), changelog)?;
    tree.copy(&project.root.join("CHANGELOG.md"), &format!("{folder}/changelog"), DATA)?;
    for name in ["changelog.Debian", "changelog"] {
        compress(release, &tree.at(&format!("{folder}/{name}")))?;
    }
    tree.write(&format!("{folder}/copyright"), control::copyright(project, release)?)?;
    let name = format!("{folder}/third-party-licenses");
    tree.write(&name, others)?;
    compress(release, &tree.at(&name))?;
    tree.write(
        &format!("usr/share/lintian/overrides/{}", part.package),
        format!("# {OVERRIDDEN_BECAUSE}\n{}: {OVERRIDDEN}\n", part.package),
    )
}

/// Compresses a file with gzip without storing its name and time, as Debian requires.
fn compress(release: &Release, file: &Path) -> Result<(), Error> {
    command::run(release.command("gzip").args(["--no-name", "--best", "--force", "--"]).arg(file))
}

/// The packages that this package's programs and libraries depend on, found by Debian's own tool; `None` if it has no program
/// or library.
fn depends(project: &Project, part: &Part, machine: Machine, tree: &Tree) -> Result<Option<String>, Error> {
    if part.programs.is_empty() {
        return Ok(None);
    }
    // dpkg-shlibdeps runs in a folder of Debian sources, but reads only its file `debian/control`.
    let sources = super::folder(project).join("deb/sources");
    let debian = sources.join("debian");
    fs::create_dir_all(&debian).map_err(Error::file("make", &debian))?;
    let control = debian.join("control");
    let text = format!("Source: ecmsk\n\nPackage: {}\nArchitecture: any\n", part.package);
    fs::write(&control, text).map_err(Error::file("write", &control))?;
    let mut ask = Command::new("dpkg-shlibdeps");
    ask.current_dir(&sources).env("LC_ALL", "C").env("DEB_HOST_ARCH", machine.debian()).arg("-O");
    ask.args(part.programs.iter().map(|program| tree.at(&parts::path(machine, program))));
    let said = String::from_utf8_lossy(&command::output(&mut ask)?).into_owned();
    let depends = said.lines().find_map(|line| line.strip_prefix("shlibs:Depends="));
    // For another machine than this one dpkg-shlibdeps finds the libraries of the cross compiler, whose packages are named
    // `libc6-arm64-cross`. On that machine the name is `libc6`.
    Ok(depends.map(|depends| depends.replace(&format!("-{}-cross", machine.debian()), "")))
}
