//! `ecmsk doctor`: checks this machine, or the folder of a Windows program, for what keeps a board from working.

mod folder;
mod link;
#[cfg(target_os = "linux")]
mod linux;
mod report;
mod secrets;
mod versions;
#[cfg(windows)]
mod windows;

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::findings::{Finding, FindingVerdict, lateness, lateness_of_own_cycles};
use ecmsk::machine::timing::TimerLateness;
use serde_json::{Map, Value, json};

use super::output_file::{Kind, OutputFile, OverwriteOption};
use super::visible::visible;
use super::{CliError, output};
pub use folder::FolderError;
pub use link::not_in_build;
#[cfg(target_os = "linux")]
use linux as system;
#[cfg(target_os = "linux")]
pub use linux::RuleError;
#[cfg(windows)]
use windows as system;

/// Check whether this machine is set up for a board, and say what to do
///
/// Checks the link that would be used, boards on USB (rights, who has them open, speed, power), SPI and GPIO, the
/// network card of a link nic:, real-time rights, timers and processors. Measures for a second how late threads are
/// woken up. Nothing is changed, and no special rights are needed; root sees more. Nothing is opened except the card of
/// a link nic: if nobody uses it, to measure how long frames take to its slaves and back. `ok`: as it should be,
/// `advice`: could be better, `wrong`: has to be corrected.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk doctor
  ecmsk doctor --quick --json | jq -r 'select(.state == \"wrong\") | .next'
  ecmsk doctor --link nic:eth1
  ecmsk doctor --gadget --link nic:eth0
  ecmsk doctor --report press.tar --link nic:eth1 --flight flight
  ecmsk doctor /mnt/share/press
  sudo ecmsk doctor --write-udev-rule")]
pub struct Args {
    /// Skip the measurements, which take a second: wake-up latency, and how long frames take
    #[arg(long)]
    quick: bool,

    /// Print one JSON object for each finding, each on a line of its own
    #[arg(long)]
    json: bool,

    /// Link to check instead of the one that would be used, see `ecmsk link help`
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse, conflicts_with = "folder")]
    link: Option<LinkUri>,

    /// Pack what the maker's support asks for into this file: versions, this machine, the findings, the machine file, the last
    /// frames of a flight recorder. With --link and a network (nic:, sim:, xf-..:) also its slaves, their EEPROMs and error
    /// counters; these slaves are in Init afterwards. Secrets are left out
    #[arg(long, value_name = "FILE.tar", value_parser = report::file, value_hint = ValueHint::FilePath, conflicts_with_all = ["folder", "json"])]
    report: Option<PathBuf>,

    /// The folder of the flight recorder for --report [default: that of flight= in the link]
    #[arg(long, value_name = "DIR", requires = "report", value_hint = ValueHint::DirPath)]
    flight: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,

    #[command(flatten)]
    system: system::SystemArgs,

    /// Check a Windows program's folder instead, also from Linux: the width (32 or 64 bits) of its programs, and
    /// whether the NEXTWUSBLib.dll and the ecmsk.toml there fit
    #[arg(value_name = "DIR", value_hint = ValueHint::DirPath)]
    folder: Option<PathBuf>,
}

/// The wake-up lateness is measured over [`TIMES`] sleeps of [`PERIOD`]: one second of cycles of 1 ms.
const PERIOD: Duration = Duration::from_millis(1);
const TIMES: usize = 1000;

/// Whether the words `ok`, `advice` and `wrong` of the output are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Paint(bool);

impl Paint {
    /// Coloured on a terminal, unless the variable `NO_COLOR` is set and not empty (no-color.org) or the terminal has
    /// no colours.
    fn of_stdout() -> Self {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let dumb = set("TERM").is_some_and(|term| term == "dumb");
        Self(std::io::stdout().is_terminal() && set("NO_COLOR").is_none() && !dumb)
    }

    fn verdict(self, verdict: FindingVerdict) -> String {
        let text = format!("{verdict:<6}");
        let colour = match verdict {
            FindingVerdict::Fine => 32,
            FindingVerdict::Advice => 33,
            FindingVerdict::Wrong => 31,
        };
        if self.0 { format!("\x1b[{colour}m{text}\x1b[0m") } else { text }
    }
}

