//! `bus dc`: measures how well the distributed clocks are synchronized.

use std::process::ExitCode;
use std::time::Duration;

use ecmsk::bus::clocks::{self, SlaveClock};
use serde_json::json;

use super::words::name;
use super::{BusVerbError, NetworkArgs, Session};

/// Measure the distributed clocks: propagation delays, offsets, and how far each clock is ahead of the reference
///
/// The scan sets the clocks; they are synchronised for a second, then read every 10 ms. The exit code is 1 if a clock
/// is ever off by 1 us or more.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk bus dc --link nic:eth1
  ecmsk bus dc --seconds 30 --link nic:eth1 --json | jq .max_ns")]
pub struct Args {
    /// Duration of the measurement, seconds
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: u64,

    #[command(flatten)]
    network: NetworkArgs,
}

/// Measures the clocks and prints a line for each; the exit code is 0 if all clocks are good.
///
/// # Errors
/// [`BusVerbError`] if the network does not open, if no slave answers, if the clocks cannot be read, or if standard
/// output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, BusVerbError> {
    let Session { mut network, slaves, reporter } = args.network.open()?;
    let clocks = clocks::measure(&mut *network, &slaves, Duration::from_secs(args.seconds))?;
    if clocks.is_empty() {
        reporter.note("no slave has distributed clocks");
    }
    let width = slaves.iter().map(|slave| name(&slave.name).chars().count()).max().unwrap_or(0);
    for clock in &clocks {
        let SlaveClock { slave, is_reference, offset_ns, delay_ns, ahead } = *clock;
        let known = slaves.iter().find(|found| found.slave == slave).map_or("", |found| name(&found.name));
        let quality = match ahead {
            None if is_reference => "the reference".to_owned(),
            None => "not measured".to_owned(),
            Some(ahead) => format!(
                "ahead by {} to {} ns, {} in the mean{}",
                ahead.min_ns,
                ahead.max_ns,
                ahead.mean_ns,
                if ahead.is_good() { "" } else { ": it does not keep together with the reference" }
            ),
        };
        let text = format!("{slave:>2}  {known:<width$}  delay {delay_ns:>6} ns  offset {offset_ns} ns  {quality}");
        let json = json!({
            "verb": "bus dc", "slave": slave, "reference": is_reference, "offset_ns": offset_ns, "delay_ns": delay_ns,
            "min_ns": ahead.map(|ahead| ahead.min_ns), "mean_ns": ahead.map(|ahead| ahead.mean_ns),
            "max_ns": ahead.map(|ahead| ahead.max_ns), "samples": ahead.map(|ahead| ahead.count),
            "good": ahead.map(|ahead| ahead.is_good()),
        });
        reporter.result(text, &json)?;
    }
    let is_good = clocks.iter().all(|clock| clock.ahead.is_none_or(|ahead| ahead.is_good()));
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
