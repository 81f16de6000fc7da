//! `bus errors`: shows the error counters of all ports, and which cable is bad.

use std::process::ExitCode;
use std::time::Duration;

use ecmsk::bus::port_errors::{self, CablePort, PortErrors, Problem, ProblemPlace, SlaveErrors};
use ecmsk::bus::{BusError, FoundSlave, Network};
use serde_json::{Value, json};

use super::scan::{counted, port_json};
use super::words::ports;
use super::{BusVerbError, NetworkArgs, Session};
use crate::board::Reporter;

/// Read the error counters of all ports (registers 0x0300 to 0x0313), and say which cable is bad
///
/// Slaves count from when they were switched on. Plugging and unplugging a cable counts, too: clear the counters, let
/// the machine run, and read them again, or watch them. The exit code is 1 if something is wrong.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk bus errors --link nic:eth1
  ecmsk bus errors --clear --link nic:eth1
  ecmsk bus errors --watch 60 --link nic:eth1   # and move the cables meanwhile")]
pub struct Args {
    /// Send long frames for so many seconds, and show after each second what was counted in it
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    watch: Option<u64>,

    /// Clear all counters after reading them
    #[arg(long, conflicts_with = "watch")]
    clear: bool,

    #[command(flatten)]
    network: NetworkArgs,
}

/// Prints the error counters and the problems that they show. The exit code is 1 if there is a problem.
///
/// # Errors
/// [`BusVerbError`] if the network does not open, if no slave answers, if the counters cannot be read or cleared, or if
/// standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, BusVerbError> {
    let Session { mut network, slaves, reporter } = args.network.open()?;
    let counters = match args.watch {
        None => {
            let counters = port_errors::read(&mut *network, &slaves)?;
            show(&slaves, &counters, None, &reporter)?;
            counters
        }
        Some(seconds) => watch(&mut *network, &slaves, seconds, &reporter)?,
    };
    let problems = port_errors::judge(&slaves, &counters);
    for problem in &problems {
        reporter.result(text(problem), &trouble_json(problem))?;
    }
    if let Some(frames) = network.frames().filter(|frames| frames.lost > 0) {
        reporter.note(format_args!("{} of {} frames did not come back", frames.lost, frames.sent));
    }
    if args.clear {
        port_errors::clear(&mut *network, &slaves)?;
        reporter.note("the counters of all slaves were cleared");
    }
    if problems.is_empty() {
        reporter.note(match args.watch {
            Some(_) => "nothing was counted meanwhile",
            None => "no cable is bad, as far as it was counted",
        });
        return Ok(ExitCode::SUCCESS);
    }
    Ok(ExitCode::FAILURE)
}

/// Shows after each second the errors that the slaves have counted in that second. Returns the counts of the whole
/// time.
fn watch(
    network: &mut dyn Network,
    slaves: &[FoundSlave],
    seconds: u64,
    reporter: &Reporter,
) -> Result<Vec<SlaveErrors>, BusVerbError> {
    let first = port_errors::read(network, slaves)?;
    let mut before = first.clone();
    for second in 1..=seconds {
        network.load(Duration::from_secs(1))?;
        let mut now = before.clone();
        for of in &mut now {
            match port_errors::read_one(network, of.slave) {
                Ok(read) => *of = read,
                // A slave that does not answer keeps its last reading. Its new errors are shown when it answers again.
                Err(BusError::Register { .. }) => {
                    let text = format!("{second:>4} s  slave {}: it does not answer", of.slave);
                    let json = json!({ "verb": "bus errors", "second": second, "slave": of.slave, "answers": false });
                    reporter.result(text, &json)?;
                }
                Err(error) => return Err(error.into()),
            }
        }
        show(slaves, &since(&now, &before), Some(second), reporter)?;
        before = now;
    }
    Ok(since(&before, &first))
}

/// The errors that were counted between the reading `then` and the reading `now`.
fn since(now: &[SlaveErrors], then: &[SlaveErrors]) -> Vec<SlaveErrors> {
    now.iter().zip(then).map(|(now, then)| now.since(then)).collect()
}

