//! `cargo xtask release VERSION`: gives everything the version, commits that, and makes all files of the release, twice to the
//! same bytes. The tag is left to the person: `.github/workflows/release.yml` publishes what has one.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::project::Project;
use crate::semver;

/// The version as it stands in the sources.
const PRESENT: &str = env!("CARGO_PKG_VERSION");
/// The files that name the version of the project, besides the changelog and the lock files.
const FILES: &[&str] =
    &["Cargo.toml", "docs/PYTHON.md", "docs/TOOL-NETWORK.md", "dotnet/Ecmsk/Assembly.cs", "tool/Cargo.toml"];
/// The lock files, in which the packages of the project have their versions.
const LOCKS: &[&str] = &["Cargo.lock", "fuzz/Cargo.lock", "examples/firmware/Cargo.lock"];
const CHANGELOG: &str = "CHANGELOG.md";
/// The folder with the facts of the C library's surface at each version.
const SURFACE: &str = "tests/capi/surface";
/// The heading in the changelog below which changes are noted.
const UNRELEASED: &str = "## [Unreleased]\n";

#[derive(clap::Args)]
pub struct Arguments {
    /// The version, such as 0.2.0
    #[arg(value_parser = parse)]
    version: Version,
    /// Folder for the files, created if it does not exist
    #[arg(long, value_name = "DIR", default_value = "dist")]
    out: PathBuf,
}

/// A version: major, minor, patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Version([u32; 3]);

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self([major, minor, patch]) = self;
        write!(f, "{major}.{minor}.{patch}")
    }
}

fn parse(text: &str) -> Result<Version, String> {
    let numbers = text.split('.').map(str::parse).collect::<Result<Vec<u32>, _>>().ok();
    let version = numbers.and_then(|numbers| numbers.try_into().ok()).map(Version);
    version.filter(|version| version.to_string() == text).ok_or_else(|| "three numbers are expected: 0.2.0".to_owned())
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    let Arguments { version, out } = arguments;
    let git = |words: &[&str]| command::output(project.program("git").args(words));
    if !git(&["status", "--porcelain"])?.is_empty() {
        return Err(Error::Release("there are changes that are not committed; commit them first".to_owned()));
    }
    let tag = format!("v{version}");
    if !git(&["tag", "--list", &tag])?.is_empty() {
        return Err(Error::Release(format!("there is a release {version}: the tag {tag}; name a later version")));
    }
    let day = command::output(Command::new("date").args(["-u", "+%F"]))?;
    let out = std::path::absolute(out).map_err(Error::file("find", out))?;
    // An earlier run may have committed the version and failed later.
    if !is_written(&project.root, *version)? {
        let written = write(&project.root, *version, String::from_utf8_lossy(&day).trim())
            .and_then(|()| facts(project, *version))
            .and_then(|()| match semver::run(project) {
                Err(Error::NoRelease) => Ok(()),
                compared => compared,
            })
            .and_then(|()| git(&["add", "--all"]))
            .and_then(|_| git(&["commit", "--quiet", "--message", &format!("Release {version}")]));
        if written.is_err() {
            println!("taking the version back; nothing else was changed");
            git(&["reset", "--quiet", "--hard"])?;
            git(&["clean", "--quiet", "--force", SURFACE])?;
        }
        written?;
    }
    // Another process: this one has the version before in it.
    let mut dist = project.cargo();
    command::run(dist.args(["xtask", "dist", "--check", "--out"]).arg(&out))?;
    println!(
        "all is in {}; publish it with:\n    git tag --annotate {tag} && git push origin HEAD {tag}",
        out.display()
    );
    Ok(())
}

/// Whether the changelog has this version.
fn is_written(root: &Path, version: Version) -> Result<bool, Error> {
    let changes = root.join(CHANGELOG);
    let text = fs::read_to_string(&changes).map_err(Error::file("read", &changes))?;
    Ok(text.contains(&format!("\n## [{version}] - ")))
}

/// Writes the facts of the C library's surface at this version.
fn facts(project: &Project, version: Version) -> Result<(), Error> {
    let mut cargo = project.cargo();
    cargo.env("ECMSK_BLESS", "1").args(["test", "--quiet", "--workspace", "--test=capi", "the_surface_stays"]);
    command::run(&mut cargo)?;
    let file = project.root.join(SURFACE).join(format!("{version}.txt"));
    match file.is_file() {
        true => Ok(()),
        false => Err(Error::Release(format!("no test has written {}; see tests/capi/surface.rs", file.display()))),
    }
}

