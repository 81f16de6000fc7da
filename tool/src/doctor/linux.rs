//! Checks a machine with Linux.

mod rule;

use std::path::{Path, PathBuf};

use clap::ValueHint;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::Machine;
use ecmsk::machine::findings::Finding;

use super::CliError;
pub use rule::RuleError;

#[derive(clap::Args)]
pub struct SystemArgs {
    /// Write the udev rule that lets users open boards to /etc/udev/rules.d, show it, and say how it comes into force; who
    /// may not write there is told the lines to type
    #[arg(long, conflicts_with_all = ["quick", "json", "folder"])]
    write_udev_rule: bool,

    /// The folder that /sys, /proc, /dev and /etc are below
    #[arg(long, hide = true, value_name = "DIR", default_value = "/", value_hint = ValueHint::DirPath)]
    root: PathBuf,
}

/// Does what the options ask for instead of findings; returns whether they do.
pub fn is_done(args: &SystemArgs) -> Result<bool, CliError> {
    if args.write_udev_rule {
        rule::write(&Machine::below(&args.root))?;
    }
    Ok(args.write_udev_rule)
}

/// The folder that contains `/etc`.
pub fn root(args: &SystemArgs) -> &Path {
    &args.root
}

/// The name of the system and its release.
pub fn name(args: &SystemArgs) -> Option<String> {
    Machine::below(&args.root).kernel().map(|release| format!("Linux {release}"))
}

/// All findings that need no measurement.
pub fn findings(args: &SystemArgs, wanted: Option<&LinkUri>) -> Vec<Finding> {
    Machine::below(&args.root).findings(wanted)
}
