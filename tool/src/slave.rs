//! `ecmsk slave`: the files that describe a simulated slave to masters.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Subcommand, ValueHint};
use ecmsk::link::simulated_slaves::{self, SimulatedSlavesError};
use ecmsk::link::slaves::{self, SlaveSpec};
use ecmsk::slave::esc::{DescriptionError, eeprom_of, esi_of};

use super::CliError;
use super::output_file::{Kind, OutputFile, OutputFileError, OverwriteOption};

/// Write the EEPROM or the ESI file of a kind of simulated slave
///
/// These files describe what `ecmsk serve ethercat` shows to masters: identity, sync managers, process data,
/// distributed clocks.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk slave esi dp3cl > dp3cl.xml
  ecmsk slave sii drive --output drive.bin"
)]
pub struct Args {
    #[command(subcommand)]
    file: File,
}

#[derive(Subcommand)]
enum File {
    /// The ESI file (XML), which TwinCAT and other tools read
    Esi(Of),
    /// The content of the EEPROM (SII), bytes
    Sii(Of),
}

#[derive(clap::Args)]
struct Of {
    /// The kind of slave, as in a sim: link
    #[arg(value_parser = kind)]
    kind: SlaveSpec,

    /// File to write to [default: standard output]
    #[arg(short, long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    output: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,
}

/// Why the EEPROM or the ESI file was not made. Every error text ends with what the user can do next.
#[derive(Debug, thiserror::Error)]
pub enum SlaveError {
    /// The slave cannot be simulated, for example because one of its files cannot be read.
    #[error(transparent)]
    Slaves(#[from] SimulatedSlavesError),
    /// The simulated slave cannot be described: it refuses PreOP, it lacks one of the objects 0x1018, 0x1C12 and 0x1C13, or its
    /// description does not fit into an EEPROM.
    #[error(transparent)]
    Description(#[from] DescriptionError),
    /// An EEPROM cannot be shown on a terminal, because it is binary.
    #[error("an EEPROM is bytes, not for a terminal; name a file with --output")]
    Terminal,
    /// The output file cannot be written, or is there and stays.
    #[error(transparent)]
    File(#[from] OutputFileError),
}

fn kind(text: &str) -> Result<SlaveSpec, String> {
    let mut slaves = slaves::parse(text)?;
    match (slaves.pop(), slaves.is_empty()) {
        (Some(slave), true) => Ok(slave),
        _ => Err("allowed: one kind of slave".to_owned()),
    }
}

pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let (of, kind, bytes) = match &args.file {
        File::Esi(of) => (of, Kind::Esi, esi(of)?),
        File::Sii(of) => {
            if of.output.is_none() && io::stdout().is_terminal() {
                return Err(SlaveError::Terminal.into());
            }
            (of, Kind::Eeprom, sii(of)?)
        }
    };
    match &of.output {
        // The EEPROM is binary, and `output` prints only text.
        None => io::stdout().lock().write_all(&bytes)?,
        Some(file) => {
            let output = OutputFile { file, option: "--output", kind, replace: of.overwrite.replace() };
            output.write(&bytes).map_err(SlaveError::from)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn esi(of: &Of) -> Result<Vec<u8>, SlaveError> {
    let mut devices = simulated_slaves::build(std::slice::from_ref(&of.kind))?;
    let settings = devices[0].controller_settings();
    Ok(esi_of(&mut *devices[0], &settings)?.into_bytes())
}

fn sii(of: &Of) -> Result<Vec<u8>, SlaveError> {
    let mut devices = simulated_slaves::build(std::slice::from_ref(&of.kind))?;
    let settings = devices[0].controller_settings();
    Ok(eeprom_of(&mut *devices[0], &settings)?)
}
