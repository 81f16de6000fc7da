//! `ecmsk fault`: makes an event happen on a simulated board that runs.

use std::process::ExitCode;
use std::time::Duration;

use ecmsk::link::control::{ControlError, Happened};
use serde_json::json;

use super::board::duration;
use super::error::CliError;
use super::output;

/// Make an event of scripts happen on a simulated board that runs, such as an alarm
///
/// The event happens at the beginning of the board's next cycle. Standard output gives the number of that cycle and its
/// time, both since the link was opened, in the board's time. `ecmsk link help` lists the events; `for TIME` ends one by
/// itself, and `end` ends it at once. On a virtual clock a cycle comes when the program reads or writes.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk exec --link 'sim:?slaves=drive*2' --control press -- ./press &
  ecmsk fault --wait 5s press alarm 2 0x7500
  ecmsk fault press cut 2 for 500ms
  ecmsk fault press end cut

Exit code: 0 it has happened, 1 it has not.")]
pub struct Args {
    /// The board: the name, or the path, that its --control, or control= of its link, has
    #[arg(value_name = "NAME")]
    name: String,

    /// The event, in one word or in several, e.g. alarm 2 0x7500
    #[arg(required = true, value_name = "EVENT")]
    event: Vec<String>,

    /// Wait so long until the board is there, e.g. 5s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    wait: Option<Duration>,

    /// Give up if no cycle begins within this time; the event is then taken back
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration)]
    timeout: Duration,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Why an event has not happened.
#[derive(Debug, thiserror::Error)]
pub enum FaultError {
    /// The board has not carried it out.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// There are no control sockets on this system.
    #[cfg(not(unix))]
    #[error("there are no control sockets on this system; use script= in the link of the board")]
    NoSockets,
}

/// Makes the event happen, and prints when it did.
///
/// # Errors
/// [`FaultError`] if it has not happened, [`CliError::Output`] if standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let event = args.event.join(" ");
    let Happened { cycle, at_ns } = inject(args, &event)?;
    let at_s = at_ns as f64 / 1e9;
    output::print(if args.json {
        format!("{}\n", json!({"verb": "fault", "board": args.name, "event": event, "cycle": cycle, "at_s": at_s}))
    } else {
        format!("cycle {cycle}, {at_s:.3} s: {event}\n")
    })?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(unix)]
fn inject(args: &Args, event: &str) -> Result<Happened, FaultError> {
    use std::time::Instant;

    use ecmsk::link::control::Injection;

    /// The interval at which a waiting `ecmsk fault` checks whether the board is there. \[OURS]
    const LOOK_INTERVAL: Duration = Duration::from_millis(10);

    let deadline = args.wait.and_then(|wait| Instant::now().checked_add(wait));
    loop {
        match Injection::begin(&args.name, event) {
            Ok(mut injection) => return Ok(injection.wait(args.timeout)?),
            Err(ControlError::NotRunning { .. }) if deadline.is_some_and(|deadline| Instant::now() < deadline) => {
                std::thread::sleep(LOOK_INTERVAL);
            }
            Err(error) => return Err(error.into()),
        }
    }
}

#[cfg(not(unix))]
fn inject(_: &Args, _: &str) -> Result<Happened, FaultError> {
    Err(FaultError::NoSockets)
}
