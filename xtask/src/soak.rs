//! `cargo xtask soak`: the random schedules and the long day of tests/invariants, many more than the test runs.

use crate::command;
use crate::error::Error;
use crate::project::Project;

#[derive(clap::Args)]
pub struct Arguments {
    /// How many random schedules
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..))]
    schedules: u64,
    /// Seed of the first one
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Virtual hours of the long day
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    hours: u64,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    let mut cargo = project.cargo();
    cargo.args(["test", "--release", "--package=ecmsk", "--test=invariants", "--", "--nocapture"]);
    cargo.env("ECMSK_SOAK_SCHEDULES", arguments.schedules.to_string());
    cargo.env("ECMSK_SOAK_FIRST", arguments.first.to_string());
    cargo.env("ECMSK_SOAK_MINUTES", (arguments.hours * 60).to_string());
    command::run(&mut cargo)
}