/// Checks this machine, or the folder that the command line names, and prints the findings; the exit code says whether
/// something is wrong.
///
/// # Errors
/// [`CliError`] if the folder cannot be read, if the udev rule cannot be written, or if standard output cannot be
/// written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let replace = args.overwrite.replace();
    let report =
        args.report.as_deref().map(|file| OutputFile { file, option: "--report", kind: Kind::Report, replace });
    report.map_or(Ok(()), |report| report.check())?;
    let (findings, wanted) = match &args.folder {
        Some(folder) => (folder::findings(folder)?, None),
        None => match machine(args)? {
            Some(findings) => findings,
            None => return Ok(ExitCode::SUCCESS),
        },
    };
    if args.json {
        output::print(lines(&findings))?;
    } else {
        output::print_coloured(&text(&findings, Paint::of_stdout()))?;
    }
    if let Some(file) = &report {
        let system = system::name(&args.system);
        output::print(report::pack(file, args, &findings, wanted.as_ref(), system)?)?;
    }
    let is_wrong = findings.iter().any(|finding| finding.verdict == FindingVerdict::Wrong);
    Ok(if is_wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Findings, and the link that was judged.
type Found = (Vec<Finding>, Option<LinkUri>);

/// The findings about this machine, and the link that would be used. `None` if `--write-udev-rule` was given: then the rule is
/// written and nothing is checked.
fn machine(args: &Args) -> Result<Option<Found>, CliError> {
    if system::is_done(&args.system)? {
        return Ok(None);
    }
    let (link, wanted) = match &args.link {
        Some(link) => (link::given(link), Some(link.clone())),
        None => link::finding(system::root(&args.system)),
    };
    let mut findings = vec![versions::finding(system::name(&args.system)), link];
    findings.extend(wanted.as_ref().and_then(link::build));
    findings.extend(system::findings(&args.system, wanted.as_ref()));
    if !args.quick {
        let measured = TimerLateness::measure(PERIOD, TIMES);
        let is_own_cycle = wanted.as_ref().is_some_and(|link| link.scheme() == Scheme::Nic);
        findings.push(if is_own_cycle { lateness_of_own_cycles(measured) } else { lateness(measured) });
        findings.extend(system::round_trip(&args.system, wanted.as_ref(), &findings));
    }
    Ok(Some((findings, wanted)))
}

/// The output for a program's folder, as text without colours and as JSON.
///
/// # Errors
/// [`FolderError`] if the folder cannot be read.
pub fn of_folder(folder: &std::path::Path) -> Result<[String; 2], FolderError> {
    let findings = folder::findings(folder)?;
    Ok([text(&findings, Paint(false)), lines(&findings)])
}

fn text(findings: &[Finding], paint: Paint) -> String {
    let name = |finding: &Finding| match &finding.subject {
        Some(subject) => visible(&format!("{} {subject}", finding.check)),
        None => finding.check.to_owned(),
    };
    let width = findings.iter().map(|finding| name(finding).chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for finding in findings {
        // Writing to a String does not fail.
        let verdict = paint.verdict(finding.verdict);
        let _ = writeln!(text, "{verdict}  {:<width$}  {}", name(finding), visible(&finding.found));
        if let Some(next) = finding.next.as_ref().filter(|_| finding.verdict != FindingVerdict::Fine) {
            let _ = writeln!(text, "{:<6}  do: {}", "", visible(next));
        }
    }
    let count = |verdict| findings.iter().filter(|finding| finding.verdict == verdict).count();
    let (wrong, advice) = (count(FindingVerdict::Wrong), count(FindingVerdict::Advice));
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
            "verb": "doctor", "check": finding.check, "subject": finding.subject, "state": finding.verdict.name(),
            "found": finding.found, "next": finding.next, "figures": figures,
        });
        format!("{object}\n")
    };
    findings.iter().map(line).collect()
}
