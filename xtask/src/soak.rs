//! `cargo xtask soak`: runs randomised tests many more times than `cargo xtask test` does:
//!
//! - the random schedules of tests/invariants, on networks that answer within the cycle and on such as answer cycles later,
//!   with writers that end without closing their board; and its long simulated day
//! - random frames against every network of tests/engine, and against slaves in every state in tests/ethercat
//! - networks whose slaves another master has left in any state, in tests/master
//! - all tests of tests/engine on a bus that queues outputs
//! - fault schedules between the driver of the ECM-XF and the model of the chip, in tests/xf, and programs that stall in their
//!   end, in tests/xf_api
//! - programs on a board and behind a chip, compared, in tests/migration
//! - system calls that fail, in tests/failing_calls and in tests/masters

use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::needs;
use crate::project::Project;
use crate::test::GATES;

/// One program of tests/migration is run per this many schedules of the other tests: a program is run twice and takes seconds
/// of simulated time each time.
const PER_MIGRATION: u64 = 25;
/// One motion on a network card is run per this many schedules of the other tests, because it takes seconds of real time.
const PER_CARD: u64 = 25;

#[derive(clap::Args)]
pub struct Arguments {
    /// How many random schedules are run of each kind of test: invariants, faults of the chip's link, failing system calls
    /// and others
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..))]
    schedules: u64,
    /// Seed of the first schedule, and of the frames against the first network
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Virtual hours of the test that moves two axes for a long day
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    hours: u64,
    /// How many random command frames are sent one after the other, to each network of a board and to slaves in each state
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    frames: u64,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    for (group, filter) in [("engine", &["random_networks::", "over::"][..]), ("ethercat", &["random_frames"])] {
        let mut frames = test(project, group, filter);
        frames.env("ECMSK_SOAK_FRAMES", arguments.frames.to_string());
        frames.env("ECMSK_SOAK_FIRST", arguments.first.to_string());
        command::run(&mut frames)?;
    }
    let few = arguments.schedules.div_ceil(PER_MIGRATION);
    let groups = [
        ("invariants", &[][..], arguments.schedules),
        ("master", &["what_another_master_has_left_does_not_matter"], arguments.schedules),
        ("xf", &["schedules::"], arguments.schedules),
        ("xf_api", &["an_end_that_stalls"], arguments.schedules),
        ("migration", &["generated_programs"], few),
    ];
    let groups = groups.map(|(group, filter, count)| (test(project, group, filter), count));
    for (mut schedules, count) in groups.into_iter().chain(failing_calls(project, arguments.schedules)) {
        schedules.env("ECMSK_SOAK_SCHEDULES", count.to_string());
        schedules.env("ECMSK_SOAK_FIRST", arguments.first.to_string());
        schedules.env("ECMSK_SOAK_MINUTES", (arguments.hours * 60).to_string());
        command::run(&mut schedules)?;
    }
    Ok(())
}

/// The commands of the two groups of tests with failing system calls, on simulated boards and on a network card, each with its
/// number of schedules; there are fewer on the card, see [`PER_CARD`]. Tests whose programs this machine lacks are skipped.
fn failing_calls(project: &Project, count: u64) -> Vec<(Command, u64)> {
    let mut on_boards = test(project, "failing_calls", &[]);
    // These tests use the machine's clock, so no other test may run at the same time.
    on_boards.arg("--test-threads=1");
    let mut on_card = project.cargo();
    on_card.args(["test", "--release", "--package=masters", "--test=failing_calls_on_card", "--", "--nocapture"]);
    let parts = [(on_boards, count, "needs_cxx"), (on_card, count.div_ceil(PER_CARD), "needs_network_namespace")];
    let parts = parts.map(|(mut part, count, module)| {
        let gate = GATES.iter().find(|gate| gate.module == module);
        let missing = gate.map(|gate| needs::set_up(project, gate.needs)).unwrap_or_default();
        if !missing.is_empty() {
            println!("left out: tests in modules {module}: no {}", needs::names(&missing));
            part.arg(format!("--skip={module}::"));
        }
        (part, count)
    });
    parts.into()
}

/// The command that runs a test program of the library; `filter` selects some of its tests.
fn test(project: &Project, name: &str, filter: &[&str]) -> Command {
    let mut cargo = project.cargo();
    cargo.args(["test", "--release", "--package=ecmsk", "--test", name, "--", "--nocapture"]).args(filter);
    cargo
}