/// Shows the error counters. `second` is the second of a watch; then only slaves with new errors are shown. With `None`
/// all slaves are shown.
fn show(
    slaves: &[FoundSlave],
    counters: &[SlaveErrors],
    second: Option<u64>,
    reporter: &Reporter,
) -> Result<(), BusVerbError> {
    for (slave, errors) in slaves.iter().zip(counters) {
        if second.is_some() && *errors == (SlaveErrors { slave: errors.slave, ..SlaveErrors::default() }) {
            continue;
        }
        let mut parts: Vec<String> = ports(slave)
            .filter_map(|port| {
                let counted = counted(&errors.ports[port]);
                (!counted.is_empty()).then(|| format!("port {port}: {}", counted.join(", ")))
            })
            .collect();
        parts.extend((errors.processing_unit > 0).then(|| format!("{} frames that are wrong", errors.processing_unit)));
        parts.extend((errors.pdi > 0).then(|| format!("{} errors of its own controller", errors.pdi)));
        let counted = if parts.is_empty() { "nothing".to_owned() } else { parts.join("; ") };
        let text = match second {
            None => format!("slave {}: {counted}", slave.slave),
            Some(second) => format!("{second:>4} s  slave {}: {counted}", slave.slave),
        };
        let port = |port: usize| {
            let mut json = port_json(&errors.ports[port]);
            json["port"] = port.into();
            json
        };
        let json = json!({
            "verb": "bus errors", "second": second, "slave": slave.slave, "answers": true,
            "ports": ports(slave).map(port).collect::<Vec<_>>(),
            "processing_unit_errors": errors.processing_unit, "pdi_errors": errors.pdi,
        });
        reporter.result(text, &json)?;
    }
    Ok(())
}

/// The text for a problem of a cable or a slave, with the next step.
fn text(problem: &Problem) -> String {
    let Problem { place, near, far, count } = problem;
    match place {
        ProblemPlace::Cable { near: from, far: to } => {
            let seen = [(from, near), (to, far)].into_iter().filter_map(|(end, errors)| {
                let counted = counted(&PortErrors { forwarded: 0, ..*errors });
                end.filter(|_| !counted.is_empty()).map(|end| format!("slave {} has {}", end.slave, counted.join(", ")))
            });
            let seen = seen.collect::<Vec<_>>().join(", ");
            let damages = [near, far].into_iter().any(|errors| errors.invalid > 0 || errors.physical > 0);
            let next = match (damages, to) {
                (true, _) => {
                    "change it, look at its plugs and at what it lies beside, clear the counters and watch them"
                }
                (false, Some(_)) => {
                    "its plug is loose, or a slave at it was without power; clear the counters and watch them"
                }
                (false, None) => "it was unplugged, or what was there has no power",
            };
            format!("bad: {}: {seen}; {next}", cable(*from, *to))
        }
        ProblemPlace::Slave(slave) => {
            format!(
                "bad: slave {slave} itself: {count} errors of its own controller; switch it off and on, or change it"
            )
        }
        ProblemPlace::Master => {
            format!("bad: the master: {count} of its frames are wrong; nobody else may send on this network")
        }
    }
}

/// A cable as text, with the slaves at its ends.
fn cable(near: Option<CablePort>, far: Option<CablePort>) -> String {
    let end = |end: CablePort| format!("slave {}, port {}", end.slave, end.port);
    match (near, far) {
        (None, Some(far)) => format!("the cable from the master to {}", end(far)),
        (Some(near), Some(far)) => format!("the cable from {} to {}", end(near), end(far)),
        (Some(near), None) => format!("what was connected to {}", end(near)),
        (None, None) => "the cable at the master".to_owned(),
    }
}

fn trouble_json(problem: &Problem) -> Value {
    let Problem { place, near, far, count } = problem;
    let end = |end: Option<CablePort>| end.map(|end| json!({ "slave": end.slave, "port": end.port }));
    let mut json = match place {
        ProblemPlace::Cable { near: from, far: to } => json!({
            "bad": "cable", "near": end(*from), "far": end(*to), "near_counted": port_json(near),
            "far_counted": port_json(far),
        }),
        ProblemPlace::Slave(slave) => json!({ "bad": "slave", "slave": slave, "count": count }),
        ProblemPlace::Master => json!({ "bad": "master", "count": count }),
    };
    json["verb"] = "bus errors".into();
    json
}
