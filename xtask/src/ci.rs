//! `cargo xtask ci`: the checks of a commit (`--fast`), and those of a change that is to be merged, which are `cargo
//! xtask test --all`.

use std::path::Path;

use crate::command;
use crate::error::Error;
use crate::needs::{self, CLIPPY, Need, RUSTFMT};
use crate::project::Project;
use crate::test::{self, GATES, PARTS, PARTS_BEYOND_THIS_MACHINE, Part, Site, part};

#[derive(clap::Args)]
pub struct Arguments {
    /// What a person waits for: format, lints, rules, tests of units and the quick groups; nothing is installed, and what was left
    /// out is named at the end
    #[arg(long)]
    fast: bool,
}

/// The parts that `--fast` runs.
const FAST: &[Part] = &[
    part("format", &[RUSTFMT], test::format),
    part("lints", &[CLIPPY], lints),
    part("rules and features", &[], test::rules),
    part("tests of units and quick groups", &[], tests),
];

/// Groups of tests that need no other program, no real time, and seconds.
const GROUPS: &[&str] =
    &["engine", "ethercat", "fieldbus", "link", "link_log", "recordings", "rooms", "runners", "sk", "slave", "xf"];

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if !arguments.fast {
        return test::run(project, &test::Arguments::ALL);
    }
    let needed = FAST.iter().flat_map(|part| part.needs).chain(GATES.iter().flat_map(|gate| gate.needs));
    let missing = needs::missing(project, &needed.copied().collect::<Vec<Need>>());
    let run = |part: &Part| FAST.iter().any(|fast| fast.name == part.name);
    let others = PARTS.iter().chain(PARTS_BEYOND_THIS_MACHINE).filter(|part| !run(part)).map(|part| part.name);
    let others = format!("{}; cargo xtask test --all runs them", others.collect::<Vec<_>>().join(", "));
    let groups = format!("groups of tests ({})", other_groups(&project.root)?.join(", "));
    test::run_parts(
        project,
        FAST.iter().map(|part| (part, Vec::new())).collect(),
        GATES,
        &missing,
        &[&format!("{groups}, {others}")],
    )
}

/// The groups of tests that `--fast` leaves out: folders with a `main.rs`, and single files.
fn other_groups(root: &Path) -> Result<Vec<String>, Error> {
    let mut found = Vec::new();
    for folder in ["tests", "tool/tests"].map(|folder| root.join(folder)) {
        for entry in folder.read_dir().map_err(Error::file("list", &folder))? {
            let path = entry.map_err(Error::file("list", &folder))?.path();
            let is_group = path.join("main.rs").exists() || path.extension().is_some_and(|extension| extension == "rs");
            found.extend(path.file_stem().filter(|_| is_group).map(|name| name.to_string_lossy().into_owned()));
        }
    }
    found.retain(|name| !GROUPS.contains(&name.as_str()));
    found.sort();
    Ok(found)
}

/// Runs clippy; on Windows on what is built there, since some tests need Unix.
fn lints(site: &Site) -> Result<(), Error> {
    if !cfg!(windows) {
        return test::lints(site);
    }
    command::run(site.project.cargo().args(["clippy", "--workspace", "--lib", "--bins", "--", "-Dwarnings"]))
}

fn tests(site: &Site) -> Result<(), Error> {
    let mut cargo = site.project.cargo();
    cargo.args(["test", "--workspace", "--lib", "--bins"]);
    cargo.args(GROUPS.iter().map(|group| format!("--test={group}")));
    command::run(cargo.args(["--", "--quiet"]).args(site.skipped_modules()))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use clap::Parser;

    use super::*;

    /// Every cargo command in the workflow of GitHub and in `.ci/run` is an existing chore with existing options.
    #[test]
    fn what_a_ci_runs_is_there() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let text = |file| fs::read_to_string(root.join(file)).unwrap();
        let (workflow, script) = (text(".github/workflows/ci.yml"), text(".ci/run"));
        let lines = workflow.lines().chain(script.lines()).map(|line| line.trim().trim_start_matches("- "));
        let commands = lines.map(|line| line.trim_start_matches("run: ")).filter(|line| line.starts_with("cargo "));
        let commands: Vec<&str> = commands.collect();
        for command in &commands {
            assert!(command.starts_with("cargo xtask "), "{command}");
            let words = command.split_whitespace().skip(1);
            crate::Arguments::try_parse_from(words).unwrap_or_else(|error| panic!("{command}: {error}"));
        }
        assert_eq!(commands, ["cargo xtask ci --fast", "cargo xtask ci", "cargo xtask test --all"]);
    }

    /// Every quick group exists, and all other groups are listed.
    #[test]
    fn groups_are_run_or_named() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for group in GROUPS {
            let places = [root.join("tests").join(group).join("main.rs"), root.join(format!("tests/{group}.rs"))];
            assert!(places.iter().any(|place| place.exists()), "{group}");
        }
        let others = other_groups(root).unwrap();
        for group in ["capi", "ecm", "tcp", "tool", "windows"] {
            assert!(others.iter().any(|other| other == group), "{group}: {others:?}");
        }
    }

    /// The toolchain of the tests is the oldest version that the crate supports.
    #[test]
    fn the_toolchain_is_the_oldest() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let toolchain = fs::read_to_string(root.join("rust-toolchain.toml")).unwrap();
        let channel = format!("channel = \"{}.0\"", env!("CARGO_PKG_RUST_VERSION"));
        assert!(toolchain.lines().any(|line| line == channel), "{channel}");
    }
}
