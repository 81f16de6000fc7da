//! `ecmsk machine`: the machine file: made from a network, compared with one, and its schema.
//!
//! Files:
//!
//! - `machine.rs`: the verbs
//! - `machine/network.rs`: the slaves of a network or behind a board, by their identities and kinds
//! - `machine/template.rs`: the text of a new file
//! - `machine/compared.rs`: where a network differs from a file

mod compared;
mod network;
mod template;

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Subcommand, ValueHint};
use ecmsk::bus::BusError;
use ecmsk::ecm::{Config, ConfigError, EcmError};
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::{self, FILE_NAME, MachineFile, MachineFileError};
use ecmsk::sk::SlotSize;
use serde_json::json;

use super::board::Reporter;
use super::link_option::ChosenLink;
use super::output_file::{Kind, OutputFile, OutputFileError, Replace};
use super::{link_option, output};

/// Make a machine file, compare it with the network, or print its schema
///
/// A machine file (machine.toml) names the axes of a machine and has their units, limits and homing, the devices that the slaves
/// have to be, inputs and outputs by name, texts of alarms, and the link. Verbs use the one in the working directory, or that
/// of --machine.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk machine new nic:eth1
  ecmsk machine check
  ecmsk machine check --link
  ecmsk move X=12.5 Y=-3 --up
  ecmsk machine schema > machine.schema.json

Exit codes of check: 0 nothing is wrong, 1 the network differs, 2 it could not be compared."
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Ask a network which slaves it has, and write a machine file with them
    ///
    /// The slaves of a network without a board (nic:, xf-spi:) are in Init afterwards; behind a board the network has
    /// to be in PreOP.
    New {
        /// Network or board to ask, see `ecmsk link help`
        #[arg(value_name = "LINK", value_parser = LinkUri::parse)]
        link: LinkUri,
        /// Machine file to write; - for standard output
        #[arg(long, short, value_name = "FILE", default_value = FILE_NAME, value_hint = ValueHint::FilePath)]
        output: PathBuf,
        /// Replace a file that is there
        #[arg(long)]
        overwrite: bool,
    },
    /// Check a machine file; with --link, compare it with the slaves that are there
    Check {
        /// Machine file to check
        #[arg(value_name = "FILE", default_value = FILE_NAME, value_hint = ValueHint::FilePath)]
        file: PathBuf,
        /// Compare with this network or board [without URI: ECMSK_LINK, else the link of the file, else that of
        /// ecmsk.toml]
        #[arg(long, value_name = "URI", num_args = 0..=1, value_parser = LinkUri::parse)]
        link: Option<Option<LinkUri>>,
        /// Print JSON, one object a line
        #[arg(long)]
        json: bool,
    },
    /// Print the JSON schema of machine files, by which an editor completes and checks them
    Schema,
}

