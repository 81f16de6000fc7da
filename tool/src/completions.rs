//! `ecmsk completions`: a completion script for a shell.

use clap::CommandFactory;
use clap_complete::Shell;

use super::{CliError, output};

/// Print a completion script for a shell
#[derive(clap::Args)]
#[command(after_help = "\
Where it goes:
  bash  ecmsk completions bash > ~/.local/share/bash-completion/completions/ecmsk
  zsh   ecmsk completions zsh  > a folder of $fpath, as `_ecmsk`
  fish  ecmsk completions fish > ~/.config/fish/completions/ecmsk.fish
  PowerShell  ecmsk completions powershell >> $PROFILE")]
pub struct Args {
    /// Shell of the script
    shell: Shell,
}

pub fn run(args: &Args) -> Result<(), CliError> {
    // The generator panics if it cannot write, so it writes to memory.
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::Cli::command(), "ecmsk", &mut script);
    Ok(output::print(script)?)
}
