//! Finds the crates that are part of the shipped files: those that cargo links into a package for a target, without build tools
//! and procedural macros.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;

use serde::Deserialize;

use crate::command;
use crate::error::Error;
use crate::project::{Project, metadata};

/// A crate with its metadata.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Crate {
    pub name: String,
    pub version: String,
    /// The licence as an SPDX expression.
    pub licence: String,
    /// The URL of its repository; empty if it has none.
    pub repository: String,
    /// The SHA-256 of its archive on crates.io; `None` for a crate of this project.
    pub checksum: Option<String>,
    /// The folder of its sources on this machine.
    pub folder: PathBuf,
}

impl Crate {
    /// The package URL (purl) of the crate, for the list of components.
    pub fn purl(&self) -> String {
        // A `+` in a version is percent-encoded.
        format!("pkg:cargo/{}@{}", self.name, self.version.replace('+', "%2B"))
    }
}

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: String,
    license: Option<String>,
    repository: Option<String>,
    manifest_path: PathBuf,
}

/// The licence, source and checksum of all crates in Cargo.lock, by name and version.
pub struct Known(BTreeMap<(String, String), Crate>);

impl Known {
    pub fn find(project: &Project) -> Result<Self, Error> {
        let metadata: Metadata = metadata(project.cargo(), "--locked")?;
        let lock = project.root.join("Cargo.lock");
        let sums = checksums(&fs::read_to_string(&lock).map_err(Error::file("read", &lock))?);
        let crates = metadata.packages.into_iter().map(|package| {
            let key = (package.name, package.version);
            let known = Crate {
                name: key.0.clone(),
                version: key.1.clone(),
                // Old crates write `MIT/Apache-2.0`, from before SPDX expressions.
                licence: package.license.unwrap_or_default().replace('/', " OR "),
                repository: package.repository.unwrap_or_default(),
                checksum: sums.get(&key).cloned(),
                folder: package.manifest_path.parent().map(PathBuf::from).unwrap_or_default(),
            };
            (key, known)
        });
        Ok(Self(crates.collect()))
    }

    /// The crates that cargo links into `package` for `target`, including the package itself, sorted by name.
    pub fn linked(&self, project: &Project, package: &str, target: &str) -> Result<Vec<Crate>, Error> {
        let mut tree = project.cargo();
        tree.args(["tree", "--locked", "--package", package, "--target", target, "--edges", "normal,no-proc-macro"]);
        let said = command::output(tree.args(["--prefix", "none", "--no-dedupe", "--format", "{p}"]))?;
        let said = String::from_utf8_lossy(&said);
        let names: BTreeSet<(String, String)> = said.lines().filter_map(name_and_version).collect();
        let missing =
            |(name, version)| Error::Sbom(format!("cargo tree names {name} {version}, cargo metadata does not"));
        names.into_iter().map(|key| self.0.get(&key).cloned().ok_or_else(|| missing(key))).collect()
    }
}

/// The name and version in a line of `cargo tree`: `name v1.2.3 (path)`.
fn name_and_version(line: &str) -> Option<(String, String)> {
    let mut words = line.split_whitespace();
    let (name, version) = (words.next()?, words.next()?.strip_prefix('v')?);
    Some((name.to_owned(), version.to_owned()))
}

/// The checksums in Cargo.lock by name and version of the crate.
fn checksums(lock: &str) -> BTreeMap<(String, String), String> {
    let of_a_crate = |paragraph: &str| {
        let field = |name: &str| {
            let value = paragraph.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(" = \""))?;
            Some(value.trim_end_matches('"').to_owned())
        };
        Some(((field("name")?, field("version")?), field("checksum")?))
    };
    lock.split("[[package]]").filter_map(of_a_crate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(name: &str, version: &str) -> (String, String) {
        (name.to_owned(), version.to_owned())
    }

    #[test]
    fn lines_of_the_tree_have_a_name_and_a_version() {
        assert_eq!(name_and_version("ecmsk v0.1.0 (/a folder/x)"), Some(key("ecmsk", "0.1.0")));
        assert_eq!(name_and_version("toml v1.2.1+spec-1.1.0"), Some(key("toml", "1.2.1+spec-1.1.0")));
        assert_eq!(name_and_version(""), None);
    }

    #[test]
    fn sums_stand_in_the_lock_file() {
        let lock = "version = 4\n\n[[package]]\nname = \"ecmsk\"\nversion = \"0.1.0\"\ndependencies = [\n \"a\",\n]\n\n\
                    [[package]]\nname = \"a\"\nversion = \"1.0.0\"\nsource = \"x\"\nchecksum = \"00ff\"\n";
        assert_eq!(checksums(lock), BTreeMap::from([(key("a", "1.0.0"), "00ff".to_owned())]));
    }

    /// A crate that is linked only on one operating system is listed only for that system. Build tools and macros are not
    /// listed, because no binary contains them.
    #[test]
    fn what_is_linked_depends_on_the_target() {
        let project = Project::find().unwrap();
        let known = Known::find(&project).unwrap();
        let names = |target: &str| -> Vec<String> {
            let linked = known.linked(&project, "NEXTWUSBLib", target).unwrap();
            linked.into_iter().map(|linked| linked.name).collect()
        };
        let has = |names: &[String], name: &str| names.iter().any(|known| known == name);
        let (linux, windows) = (names("x86_64-unknown-linux-gnu"), names("i686-pc-windows-gnu"));
        for name in ["NEXTWUSBLib", "ecmsk", "ring", "rustls"] {
            assert!(has(&linux, name) && has(&windows, name), "{name}");
        }
        assert!(has(&linux, "spidev") && !has(&windows, "spidev"));
        assert!(has(&windows, "windows-sys") && !has(&linux, "windows-sys"));
        for name in ["cc", "serde_derive", "clap", "tempfile"] {
            assert!(!has(&linux, name) && !has(&windows, name), "{name}");
        }
    }
}
