//! Checks whether a Linux machine can run a board.

mod rule;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::ValueHint;
use ecmsk::bus::{self, RoundTrips};
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

use super::CliError;
use crate::output::counted;
pub use rule::RuleError;

#[derive(clap::Args)]
pub struct SystemArgs {
    /// Write the udev rule that lets users open boards to /etc/udev/rules.d, show it, and say how to activate it;
    /// without the right to write there, print the lines to type
    #[arg(long, conflicts_with_all = ["quick", "json", "folder", "report"])]
    write_udev_rule: bool,

    /// Check as well whether this machine can be the board at a USB device port (`ecmsk serve gadget`): the device
    /// controller, configfs, FunctionFS, rights
    #[arg(long, conflicts_with_all = ["write_udev_rule", "folder"])]
    gadget: bool,

    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,
}

/// Writes the udev rule if `--write-udev-rule` is given. Returns whether it is given, since nothing else is checked
/// then.
pub fn is_done(args: &SystemArgs) -> Result<bool, CliError> {
    if args.write_udev_rule {
        rule::write(&Machine::below(&args.root))?;
    }
    Ok(args.write_udev_rule)
}

/// The folder that is used as `/`, from the hidden option `--root`.
pub fn root(args: &SystemArgs) -> &Path {
    &args.root
}

/// The name and release of the operating system; `None` if it is unknown.
pub fn name(args: &SystemArgs) -> Option<String> {
    Machine::below(&args.root).kernel().map(|release| format!("Linux {release}"))
}

/// The findings about this machine, except those that need a measurement.
pub fn findings(args: &SystemArgs, wanted: Option<&LinkUri>) -> Vec<Finding> {
    let machine = Machine::below(&args.root);
    let mut findings = machine.findings(wanted);
    if args.gadget {
        findings.extend(machine.gadget_findings());
    }
    findings
}

/// \[OURS] The number of frames that are sent to measure round-trip times.
const ROUND_TRIPS: u32 = 1000;
/// \[OURS] The limit for the 99th percentile of the round-trip times. A longer round trip would take more than half of
/// a 1 ms cycle.
const ROUND_TRIP_MAX: Duration = Duration::from_micros(500);

/// The finding about the round-trip times on the card of a `nic:` link. `None` for any other link, or if other findings
/// show that the card cannot be opened.
pub fn round_trip(args: &SystemArgs, wanted: Option<&LinkUri>, findings: &[Finding]) -> Option<Finding> {
    let link = wanted.filter(|link| link.scheme() == Scheme::Nic)?;
    if args.root != Path::new("/") || findings.iter().any(|finding| finding.blocks) {
        return None;
    }
    Some(judge(bus::round_trips(link, ROUND_TRIPS).map_err(|error| error.to_string())).of(link.path()))
}

fn judge(measured: Result<Option<RoundTrips>, String>) -> Finding {
    const CHECK: &str = "round-trip";
    let RoundTrips { slaves, lost, p50, p99, max } = match measured {
        Ok(Some(measured)) => measured,
        Ok(None) => {
            let next = "look at the cable to the first slave and at the slaves' power";
            return Finding::wrong(CHECK, "no frame comes back", next);
        }
        Err(error) => {
            let (found, next) = super::link::split(&error);
            return Finding::wrong(CHECK, found, next);
        }
    };
    let us = |time: Duration| i64::try_from(time.as_micros()).unwrap_or(i64::MAX);
    let passed = counted(slaves, "slave");
    let found = format!(
        "{passed}: {} us (half of the frames), {} us (99 of 100), {} us (the worst); {lost} of {ROUND_TRIPS} lost",
        us(p50),
        us(p99),
        us(max)
    );
    let finding = match (lost, p99 <= ROUND_TRIP_MAX) {
        (0, true) => Finding::fine(CHECK, found),
        (0, false) => Finding::advice(CHECK, found, "see what holds frames back above, or take a longer cycle"),
        _ => Finding::wrong(CHECK, found, "look for the bad cable with `ecmsk bus errors`"),
    };
    finding
        .figure("slaves", slaves.into())
        .figure("p50_us", us(p50))
        .figure("p99_us", us(p99))
        .figure("max_us", us(max))
        .figure("lost", lost.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecmsk::machine::findings::FindingVerdict;

    /// A 99th percentile above the limit gives advice. Lost frames, and a card that cannot be opened, are errors.
    #[test]
    fn round_trips_are_judged() {
        let us = Duration::from_micros;
        let measured = |p99, lost| Ok(Some(RoundTrips { slaves: 3, lost, p50: us(60), p99: us(p99), max: us(900) }));
        let good = judge(measured(500, 0));
        assert_eq!(good.verdict, FindingVerdict::Fine);
        assert!(good.found.starts_with("3 slaves: 60 us (half of the frames), 500 us (99 of 100)"), "{}", good.found);
        assert_eq!(judge(measured(501, 0)).verdict, FindingVerdict::Advice);
        let lost = judge(measured(100, 2));
        assert!(lost.verdict == FindingVerdict::Wrong && lost.found.ends_with("2 of 1000 lost"), "{lost:?}");
        assert_eq!(lost.figures.last(), Some(&("lost", 2)));
        assert_eq!(judge(Ok(None)).verdict, FindingVerdict::Wrong);
        let refused = judge(Err("it is in use; end that program".to_owned()));
        assert_eq!((refused.found.as_str(), refused.next.as_deref()), ("it is in use", Some("end that program")));
    }
}
