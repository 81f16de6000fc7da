//! `cargo xtask bench`: runs the benches, compares their results with the targets, and writes target/bench.json. With `--rig`
//! it runs only the benches of the wires, in a guest system (target/bench-rig.json), with `--windows` only those of the DLLs,
//! under Wine (target/bench-windows.json).

use std::fmt;
use std::fs;

use serde::{Deserialize, Serialize};

use crate::command;
use crate::error::Error;
use crate::needs::{self, CHROMIUM, IP, MCS, MONO, NETWORK_NAMESPACE, Need, PIP, SOEM_SOURCES};
use crate::project::Project;
use crate::{rig, windows};

/// The programs and rights that some of the benches need. A bench for which one is missing is skipped and says so.
const NEEDS: &[Need] = &[CHROMIUM, MCS, MONO, IP, NETWORK_NAMESPACE, PIP, SOEM_SOURCES];

#[derive(clap::Args)]
pub struct Arguments {
    /// Bench to run, a file of benches/ without its extension; `*` matches any letters
    #[arg(default_value = "*")]
    bench: String,
    /// Measure the links usb: and spi: alone: against bare loops on a real kernel's USB, SPI and GPIO code, in a guest
    /// system (QEMU); figures go to target/bench-rig.json
    #[arg(long, conflicts_with = "bench")]
    rig: bool,
    /// Measure the DLLs for Windows alone: from LoadLibrary to an open board, against an empty DLL, under Wine, and on a board
    /// on USB, in a guest system; figures go to target/bench-windows.json
    #[arg(long, conflicts_with_all = ["bench", "rig"])]
    windows: bool,
}

/// One result of a bench: either a comparison (the times of this project and of a baseline) or a single value with a unit.
/// Without a target it is only shown.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Figure {
    name: String,
    /// The median time of this project, in nanoseconds.
    ours_ns: Option<f64>,
    /// The median time of the baseline, in nanoseconds.
    baseline_ns: Option<f64>,
    /// The median of the ratios of this project's time to the baseline's. A measurement times both by turns in short blocks,
    /// and each pair of blocks gives one ratio.
    ratio: Option<f64>,
    /// The largest ratio, or the largest value, with which the bench passes; in every bench a smaller result is better.
    target: Option<f64>,
    /// A comparison also passes, whatever its ratio, if this project takes at most this many nanoseconds longer than the
    /// baseline: between two very short times a large ratio means little.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    allowance_ns: Option<f64>,
    /// The name of the baseline, such as another master.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    against: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
}

