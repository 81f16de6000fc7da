//! `cargo xtask ci`: checks a commit (`--fast`), or a change before it is merged, which is the same as `cargo xtask test
//! --all`.

use crate::command;
use crate::error::Error;
use crate::groups;
use crate::needs::{self, CLIPPY, Need, RUSTFMT};
use crate::project::Project;
use crate::test::{self, GATES, PARTS, PARTS_OF_ALL, Part, Site, part};

#[derive(clap::Args)]
pub struct Arguments {
    /// Quick checks: format, lints, rules, unit tests and the groups of tests that take little time; nothing is installed,
    /// and skipped checks are listed at the end
    #[arg(long)]
    fast: bool,
}

/// The parts that `--fast` runs.
const FAST: &[Part] = &[
    part("format", &[RUSTFMT], test::format),
    part("lints", &[CLIPPY], lints),
    part("rules and features", &[], test::rules),
    part("tests of units and quick groups", &[], groups::quick),
];

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if !arguments.fast {
        return test::run(project, &test::Arguments::ALL);
    }
    let needed = FAST.iter().flat_map(|part| part.needs).chain(GATES.iter().flat_map(|gate| gate.needs));
    let missing = needs::missing(project, &needed.copied().collect::<Vec<Need>>());
    let run = |part: &Part| FAST.iter().any(|fast| fast.name == part.name);
    let others = PARTS.iter().chain(PARTS_OF_ALL).filter(|part| !run(part)).map(|part| part.name);
    let others = format!("{}; cargo xtask test --all runs them", others.collect::<Vec<_>>().join(", "));
    let groups = format!("groups of tests ({})", groups::not_quick().collect::<Vec<_>>().join(", "));
    let site = Site::new(project, &missing, true);
    test::run_parts(
        &site,
        FAST.iter().map(|part| (part, Vec::new())).collect(),
        1,
        GATES,
        &[&format!("{groups}, {others}")],
        None,
    )
}

/// Runs clippy. On Windows it checks only the targets that are built there, since some tests need Unix.
fn lints(site: &Site) -> Result<(), Error> {
    if !cfg!(windows) {
        return test::lints(site);
    }
    command::run(site.project.cargo().args(["clippy", "--workspace", "--lib", "--bins", "--", "-Dwarnings"]))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use clap::Parser;

    /// Each `cargo xtask` command that a workflow of GitHub or the script `.ci/run` calls exists, with the options that it is
    /// given.
    #[test]
    fn what_a_ci_runs_is_there() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let text = |file| fs::read_to_string(root.join(file)).unwrap();
        let all = [".github/workflows/ci.yml", ".github/workflows/release.yml", ".ci/run"].map(text).join("\n");
        let lines = all.lines().map(|line| line.trim().trim_start_matches("- "));
        let commands = lines.map(|line| line.trim_start_matches("run: ")).filter(|line| line.starts_with("cargo "));
        let commands: Vec<&str> = commands.collect();
        for command in &commands {
            assert!(command.starts_with("cargo xtask "), "{command}");
            let words = command.split_whitespace().skip(1);
            crate::Arguments::try_parse_from(words).unwrap_or_else(|error| panic!("{command}: {error}"));
        }
        let expected = [
            "cargo xtask ci --fast",
            "cargo xtask ci",
            "cargo xtask ci",
            "cargo xtask dist --check",
            "cargo xtask test --all",
        ];
        assert_eq!(commands, expected);
    }

    /// The toolchain with which everything is tested is the oldest Rust version that the crate supports.
    #[test]
    fn the_toolchain_is_the_oldest() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let toolchain = fs::read_to_string(root.join("rust-toolchain.toml")).unwrap();
        let channel = format!("channel = \"{}.0\"", env!("CARGO_PKG_RUST_VERSION"));
        assert!(toolchain.lines().any(|line| line == channel), "{channel}");
    }
}
