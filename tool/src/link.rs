//! `ecmsk link`: prints the help on links and their keys.

use clap::Subcommand;
use ecmsk::link::keys;

use super::{CliError, output};

/// How to name a board
#[derive(clap::Args)]
#[command(disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Print the form of links: every scheme, and every key with its default
    Help,
}

pub fn run(args: &Args) -> Result<(), CliError> {
    match args.verb {
        Verb::Help => Ok(output::print(keys::help())?),
    }
}
