//! `cargo xtask mutants`: mutation testing with cargo-mutants. It changes the model in one place at a time and checks whether a
//! fast test fails.
//!
//! A run takes hours. Its results are stored in `target/mutants` as it goes, so that it can be stopped and continued, and so
//! that parts (`--shard`) can be run one after another.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::command;
use crate::error::Error;
use crate::needs::{self, MUTANTS, NEXTEST};
use crate::project::Project;

#[derive(clap::Args)]
pub struct Arguments {
    /// Only the mutants of one room (a top-level module of src/)
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(ROOMS.map(|room| room.name)))]
    room: Option<String>,
    /// Only part K of N of the mutants, from 0/N to (N-1)/N
    #[arg(long, value_name = "K/N")]
    shard: Option<String>,
    /// Mutants tried at the same time
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    jobs: u8,
    /// Discard the results of earlier runs
    #[arg(long)]
    again: bool,
    /// Try no mutants, and print the results of earlier runs (target/mutants)
    #[arg(long)]
    report: bool,
}

/// A room (a top-level module of src/), the tests that have to catch its mutants, and the fraction of the viable mutants that
/// they have to catch.
struct Room {
    name: &'static str,
    /// The fast tests, with which all mutants are tried first.
    tests: Tests,
    /// All tests of the room, with which the mutants that were missed are tried again; `None` if there are no more.
    all_tests: Option<Tests>,
    least: f64,
}

struct Tests {
    programs: &'static [&'static str],
    /// Whether the unit tests in src/ count as well. The crate is then built twice for each mutant: with its unit tests,
    /// and for the test programs.
    unit_tests: bool,
}

const fn programs(programs: &'static [&'static str]) -> Tests {
    Tests { programs, unit_tests: false }
}

const ROOMS: [Room; 4] = [
    Room { name: "sk", tests: programs(&["sk"]), all_tests: None, least: 0.9 },
    Room {
        name: "engine",
        tests: programs(&["engine"]),
        all_tests: Some(Tests { programs: &["engine", "runners"], unit_tests: true }),
        least: 0.9,
    },
    Room { name: "slave", tests: programs(&["slave"]), all_tests: None, least: 0.8 },
    Room { name: "xf", tests: programs(&["xf"]), all_tests: None, least: 0.8 },
];

/// The page that lists accepted survivors: mutants that no test catches, each with the reason.
const REASONS: &str = "docs/MUTANTS.md";

/// The outcome of trying a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Fate {
    /// A test failed, as it should.
    Caught,
    /// A test did not end in time, which counts as caught.
    Timeout,
    /// No test failed: the mutant survives.
    Missed,
    /// The mutant does not compile, so it does not count.
    Unviable,
}

/// The files that cargo-mutants writes into its folder `mutants.out` while it runs, with one mutant per line.
const LISTS: [(&str, Fate); 4] = [
    ("caught.txt", Fate::Caught),
    ("timeout.txt", Fate::Timeout),
    ("missed.txt", Fate::Missed),
    ("unviable.txt", Fate::Unviable),
];

type Fates = BTreeMap<String, Fate>;

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    needs::require(project, &[MUTANTS, NEXTEST])?;
    let wanted = |room: &&Room| arguments.room.as_deref().is_none_or(|name| name == room.name);
    let mut short = Vec::new();
    for room in ROOMS.iter().filter(wanted) {
        let place = Place::new(project, room);
        if arguments.again {
            place.forget()?;
        }
        // The results of an earlier run that was stopped are stored first.
        place.keep()?;
        if !arguments.report {
            for tests in std::iter::once(&room.tests).chain(&room.all_tests) {
                try_mutants(project, room, tests, &place, arguments)?;
                place.keep()?;
            }
        }
        let mutants = list(project, room, arguments.shard.as_deref())?;
        let figures = Figures::of(&mutants, &place.known()?, &reasons(project)?);
        println!("{}", figures.text(room));
        if !figures.holds(room) {
            short.push(room.name);
        }
    }
    if short.is_empty() { Ok(()) } else { Err(Error::Mutants { rooms: short.join(", "), reasons: REASONS }) }
}

/// The folder in `target/mutants` with the results of one room.
struct Place {
    folder: PathBuf,
}

impl Place {
    fn new(project: &Project, room: &Room) -> Self {
        Self { folder: project.target.join("mutants").join(room.name) }
    }

    fn known_file(&self) -> PathBuf {
        self.folder.join("known.json")
    }

