//! The project's chores, one verb each: `cargo xtask help`. They run on Linux; `ci --fast` and `features` on Windows too.
//!
//! A new chore is a file and a variant of `Verb`. Files:
//!
//! - `main.rs`: every chore with its arguments
//! - `ci.rs`, `test.rs`, `groups.rs`, `tidy.rs`, `features/`: the checks that a change has to pass: the parts of the tests, the
//!   groups of tests, spelling and dependencies, rules and their tests
//! - `ahead.rs`: builds in the background what later parts need
//! - `rig/`, `windows/`, `dotnet.rs`: tests in a guest system, on Windows under Wine, and of .NET
//! - `stage.rs`, `dist/`, `semver.rs`: installing into a folder, making packages, comparing the API with the last release
//! - `bench.rs`, `fuzz.rs`, `soak.rs`, `mutants.rs`, `demo.rs`: one chore each
//! - `needs.rs`, `fetched.rs`, `wheel.rs`, `npm.rs`, `tools.rs`, `debian.rs`, `debian_rust.rs`: the programs that a chore
//!   needs, and where they are fetched from
//! - `project.rs`, `command.rs`, `side_by_side.rs`, `spend.rs`, `system.rs`, `error.rs`: the project's folders, running
//!   commands, the cost of a chore, operations of Unix, errors

mod ahead;
mod bench;
mod ci;
mod command;
mod debian;
mod debian_rust;
mod demo;
mod dist;
mod dotnet;
mod error;
mod features;
mod fetched;
mod fuzz;
mod groups;
mod mutants;
mod needs;
mod npm;
mod project;
mod python_packages;
mod release;
mod remapped;
mod rig;
mod semver;
mod side_by_side;
mod soak;
mod spend;
mod stage;
mod system;
mod test;
mod tidy;
mod tools;
mod wheel;
mod windows;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use error::Error;
use project::Project;

/// The project's chores.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Run the unit tests and the groups of tests; with --all everything that a change has to pass
    Test(test::Arguments),
    /// The checks for each commit (--fast), or for each change to be merged
    Ci(ci::Arguments),
    /// Check spelling, licences and sources of dependencies, and unused dependencies
    Tidy,
    /// Run the C++ program of README on a simulated board and plot its recording
    Demo(demo::Arguments),
    /// Install the library, its headers and the tool into a folder
    Stage(stage::Arguments),
    /// Compile the .NET assemblies and the C# programs
    Dotnet(dotnet::Arguments),
    /// Build the DLLs for Windows, x86 and x64, and their import libraries
    Windows(windows::Arguments),
    /// Make the release: packages for Windows and Linux, with checksums and bills of materials (SBOM)
    Dist(dist::Arguments),
    /// Give everything a version, commit that, and make all files of the release, twice the same
    Release(release::Arguments),
    /// Write docs/FEATURES.md from docs/rules/ and the tests that name its rules, or print the tests of a rule
    Features(features::Arguments),
    /// Compare the library's interface with the last release, and list changes that break programs
    Semver,
    /// Feed random bytes to everything that decodes input from outside: frames, files, links (fuzzing)
    Fuzz(fuzz::Arguments),
    /// Run random programs on random simulated networks with random faults, and a program for a virtual day, and look for a
    /// broken invariant
    Soak(soak::Arguments),
    /// Test mutants: break the model line by line, and list changes that no test finds; takes hours, and continues
    /// where it was stopped
    Mutants(mutants::Arguments),
    /// Run the benches, which compare the project with other implementations; figures go to target/bench.json
    Bench(bench::Arguments),
    /// Build what later parts of `test --all` need, in the background
    #[command(hide = true)]
    Ahead(ahead::Arguments),
}

fn main() -> ExitCode {
    let verb = Arguments::parse().verb;
    match Project::find().and_then(|project| run(verb, &project)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(verb: Verb, project: &Project) -> Result<(), Error> {
    match verb {
        Verb::Test(arguments) => test::run(project, &arguments),
        Verb::Ci(arguments) => ci::run(project, &arguments),
        Verb::Tidy => tidy::run(project),
        Verb::Demo(arguments) => demo::run(project, &arguments),
        Verb::Stage(arguments) => stage::run(project, &arguments),
        Verb::Dotnet(arguments) => dotnet::run(project, &arguments),
        Verb::Windows(arguments) => windows::run(project, &arguments),
        Verb::Dist(arguments) => dist::run(project, &arguments),
        Verb::Release(arguments) => release::run(project, &arguments),
        Verb::Features(arguments) => features::run(project, &arguments),
        Verb::Semver => semver::run(project),
        Verb::Fuzz(arguments) => fuzz::run(project, &arguments),
        Verb::Soak(arguments) => soak::run(project, &arguments),
        Verb::Mutants(arguments) => mutants::run(project, &arguments),
        Verb::Bench(arguments) => bench::run(project, &arguments),
        Verb::Ahead(arguments) => ahead::run(project, &arguments),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        super::Arguments::command().debug_assert();
    }
}
