//! `ecmsk recording`: what is in a recording, and recordings in other formats.
//!
//! Files:
//!
//! - `recording_files.rs`: the verbs
//! - `recording_files/info.rs`: `ecmsk recording info`
//! - `recording_files/export.rs`: `ecmsk recording export`; `table.rs`: the rows of a table; `csv_file.rs`, `mcap_file.rs`,
//!   `arrow_file.rs`: a table in each format
//! - `recording_files/error.rs`: why a verb fails

mod arrow_file;
mod csv_file;
mod error;
mod export;
mod info;
mod mcap_file;
mod table;

use clap::Subcommand;

use super::error::CliError;
pub use error::RecordingVerbError;

/// Say what is in a recording, or write it in another format
///
/// The name of a recording decides its format: FILE.ecmrec is compressed and has an index, for recordings of weeks; FILE.pcapng
/// opens in Wireshark. All verbs read both.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk recording info run.ecmrec
  ecmsk recording export run.ecmrec run.pcapng
  ecmsk recording export run.pcapng run.csv --axes 1,2
  ecmsk recording export day.ecmrec moment.mcap --from 3600 --to 3620"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Info(info::Args),
    Export(export::Args),
}

/// Runs `ecmsk recording`.
///
/// # Errors
/// [`CliError`] if the recording cannot be read, the output file cannot be written, or standard output cannot be written
/// to.
pub fn run(args: &Args) -> Result<(), CliError> {
    match &args.verb {
        Verb::Info(args) => info::run(args),
        Verb::Export(args) => export::run(args),
    }
}
