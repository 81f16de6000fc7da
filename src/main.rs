//! The tool `ecmsk`: runs existing programs on this build's library, shows and plots recordings.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
