//! `cargo xtask fuzz`: runs the fuzz targets of fuzz/ with the installed stable toolchain, each for a given time.
//!
//! fuzz/ has the layout of cargo-fuzz, which needs a nightly toolchain for its sanitizers. libFuzzer alone needs only coverage
//! counters in the code, which the stable compiler can add as well.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use crate::error::Error;
use crate::needs::CXX;
use crate::project::Project;
use crate::{command, needs};

#[derive(clap::Args)]
pub struct Arguments {
    /// How many seconds each target runs
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    seconds: u32,
    /// Run only this target, a file of fuzz/fuzz_targets/ without its extension
    target: Option<String>,
}

/// Compiler flags for the coverage that libFuzzer reads: a counter per edge, a table of the edges' addresses, and the operands
/// of comparisons. Branches are not merged, so that each condition of an `if` counts as progress. One codegen unit puts all
/// counters into one section. Debug assertions find overflows.
const RUSTFLAGS: [&str; 9] = [
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "-Cllvm-args=-simplifycfg-branch-fold-threshold=0",
    "--cfg=fuzzing",
    "-Cdebug-assertions",
    "-Ccodegen-units=1",
];

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    let folder = project.root.join("fuzz");
    let targets = choose(targets(&folder)?, arguments.target.as_deref())?;
    needs::require(project, &[CXX])?;
    let programs = build(project, &folder, &targets)?;
    for target in &targets {
        println!("{target}: {} s ...", arguments.seconds);
        let rate = fuzz(&folder, target, &programs.join(target), arguments.seconds)?;
        println!("{target}: {rate} executions per second, no failure");
    }
    Ok(())
}

/// The names of all fuzz targets.
fn targets(folder: &Path) -> Result<Vec<String>, Error> {
    let folder = folder.join("fuzz_targets");
    let entries =
        fs::read_dir(&folder).and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(Error::file("list", &folder))?;
    let sources = entries.iter().map(fs::DirEntry::path).filter(|path| path.extension().is_some_and(|end| end == "rs"));
    let mut names: Vec<String> = sources.filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned())).collect();
    names.sort();
    Ok(names)
}

fn choose(targets: Vec<String>, wanted: Option<&str>) -> Result<Vec<String>, Error> {
    match wanted {
        None => Ok(targets),
        Some(name) if targets.iter().any(|target| target == name) => Ok(vec![name.to_owned()]),
        Some(name) => Err(Error::NoFuzzTarget { name: name.to_owned(), known: targets.join(", ") }),
    }
}

/// Builds the fuzz targets; returns the folder with their programs.
fn build(project: &Project, folder: &Path, targets: &[String]) -> Result<PathBuf, Error> {
    // cargo builds the build scripts, too. With an explicit `--target` it does not apply these flags to them: without the
    // runtime of libFuzzer they could not be linked.
    let triple = host_triple()?;
    let built = folder.join("target");
    let mut cargo = project.cargo();
    cargo.current_dir(folder).env("RUSTFLAGS", RUSTFLAGS.join(" ")).env("CARGO_TARGET_DIR", &built);
    cargo.args(["build", "--release", "--target", &triple]);
    for target in targets {
        cargo.args(["--bin", target]);
    }
    command::run(&mut cargo)?;
    Ok(built.join(triple).join("release"))
}

fn host_triple() -> Result<String, Error> {
    let mut rustc = Command::new("rustc");
    let said = command::output(rustc.arg("-vV"))?;
    let said = String::from_utf8_lossy(&said);
    let host = said.lines().find_map(|line| line.strip_prefix("host: "));
    host.map(str::to_owned).ok_or_else(|| Error::Failed { command: command::shown(&rustc), status: "no host".into() })
}

/// Runs one fuzz target; returns its executions per second as libFuzzer prints them.
fn fuzz(folder: &Path, target: &str, program: &Path, seconds: u32) -> Result<String, Error> {
    let [corpus, artifacts] = ["corpus", "artifacts"].map(|name| folder.join(name).join(target));
    for folder in [&corpus, &artifacts] {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    let log = artifacts.join("log");
    let said = File::create(&log).map_err(Error::file("make", &log))?;
    let before = SystemTime::now();

    let mut run = Command::new(program);
    run.arg(format!("-max_total_time={seconds}")).arg(format!("-artifact_prefix={}/", artifacts.display()));
    // `-close_fd_mask=1` closes standard output: nobody reads the output of the code under test.
    run.args(["-print_final_stats=1", "-timeout=10", "-close_fd_mask=1"]).arg(&corpus).stderr(said);
    // libFuzzer adds new inputs to the first folder, the corpus. It only reads the second one, the seeds.
    let seeds = folder.join("seeds").join(target);
    run.args(seeds.is_dir().then_some(seeds));
    let status = run.status().map_err(|source| Error::Start { command: command::shown(&run), source })?;

    let said = fs::read(&log).map_err(Error::file("read", &log))?;
    let said = String::from_utf8_lossy(&said);
    if !status.success() {
        let lines: Vec<&str> = said.lines().collect();
        println!("{}", lines[lines.len().saturating_sub(40)..].join("\n"));
        return Err(failure(target, program, &artifacts, before));
    }
    let rate = said.lines().find_map(|line| line.strip_prefix("stat::average_exec_per_sec:"));
    rate.map(|rate| rate.trim().to_owned()).ok_or_else(|| Error::FuzzSilent { target: target.to_owned(), log })
}

/// The error of a target that failed, with a command that repeats the failure: the program with the newest input that
/// libFuzzer has stored since `before`.
fn failure(target: &str, program: &Path, artifacts: &Path, before: SystemTime) -> Error {
    let mut inputs: Vec<(SystemTime, PathBuf)> = Vec::new();
    for entry in fs::read_dir(artifacts).into_iter().flatten().flatten() {
        if let Ok(changed) = entry.metadata().and_then(|data| data.modified())
            && entry.file_name() != "log"
            && changed >= before
        {
            inputs.push((changed, entry.path()));
        }
    }
    let mut again = Command::new(program);
    again.args(inputs.into_iter().max().map(|(_, input)| input));
    Error::Fuzz { target: target.to_owned(), again: command::shown(&again) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_is_chosen_by_its_name() {
        let all = || vec!["a".to_owned(), "b".to_owned()];
        assert_eq!(choose(all(), None).unwrap(), all());
        assert_eq!(choose(all(), Some("b")).unwrap(), ["b"]);
        assert!(choose(all(), Some("c")).unwrap_err().to_string().ends_with("a, b"));
    }

    #[test]
    fn every_target_has_its_place_in_the_manifest() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let targets = targets(&folder).unwrap();
        assert!(!targets.is_empty());
        for target in targets {
            let path = format!("name = \"{target}\"\npath = \"fuzz_targets/{target}.rs\"\n");
            assert!(manifest.contains(&path), "fuzz/Cargo.toml lacks [[bin]] for {target}");
        }
    }
}
