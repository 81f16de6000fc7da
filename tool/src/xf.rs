//! `ecmsk xf`: the verbs that talk to an ECM-XF.
//!
//! - `session.rs`: the open chip that a verb works on: its options, opening it without disturbing a running network, bringing
//!   its network up
//! - `commands.rs`, `scan.rs`, `info.rs`, `state.rs`, `sdo.rs`, `pdo.rs`, `gpio.rs`, `adc.rs`, `dac.rs`, `encoder.rs`: one verb
//!   each; `raw.rs`: any function of the chip, with its fields as text in `raw/`
//! - `words.rs`: names of states and options as the tool writes them
//! - `tests.rs`: verbs on a chip that keeps running between them
//! - `error.rs`: why a verb failed

mod adc;
mod commands;
mod dac;
mod encoder;
mod error;
mod gpio;
mod info;
mod pdo;
mod raw;
mod scan;
mod sdo;
mod session;
mod state;
#[cfg(test)]
mod tests;
mod words;

use clap::Subcommand;

use serde_json::Value;

pub use error::XfVerbError;
use session::{ChipArgs, Session};

/// Talk to a chip ECM-XF, an EtherCAT master behind SPI or USB, or to a simulated one
///
/// A chip has no default link: name it with --link, or with ECMSK_LINK. Slaves are numbered as the chip does, from 0. A
/// verb changes nothing but what its name says: the FIFO keeps running with its content, and a network that is up stays
/// up. `info` shows the errors that the chip has stored, and clears them.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk xf scan --link 'xf-sim:?slaves=drive*3,io'
  ecmsk xf commands
  export ECMSK_LINK='xf-sim:?slaves=drive*3,io'
  ecmsk xf info
  ecmsk xf sdo read 0 0x6041"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Commands(commands::Args),
    Scan(scan::Args),
    Info(info::Args),
    Sdo(sdo::Args),
    Pdo(pdo::Args),
    State(state::Args),
    Gpio(gpio::Args),
    Adc(adc::Args),
    Dac(dac::Args),
    Encoder(encoder::Args),
    Raw(raw::Args),
}

/// The result of a verb: lines of text without the last line feed, and a JSON object.
type Shown = (String, Value);

/// Runs `ecmsk xf`.
///
/// # Errors
/// [`XfVerbError`] if the command line is invalid, the chip cannot be opened or refuses a command, a slave does not answer,
/// or standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), XfVerbError> {
    match &args.verb {
        Verb::Commands(args) => commands::run(args),
        Verb::Scan(args) => on_chip(&args.chip, |session| scan::scan(session, args.force)),
        Verb::Info(args) => on_chip(&args.chip, info::info),
        Verb::Sdo(args) => args.check().and_then(|()| on_chip(args.chip(), |session| args.run(session))),
        Verb::Pdo(args) => on_chip(&args.chip, |session| pdo::pdo(session, args.slave)),
        Verb::Gpio(args) => on_chip(args.chip(), |session| args.run(session)),
        Verb::Adc(args) => on_chip(&args.chip, |session| adc::adc(session, args.differential)),
        Verb::Dac(args) => on_chip(&args.chip, |session| dac::dac(session, args.output)),
        Verb::Encoder(args) => on_chip(args.chip(), |session| args.run(session)),
        Verb::Raw(args) => raw::run(args),
        Verb::State(args) => on_chip(&args.chip, |session| state::state(session, args.to, args.slave)),
    }
}

/// Opens the chip, runs a verb on it and prints the results.
fn on_chip(
    chip: &ChipArgs,
    verb: impl FnOnce(&mut Session) -> Result<Vec<Shown>, XfVerbError>,
) -> Result<(), XfVerbError> {
    let mut session = chip.open()?;
    let shown = verb(&mut session);
    let Session { xf, reporter, .. } = session;
    // The chip keeps running in the state in which the verb has left it, so that the next call of the tool finds it so.
    xf.leave();
    for (text, json) in shown? {
        reporter.result(text, &json)?;
    }
    Ok(())
}