    fn forget(&self) -> Result<(), Error> {
        match fs::remove_dir_all(&self.folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::file("remove", &self.folder)(error))
            }
            _ => Ok(()),
        }
    }

    fn known(&self) -> Result<Fates, Error> {
        let path = self.known_file();
        if !path.exists() {
            return Ok(Fates::new());
        }
        let text = fs::read(&path).map_err(Error::file("read", &path))?;
        serde_json::from_slice(&text).map_err(|source| Error::Known { path, source })
    }

    /// Adds the results in `mutants.out`, the folder of cargo-mutants, to those of earlier runs in `known.json`.
    fn keep(&self) -> Result<(), Error> {
        let mut known = self.known()?;
        for (list, fate) in LISTS {
            let path = self.folder.join("mutants.out").join(list);
            // The result of the last try of a mutant replaces the stored one.
            let Ok(text) = fs::read_to_string(&path) else { continue };
            known.extend(text.lines().map(|name| (name.to_owned(), fate)));
        }
        fs::create_dir_all(&self.folder).map_err(Error::file("make", &self.folder))?;
        let path = self.known_file();
        let text = serde_json::to_string_pretty(&known).expect("names and words always serialise");
        fs::write(&path, text).map_err(Error::file("write", &path))
    }
}

fn cargo_mutants(project: &Project, room: &Room, shard: Option<&str>) -> std::process::Command {
    let mut cargo = project.cargo();
    cargo.args(["mutants", "--no-config", "--no-times", "--package=ecmsk"]);
    cargo.args([format!("--file=src/{}.rs", room.name), format!("--file=src/{}/**/*.rs", room.name)]);
    cargo.args(shard.map(|shard| format!("--shard={shard}")));
    cargo
}

fn try_mutants(
    project: &Project,
    room: &Room,
    tests: &Tests,
    place: &Place,
    arguments: &Arguments,
) -> Result<(), Error> {
    let mut cargo = cargo_mutants(project, room, arguments.shard.as_deref());
    // No debug information, because linking it would take longer than the tests. With a little optimisation the tests run in a
    // quarter of the time and compile as fast.
    cargo.env("CARGO_PROFILE_DEV_DEBUG", "0").env("CARGO_PROFILE_DEV_OPT_LEVEL", "1");
    // Each copy of the project that cargo-mutants makes needs its own target folder; with a common one they would run each
    // other's programs.
    cargo.env_remove("CARGO_TARGET_DIR").env_remove("CARGO_BUILD_TARGET_DIR");
    // nextest stops at the first test that fails, and ends one that hangs (.config/nextest.toml).
    cargo.env("NEXTEST_PROFILE", "mutants");
    cargo.args([
        "--test-tool=nextest",
        "--iterate",
        "--minimum-test-timeout=30",
        &format!("--jobs={}", arguments.jobs),
    ]);
    cargo.arg("--output").arg(&place.folder);
    // The test programs are named by arguments of cargo. After `--` they would be arguments of the tests, and all test
    // programs would be built.
    cargo.args(tests.unit_tests.then_some("--cargo-arg=--lib"));
    cargo.args(tests.programs.iter().map(|tests| format!("--cargo-arg=--test={tests}")));
    let status = cargo.status().map_err(|source| Error::Start { command: command::shown(&cargo), source })?;
    match status.code() {
        // Exit codes of cargo-mutants: 0 all caught, 2 some missed, 3 some timed out.
        Some(0 | 2 | 3) => Ok(()),
        _ => Err(Error::Failed { command: command::shown(&cargo), status: status.to_string() }),
    }
}

/// The names of all mutants of a room, or of a shard of them.
fn list(project: &Project, room: &Room, shard: Option<&str>) -> Result<Vec<String>, Error> {
    let said = command::output(cargo_mutants(project, room, shard).arg("--list"))?;
    Ok(String::from_utf8_lossy(&said).lines().map(str::to_owned).collect())
}

/// The name of a mutant without its line and column, which change often.
fn without_place(name: &str) -> String {
    let mut parts = name.splitn(4, ':');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(file), Some(line), Some(column), Some(rest))
            if [line, column].iter().all(|n| n.parse::<u32>().is_ok()) =>
        {
            format!("{file}:{rest}")
        }
        _ => name.to_owned(),
    }
}

/// The names of the surviving mutants that are accepted: the text in backquotes in the first column of the tables in
/// [`REASONS`]. They do not fail the run.
fn reasons(project: &Project) -> Result<Vec<String>, Error> {
    let path = project.root.join(REASONS);
    let text = fs::read_to_string(&path).map_err(Error::file("read", Path::new(&path)))?;
    Ok(explained(&text))
}

fn explained(text: &str) -> Vec<String> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("| `"));
    // In a table a bar inside a cell is written with a backslash.
    rows.filter_map(|row| Some(row.split_once("` |")?.0.replace(r"\|", "|"))).collect()
}

