//! `ecmsk doctor`: what keeps a board from working on this machine, and what to do.

mod link;
mod rule;
mod versions;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::{Finding, State, lateness};
use ecmsk::machine::timing::Lateness;
use serde_json::{Map, Value, json};

use super::{CliError, output};
pub use link::not_in_build;
pub use rule::RuleError;

/// Check this machine for what keeps a board from working, and say what to do
///
/// Looks at the link that would be used, boards on USB (rights, who has them, speed, power), SPI and GPIO, real-time rights,
/// timers and processors, and measures for a second how late threads are woken up. Nothing is opened or changed, and no right
/// is needed; root sees more. `ok` is as it should be, `advice` would work better, `wrong` has to be put right.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk doctor
  ecmsk doctor --quick --json | jq -r 'select(.state == \"wrong\") | .next'
  sudo ecmsk doctor --write-udev-rule")]
pub struct Args {
    /// Leave out what takes a second: how late threads are woken up
    #[arg(long)]
    quick: bool,

    /// Print one JSON object for each finding, each on a line of its own
    #[arg(long)]
    json: bool,

    /// Write the udev rule that lets users open boards to /etc/udev/rules.d, show it, and say how it comes into force; who
    /// may not write there is told the lines to type
    #[arg(long, conflicts_with_all = ["quick", "json"])]
    write_udev_rule: bool,

    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,
}

/// How long and how often threads sleep for the measurement: a second of cycles.
const PERIOD: Duration = Duration::from_millis(1);
const TIMES: usize = 1000;

/// # Errors
/// [`CliError`]
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let machine = Machine::below(&args.root);
    if args.write_udev_rule {
        rule::write(&machine)?;
        return Ok(ExitCode::SUCCESS);
    }
    let (link, wanted) = link::finding(&args.root);
    let mut findings = vec![versions::finding(&machine), link];
    findings.extend(wanted.as_ref().and_then(link::build));
    findings.extend(machine.findings(wanted.as_ref()));
    if !args.quick {
        findings.push(lateness(Lateness::measure(PERIOD, TIMES)));
    }
    output::print(if args.json { lines(&findings) } else { text(&findings) })?;
    let is_wrong = findings.iter().any(|finding| finding.state == State::Wrong);
    Ok(if is_wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn text(findings: &[Finding]) -> String {
    let name = |finding: &Finding| match &finding.subject {
        Some(subject) => format!("{} {subject}", finding.check),
        None => finding.check.to_owned(),
    };
    let width = findings.iter().map(|finding| name(finding).chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for finding in findings {
        // Writing to a String does not fail.
        let _ = writeln!(text, "{:<6}  {:<width$}  {}", finding.state, name(finding), finding.found);
        if let Some(next) = finding.next.as_ref().filter(|_| finding.state != State::Fine) {
            let _ = writeln!(text, "{:<6}  do: {next}", "");
        }
    }
    let count = |state| findings.iter().filter(|finding| finding.state == state).count();
    let (wrong, advice) = (count(State::Wrong), count(State::Advice));
    let _ = match wrong {
        0 => writeln!(text, "nothing is wrong, {advice} could be better"),
        _ => writeln!(text, "{wrong} to put right, {advice} could be better"),
    };
    text
}

fn lines(findings: &[Finding]) -> String {
    let line = |finding: &Finding| {
        let figures: Map<String, Value> =
            finding.figures.iter().map(|(name, value)| ((*name).to_owned(), (*value).into())).collect();
        let object = json!({
            "verb": "doctor", "check": finding.check, "subject": finding.subject, "state": finding.state.name(),
            "found": finding.found, "next": finding.next, "figures": figures,
        });
        format!("{object}\n")
    };
    findings.iter().map(line).collect()
}