impl Figure {
    /// Whether the result is not above its target. A result without a target always passes.
    fn holds(&self) -> bool {
        if let (Some(value), Some(most)) = (self.value, self.target) {
            return value <= most;
        }
        let (Some(ratio), Some(target)) = (self.ratio, self.target) else { return true };
        let allowed = match (self.ours_ns, self.baseline_ns, self.allowance_ns) {
            (Some(ours), Some(baseline), Some(allowance)) => ours - baseline <= allowance,
            _ => false,
        };
        ratio <= target || allowed
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<36}", self.name)?;
        if let (Some(ours), Some(baseline), Some(ratio)) = (self.ours_ns, self.baseline_ns, self.ratio) {
            write!(f, "{ours:>14.1} ns {baseline:>14.1} ns {ratio:>8.3}")?;
            if let Some(target) = self.target {
                write!(f, " {target:>8.3}")?;
                if let Some(allowance) = self.allowance_ns {
                    write!(f, " or +{allowance:.0} ns")?;
                }
                write!(f, "  {}", if self.holds() { "met" } else { "MISSED" })?;
            }
            if let Some(against) = &self.against {
                write!(f, ", against {against}")?;
            }
        }
        if let (Some(value), Some(unit)) = (self.value, &self.unit) {
            write!(f, "{value:>14.1} {unit}")?;
            if let Some(most) = self.target {
                write!(f, ", at most {most:.0}  {}", if self.holds() { "met" } else { "MISSED" })?;
            }
        }
        Ok(())
    }
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    let mut missing = Vec::new();
    let (said, file, again) = if arguments.rig {
        needs::require(project, rig::NEEDS)?;
        (rig::bench(project)?.join("\n"), "bench-rig.json", "cargo xtask bench --rig")
    } else if arguments.windows {
        needs::require(project, windows::NEEDS_BENCH)?;
        println!("keep the machine quiet meanwhile");
        (windows::bench::bench(project)?, "bench-windows.json", "cargo xtask bench --windows")
    } else {
        missing = needs::set_up(project, NEEDS);
        println!("keep the machine quiet meanwhile");
        let mut cargo = project.cargo();
        let said = command::output(cargo.args(["bench", "--workspace", "--bench", &arguments.bench]))?;
        (String::from_utf8_lossy(&said).into_owned(), "bench.json", "cargo xtask bench")
    };
    let figures = read(&said)?;
    if figures.is_empty() {
        return Err(Error::NoFigures);
    }

    println!("{:<36}{:>17} {:>17} {:>8} {:>8}", "name", "ours", "baseline", "ratio", "target");
    for figure in &figures {
        println!("{figure}");
    }
    let path = project.target.join(file);
    let text = serde_json::to_string_pretty(&figures).expect("numbers and names always serialise");
    fs::write(&path, text + "\n").map_err(Error::file("write", &path))?;
    println!("written to {}", project.relative(&path).display());
    if !missing.is_empty() {
        let (what, install) = (needs::names(&missing), needs::install_line(&missing));
        println!("left out: benches that need {what}; to enable: {install}");
    }

    let misses = figures.iter().filter(|figure| !figure.holds()).count();
    let demands = figures.iter().filter(|figure| figure.target.is_some()).count();
    if misses == 0 { Ok(()) } else { Err(Error::Slow { misses, demands, again }) }
}

/// Reads the results from the output of the benches: the lines that are JSON objects.
fn read(said: &str) -> Result<Vec<Figure>, Error> {
    let lines = said.lines().filter(|line| line.starts_with('{'));
    lines
        .map(|line| serde_json::from_str(line).map_err(|source| Error::Figure { line: line.to_owned(), source }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIR: &str = r#"{"name":"a","ours_ns":30.0,"baseline_ns":10.0,"ratio":3.0,"target":2.0}"#;

    #[test]
    fn a_ratio_above_its_target_misses() {
        let figure = |from: &str, to: &str| read(&PAIR.replace(from, to)).unwrap().remove(0);
        assert!(!figure("", "").holds());
        assert!(figure("\"ratio\":3.0", "\"ratio\":2.0").holds());
        assert!(figure("2.0}", "2.0,\"allowance_ns\":20.0}").holds());
        assert!(!figure("2.0}", "2.0,\"allowance_ns\":19.9}").holds());
        let named = figure("2.0}", "2.0,\"against\":\"a bare loop\"}");
        assert!(named.to_string().ends_with("MISSED, against a bare loop"), "{named}");
        let known = figure("\"target\":2.0", "\"target\":null,\"against\":\"a bare loop\"");
        assert!(known.holds() && known.to_string().ends_with("3.000, against a bare loop"), "{known}");
    }

    #[test]
    fn lines_that_are_no_figures_are_passed_over_and_broken_ones_are_errors() {
        let fact =
            r#"{"name":"b","ours_ns":null,"baseline_ns":null,"ratio":null,"target":null,"value":4.0,"unit":"bytes"}"#;
        let figures = read(&format!("measuring\n{PAIR}\n\n{fact}\n")).unwrap();
        assert_eq!(figures.len(), 2);
        assert!(figures[1].holds() && figures[1].to_string().ends_with("4.0 bytes"));
        let limited = |most: &str| read(&fact.replace("\"target\":null", most)).unwrap().remove(0);
        assert!(limited("\"target\":4.0").holds());
        let missed = limited("\"target\":3.0");
        assert!(!missed.holds() && missed.to_string().ends_with("4.0 bytes, at most 3  MISSED"));
        assert!(read("{\"name\":3}").is_err());
    }
}
