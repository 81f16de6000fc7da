//! `cargo xtask tidy`: checks that rustfmt and clippy do not make: spelling, dependencies, types in the JavaScript of the
//! tool's page, firmware, and combinations of features.

use std::collections::{BTreeMap, BTreeSet};
use std::iter;
use std::process::Command;

use serde::Deserialize;

use crate::error::Error;
use crate::needs::{self, ADVISORIES, CARGO_DEBIAN, NODE, NPM, Need, PIP, PYTHON, RUSTC_DEBIAN, TSC, TYPOS};
use crate::npm::TYPESCRIPT;
use crate::project::{Project, cargo_home, metadata};
use crate::test::{self, Part, Site, part};
use crate::tools::{CARGO_DENY, CARGO_MACHETE, Tool};
use crate::{command, debian_rust, wheel};

/// The workspace of the fuzz targets, which has dependencies of its own.
const FUZZ: &str = "fuzz/Cargo.toml";

/// The parts of `cargo xtask tidy`. `cargo xtask test --all` runs those that do not need cargo-deny as well, the last one for
/// one target.
pub const PARTS: [Part; 6] = [
    part("spelling", &[PYTHON, PIP, TYPOS], |site| spelling(site.project)),
    part("licences and sources of dependencies", &[needs::CARGO_DENY], |site| dependencies(site.project)),
    part("known weaknesses of dependencies", &[needs::CARGO_DENY, ADVISORIES], |site| advisories(site.project)),
    part("unused dependencies", &[needs::CARGO_MACHETE], |site| unused(site.project)),
    part("types of the page's modules", &[NODE, NPM, TSC], |site| page_types(site.project)),
    part("firmware for microcontrollers", FIRMWARE_NEEDS, |site| firmware(site.project, &MICROCONTROLLERS)),
];

/// What [`firmware`] needs.
pub const FIRMWARE_NEEDS: &[Need] = &[RUSTC_DEBIAN, CARGO_DEBIAN];
/// Kinds of microcontrollers by rustc's target: a Cortex-M4 or M7, a Cortex-M0, a RISC-V, a Cortex-A9 without an
/// operating system.
pub const MICROCONTROLLERS: [&str; 4] =
    ["thumbv7em-none-eabihf", "thumbv6m-none-eabi", "riscv32imac-unknown-none-elf", "armv7a-none-eabihf"];

/// Runs all parts of `cargo xtask tidy`.
pub fn run(project: &Project) -> Result<(), Error> {
    let needed: Vec<Need> = PARTS.iter().flat_map(|part| part.needs).copied().collect();
    let missing = needs::set_up(project, &needed);
    let site = Site::new(project, &missing, false);
    test::run_parts(&site, PARTS.iter().map(|part| (part, Vec::new())).collect(), 1, &[], &[], None)
}

/// Checks spelling. `_typos.toml` lists the words that look like mistakes but are intended.
fn spelling(project: &Project) -> Result<(), Error> {
    command::run(project.program(wheel::TYPOS.program(project)).arg("--hidden"))
}

/// Checks licences and sources of all dependencies, by `deny.toml`.
fn dependencies(project: &Project) -> Result<(), Error> {
    ["Cargo.toml", FUZZ].into_iter().try_for_each(|manifest| {
        let mut deny = tool(project, &CARGO_DENY);
        command::run(deny.args(["--manifest-path", manifest, "check", "bans", "licenses", "sources"]))
    })
}

/// Checks for known vulnerabilities and withdrawn versions of dependencies.
fn advisories(project: &Project) -> Result<(), Error> {
    command::run(tool(project, &CARGO_DENY).args(["--offline", "check", "advisories"]))
}

/// Fetches the list of known vulnerabilities, a git repository, if there is a network.
pub fn fetch_advisories(project: &Project) {
    println!("fetching the list of known weaknesses of crates");
    command::succeeds(tool(project, &CARGO_DENY).args(["fetch", "db"]));
}