/// Writes the version and the day into the sources below `root`.
///
/// # Errors
/// The version is not later than the present one, or nothing has changed since that. The first release has the version that
/// stands there.
fn write(root: &Path, version: Version, day: &str) -> Result<(), Error> {
    let read = |file: &str| fs::read_to_string(root.join(file)).map_err(Error::file("read", &root.join(file)));
    let put =
        |file: &str, text: String| fs::write(root.join(file), text).map_err(Error::file("write", &root.join(file)));
    let changes = read(CHANGELOG)?;
    let is_first = !changes.contains("\n## [0") && !changes.contains("\n## [1");
    let present = parse(PRESENT).map_err(Error::Release)?;
    if version < present || (version == present && !is_first) {
        return Err(Error::Release(format!("{version} is not later than {PRESENT}; name a later version")));
    }
    let released = changes.split_once(UNRELEASED).filter(|(_, after)| after.trim_start().starts_with("### "));
    let Some((before, after)) = released else {
        return Err(Error::Release(format!("{CHANGELOG} has nothing below {}; note what changes", UNRELEASED.trim())));
    };
    put(CHANGELOG, format!("{before}{UNRELEASED}\n## [{version}] - {day}\n{after}"))?;
    let now = version.to_string();
    let own = own(&read(LOCKS[0])?);
    for file in FILES {
        put(file, read(file)?.replace(PRESENT, &now))?;
    }
    for file in LOCKS {
        put(file, locked(&read(file)?, &own, &now))?;
    }
    Ok(())
}

/// What stands before each package in a lock file.
const PACKAGE: &str = "[[package]]\nname = ";

/// The packages of the workspace, whose lock file this is: those that come from no registry.
fn own(lock: &str) -> Vec<String> {
    let packages = lock.split(PACKAGE).skip(1).filter(|package| !package.contains("\nsource = "));
    packages.filter_map(|package| package.lines().next().map(str::to_owned)).collect()
}

/// A lock file in which the packages `own` have the version.
fn locked(lock: &str, own: &[String], version: &str) -> String {
    let line = |version: &str| format!("\nversion = \"{version}\"\n");
    let one = |package: &str| match own.iter().any(|name| package.lines().next() == Some(name)) {
        true => package.replace(&line(PRESENT), &line(version)),
        false => package.to_owned(),
    };
    lock.split(PACKAGE).map(one).collect::<Vec<_>>().join(PACKAGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files with an example of a version in them, which need not be the present one.
    const EXAMPLES: &[&str] = &[
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "capi/src/exported/info.rs",
        "dotnet/Ecmsk/Board.cs",
        "fuzz/seeds/",
        "include/ecmsk.h",
        "tests/",
        "tool/tests/",
        "xtask/src/",
    ];

    fn root() -> &'static Path {
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder of the project")
    }

    /// Every file that names the present version is known here.
    #[test]
    fn every_place_of_the_version_is_known() {
        let mut git = Command::new("git");
        git.current_dir(root()).args(["grep", "--files-with-matches", "--fixed-strings", PRESENT]);
        if !root().join(".git").exists() {
            return;
        }
        let found = command::output(&mut git).expect("git greps");
        let found = String::from_utf8(found).expect("names");
        let is_known = |file: &&str| {
            FILES.iter().chain(LOCKS).any(|known| known == file) || EXAMPLES.iter().any(|known| file.starts_with(known))
        };
        let unknown: Vec<&str> = found.lines().filter(|file| !is_known(file)).collect();
        assert_eq!(unknown, [""; 0], "name the file in xtask/src/release.rs");
    }

    /// The sources with a later version: cargo takes the lock file as it is, and the changelog has its heading.
    #[test]
    fn a_version_is_written_everywhere() {
        let folder = tempfile::tempdir().expect("a folder");
        for file in FILES.iter().chain(LOCKS).chain(&[CHANGELOG]) {
            let to = folder.path().join(file);
            fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
            fs::copy(root().join(file), to).expect("a copy");
        }
        let text = |file: &str| fs::read_to_string(folder.path().join(file)).expect("text");
        // Right after a release there is no change.
        let changes = text(CHANGELOG).replace(UNRELEASED, &format!("{UNRELEASED}\n### Added\n\n- something\n"));
        fs::write(folder.path().join(CHANGELOG), changes).expect("a file");
        let before = text("Cargo.lock");
        assert!(!is_written(folder.path(), Version([9, 8, 7])).expect("text"));
        write(folder.path(), Version([9, 8, 7]), "2030-01-02").expect("it is written");
        assert!(is_written(folder.path(), Version([9, 8, 7])).expect("text"));
        assert!(text(CHANGELOG).contains("## [Unreleased]\n\n## [9.8.7] - 2030-01-02\n\n### "));
        for file in FILES {
            assert!(text(file).contains("9.8.7") && !text(file).contains(PRESENT), "{file}");
        }
        let lock = text("Cargo.lock");
        let changed = before.lines().zip(lock.lines()).filter(|(before, after)| before != after).count();
        assert_eq!((changed, lock.lines().count()), (own(&before).len(), before.lines().count()));
        // In another workspace the library alone is the project's.
        assert_eq!(text("examples/firmware/Cargo.lock").matches("\nversion = \"9.8.7\"\n").count(), 1);
        for version in ["1.0", "0.1", "01.0.0", "1.2.3-a"] {
            assert!(parse(version).is_err(), "{version}");
        }
        let said = write(folder.path(), Version([0, 0, 9]), "2030-01-02").unwrap_err().to_string();
        assert!(said.contains("0.0.9 is not later than"), "{said}");
        let said = write(folder.path(), Version([9, 8, 8]), "2030-01-02").unwrap_err().to_string();
        assert!(said.contains("CHANGELOG.md has nothing below ## [Unreleased]"), "{said}");
    }
}