/// Why a verb of machine files failed. Every text ends with the next step.
#[derive(Debug, thiserror::Error)]
pub enum MachineVerbError {
    /// Standard output cannot be written to.
    #[error("cannot write to standard output: {0}; send it to a place with room, e.g. `> FILE`")]
    Output(#[from] io::Error),
    /// The machine file cannot be read or is invalid.
    #[error(transparent)]
    File(#[from] MachineFileError),
    /// No board can run the slaves of the machine file.
    #[error("{file}: {error}")]
    Config {
        /// The path of the machine file.
        file: String,
        /// Why no board can run these slaves.
        error: ConfigError,
    },
    /// The machine file cannot be written, or is there and stays.
    #[error(transparent)]
    NewFile(#[from] OutputFileError),
    /// `ECMSK_LINK` or a configuration file with the link is invalid.
    #[error(transparent)]
    Choice(#[from] link_option::ChoiceError),
    /// No link to compare with is named: neither by `--link`, ECMSK_LINK or ecmsk.toml nor by the machine file.
    #[error("no network or board was named: neither --link nor the file names one; give it, e.g. --link nic:eth1")]
    NoLink,
    /// No slave answers behind the link.
    #[error("no slave answers behind `{link}`; check cables and power, and try again")]
    NoSlave {
        /// The link of the network or board, as the user has named it.
        link: String,
    },
    /// The network or a slave reports an error, or does not answer.
    #[error(transparent)]
    // Boxed, because every error is as large as its largest variant.
    Bus(Box<BusError>),
    /// The board or a slave behind it reports an error, or does not answer.
    #[error(transparent)]
    Ecm(#[from] EcmError),
    /// `ecmsk machine check` has ended without a result, for the reason given here. The exit code is then 2.
    #[error(transparent)]
    NotCompared(Box<MachineVerbError>),
}

impl MachineVerbError {
    /// The exit code: 2 if a check has ended without a result, otherwise 1.
    pub const fn code(&self) -> u8 {
        match self {
            Self::NotCompared(_) => crate::compare::TROUBLE,
            _ => 1,
        }
    }
}

impl From<BusError> for MachineVerbError {
    fn from(error: BusError) -> Self {
        Self::Bus(Box::new(error))
    }
}

/// Writes a machine file, checks one or prints the schema; the exit code says whether a check found differences.
///
/// # Errors
/// [`MachineVerbError`] if the machine file cannot be used or written, if the network or board does not open or has no
/// slave, or if standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, MachineVerbError> {
    match &args.verb {
        Verb::New { link, output, overwrite } => new(link, output, *overwrite),
        Verb::Check { file, link, json } => {
            check(file, link.as_ref(), *json).map_err(|error| MachineVerbError::NotCompared(Box::new(error)))
        }
        Verb::Schema => {
            let schema = serde_json::to_string_pretty(&machine_file::schema()).map_err(io::Error::other)?;
            output::print(format!("{schema}\n"))?;
            Ok(ExitCode::SUCCESS)
        }
    }
}

fn new(link: &LinkUri, file: &Path, overwrite: bool) -> Result<ExitCode, MachineVerbError> {
    let is_stdout = file == Path::new("-");
    let output = OutputFile { file, option: "--output", kind: Kind::Any, replace: Replace::Asked(overwrite) };
    // This is checked before a network is reset.
    if !is_stdout {
        output.check()?;
    }
    let found = network::slaves(link)?;
    let text = template::text(link, &found);
    if is_stdout {
        output::print(text)?;
        return Ok(ExitCode::SUCCESS);
    }
    output.write(text.as_bytes())?;
    let slaves = output::counted(found.len(), "slave");
    output::print(format!("{}: {slaves}; name its axes and set their units\n", file.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// The highest homing method of CiA 402.
const HOMING_METHOD_MAX: i8 = 37;

/// Prints notes on values in a machine file that are allowed, but probably not intended.
fn advise(reporter: &Reporter, machine: &MachineFile) {
    for axis in &machine.axes {
        let name = &axis.name;
        // CiA 402 has the methods from 1 on; those below 0 are vendor-specific.
        if let Some(method) = axis.homing.method.filter(|method| *method == 0 || *method > HOMING_METHOD_MAX) {
            reporter.note(format_args!(
                "axis {name} has homing method {method}, which CiA 402 does not have: it has 1 to {HOMING_METHOD_MAX}, and those \
                 below 0 are the maker's; see the manual of the drive"
            ));
        }
        let has = [axis.limits.min != i32::MIN, axis.limits.max != i32::MAX];
        // With a unit in the opposite direction the lowest position has the highest count.
        let [has_min, has_max] = if axis.scale.counts_per_unit < 0.0 { [has[1], has[0]] } else { has };
        let (has, lacks) = match (has_min, has_max) {
            (false, true) => ("max", "min"),
            (true, false) => ("min", "max"),
            _ => continue,
        };
        reporter
            .note(format_args!("axis {name} has {has} and no {lacks}, so that nothing limits it there; add {lacks}"));
    }
}

fn check(file: &Path, link: Option<&Option<LinkUri>>, json: bool) -> Result<ExitCode, MachineVerbError> {
    let machine = MachineFile::load(file)?;
    let shown = file.display().to_string();
    let config = Config::of_machine(&machine);
    config.check(SlotSize::Bytes12).map_err(|error| MachineVerbError::Config { file: shown.clone(), error })?;
    let (slaves, axes) = (machine.slaves.len(), machine.axes.len());
    let Some(link) = link else {
        let reporter = Reporter::new(json, false);
        let line = json!({"verb": "machine check", "file": shown, "slaves": slaves, "axes": axes});
        reporter.result(format_args!("{shown}: nothing is wrong; slaves: {slaves}, axes: {axes}"), &line)?;
        advise(&reporter, &machine);
        return Ok(ExitCode::SUCCESS);
    };
    let chosen = ChosenLink::find_with(link.as_ref(), Some(&machine))?;
    if !chosen.is_named() {
        return Err(MachineVerbError::NoLink);
    }
    let found = network::slaves(&chosen.uri)?;
    let reporter = Reporter::new(json, false);
    let differences = compared::differences(&machine, &found);
    for difference in &differences {
        let mut line = json!({"verb": "machine check", "file": shown});
        difference.put(&mut line);
        reporter.result(format_args!("{difference}"), &line)?;
    }
    if !differences.is_empty() {
        return Ok(ExitCode::FAILURE);
    }
    let line =
        json!({"verb": "machine check", "file": shown, "slaves": slaves, "axes": axes, "link": chosen.uri.to_string()});
    reporter.result(format_args!("{shown}: nothing is wrong; slaves: {slaves}, as they are there"), &line)?;
    advise(&reporter, &machine);
    Ok(ExitCode::SUCCESS)
}