/// The counts of a room's mutants by outcome.
#[derive(Debug, Default, PartialEq, Eq)]
struct Figures {
    caught: usize,
    unviable: usize,
    /// The number of missed mutants that [`REASONS`] accepts.
    explained: usize,
    survivors: Vec<String>,
    untried: usize,
}

impl Figures {
    fn of(mutants: &[String], known: &Fates, explained: &[String]) -> Self {
        let mut figures = Self::default();
        for mutant in mutants {
            match known.get(mutant) {
                Some(Fate::Caught | Fate::Timeout) => figures.caught += 1,
                Some(Fate::Unviable) => figures.unviable += 1,
                Some(Fate::Missed) if explained.contains(&without_place(mutant)) => figures.explained += 1,
                Some(Fate::Missed) => figures.survivors.push(mutant.clone()),
                None => figures.untried += 1,
            }
        }
        figures
    }

    /// The fraction of the viable mutants that were caught, 0 to 1. Accepted survivors do not count as caught.
    fn share(&self) -> f64 {
        let viable = self.caught + self.explained + self.survivors.len();
        if viable == 0 { 0.0 } else { self.caught as f64 / viable as f64 }
    }

    fn holds(&self, room: &Room) -> bool {
        self.share() >= room.least && self.survivors.is_empty() && self.untried == 0
    }

    fn text(&self, room: &Room) -> String {
        let survivors: String = self.survivors.iter().map(|name| format!("\n  no reason given: {name}")).collect();
        format!(
            "{}: {:.1} % caught ({} of {}; at least {:.0} % wanted), {} survive for a reason, {} do not compile, {} not \
             tried yet{survivors}",
            room.name,
            self.share() * 100.0,
            self.caught,
            self.caught + self.explained + self.survivors.len(),
            room.least * 100.0,
            self.explained,
            self.unviable,
            self.untried,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Room = Room { name: "sk", tests: programs(&[]), all_tests: None, least: 0.9 };

    fn names(n: usize) -> Vec<String> {
        (0..n).map(|n| format!("src/sk/a.rs:{n}:3: replace f{n} -> u8 with 0")).collect()
    }

    #[test]
    fn the_figures_count_what_can_be_built() {
        let mutants = names(12);
        let mut known: Fates = mutants.iter().map(|name| (name.clone(), Fate::Caught)).collect();
        known.insert(mutants[0].clone(), Fate::Unviable);
        known.insert(mutants[1].clone(), Fate::Missed);
        known.insert("src/sk/gone.rs:1:1: replace".into(), Fate::Missed);
        let explained = vec!["src/sk/a.rs: replace f1 -> u8 with 0".to_owned()];
        let figures = Figures::of(&mutants, &known, &explained);
        assert_eq!((figures.caught, figures.unviable, figures.explained), (10, 1, 1));
        assert!(figures.holds(&ROOM), "{figures:?}");
        assert!(!Figures::of(&mutants, &known, &[]).holds(&ROOM), "a survivor without a reason");
        known.remove(&mutants[5]);
        assert!(!Figures::of(&mutants, &known, &explained).holds(&ROOM), "one not tried");
    }

    #[test]
    fn reasons_do_not_make_up_for_a_low_share() {
        let mutants = names(10);
        let known: Fates = mutants.iter().map(|name| (name.clone(), Fate::Missed)).collect();
        let explained: Vec<String> = mutants.iter().map(|name| without_place(name)).collect();
        assert!(!Figures::of(&mutants, &known, &explained).holds(&ROOM));
    }

    #[test]
    fn reasons_are_rows_of_a_table() {
        let text = "# Mutants\n\n| mutant | reason |\n| --- | --- |\n| `src/a.rs: replace \\| with ^` | why |\n";
        assert_eq!(explained(text), ["src/a.rs: replace | with ^"]);
    }

    #[test]
    fn findings_are_kept_from_run_to_run() {
        let folder = tempfile::tempdir().unwrap();
        let place = Place { folder: folder.path().join("sk") };
        let out = place.folder.join("mutants.out");
        fs::create_dir_all(&out).unwrap();
        fs::write(out.join("caught.txt"), "a\nb\n").unwrap();
        fs::write(out.join("missed.txt"), "c\n").unwrap();
        place.keep().unwrap();
        fs::write(out.join("caught.txt"), "c\n").unwrap();
        fs::write(out.join("missed.txt"), "").unwrap();
        place.keep().unwrap();
        let known = place.known().unwrap();
        assert_eq!(known.len(), 3);
        assert!(known.values().all(|fate| *fate == Fate::Caught));
        place.forget().unwrap();
        place.forget().unwrap();
        assert!(place.known().unwrap().is_empty());
    }
}