/// Whether the list of known vulnerabilities was fetched before.
pub fn advisories_are_there() -> bool {
    let Some(lists) = cargo_home().map(|home| home.join("advisory-dbs")) else { return false };
    lists.read_dir().is_ok_and(|entries| entries.flatten().any(|entry| entry.path().join("crates").is_dir()))
}

/// Checks for dependencies that no source uses.
fn unused(project: &Project) -> Result<(), Error> {
    command::run(tool(project, &CARGO_MACHETE).arg("--with-metadata"))
}

/// Checks the types in the JavaScript modules of the tool's page. They are written in the comments of the modules.
fn page_types(project: &Project) -> Result<(), Error> {
    let mut node = project.program("node");
    command::run(node.arg(TYPESCRIPT.program(project)).args(["--project", "tool/web"]))
}

/// Checks that the library compiles with no feature, with each one alone, and with all, as users may select them.
///
/// `cargo hack` is not used because it leaves out `--package`, and so builds the tool as well, which needs every
/// feature.
pub fn combinations(project: &Project) -> Result<(), Error> {
    let metadata: Metadata = metadata(project.cargo(), "--no-deps")?;
    let library = metadata.packages.into_iter().find(|package| package.name == LIBRARY);
    let features = library.map(|library| library.features).unwrap_or_default();
    for features in sets(&features) {
        let mut cargo = project.cargo();
        cargo.args([
            "check",
            "--package",
            LIBRARY,
            "--lib",
            "--no-default-features",
            "--features",
            &features.join(","),
        ]);
        command::run(&mut cargo)?;
    }
    Ok(())
}

/// Builds the static library of a firmware (`examples/firmware`) for these targets, with the standard library's `core`
/// from its sources.
pub fn firmware(project: &Project, targets: &[&str]) -> Result<(), Error> {
    let target = project.target.join("xtask/firmware");
    for triple in targets {
        println!("building a firmware for {triple}");
        let mut cargo = debian_rust::cargo(project, &target, triple, "arm-none-eabi");
        cargo.args(["build", "--quiet", "--locked", "-Zbuild-std=core", "--target", triple]);
        command::run(cargo.arg("--manifest-path=examples/firmware/Cargo.toml"))?;
    }
    Ok(())
}

const LIBRARY: &str = "ecmsk";

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    features: Features,
}

/// For each feature the features that it switches on.
type Features = BTreeMap<String, Vec<String>>;

/// The sets of features to check: none, each alone, all. Of sets that switch on the same features only the first is kept.
/// Code that uses a feature without naming it fails already in a set without that feature. So sets of all features but one
/// would hardly find more.
fn sets(features: &Features) -> Vec<Vec<String>> {
    let names: Vec<&str> = features.keys().map(String::as_str).filter(|name| *name != "default").collect();
    let alone = names.iter().map(|&name| vec![name]);
    let mut seen = BTreeSet::new();
    let sets = iter::once(Vec::new()).chain(alone).chain([names.clone()]);
    let new = sets.filter(|set| {
        let mut on = BTreeSet::new();
        set.iter().for_each(|name| switch_on(features, name, &mut on));
        seen.insert(on)
    });
    new.map(|set| set.into_iter().map(str::to_owned).collect()).collect()
}

fn switch_on(features: &Features, name: &str, on: &mut BTreeSet<String>) {
    if on.insert(name.to_owned()) {
        features.get(name).into_iter().flatten().for_each(|other| switch_on(features, other, on));
    }
}

fn tool(project: &Project, tool: &Tool) -> Command {
    project.program(tool.program(project))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_of_features_that_differ_are_tried() {
        let features = [("default", "sim"), ("serve", "tcp"), ("sim", "std"), ("std", "dep:log"), ("tcp", "std")];
        let features: Features = features.map(|(name, on)| (name.to_owned(), vec![on.to_owned()])).into();
        let sets: Vec<String> = sets(&features).iter().map(|set| set.join(",")).collect();
        assert_eq!(sets, ["", "serve", "sim", "std", "tcp", "serve,sim,std,tcp"]);
    }
}
