//! `ecmsk bus`: shows and changes the slaves of a network, over this project's software master or over an ECM-XF.
//!
//! - `session.rs`: the open network that a verb works on
//! - `scan.rs`, `sdo.rs`, `sii.rs`, `foe.rs`, `dc.rs`, `errors.rs`: one verb each; `contents.rs`: the content of an EEPROM as
//!   text
//! - `words.rs`: states, ports and identities as text; `file.rs`: files of this machine
//! - `error.rs`: why a verb failed

mod contents;
mod dc;
mod error;
mod errors;
mod file;
mod foe;
pub mod scan;
mod sdo;
mod session;
mod sii;
pub mod words;

use std::process::ExitCode;

use clap::Subcommand;

pub use error::BusVerbError;
use file::read_file;
use session::{NetworkArgs, Session, SlaveArgs};

/// Inspect a network: its slaves, their objects, EEPROMs and files, the clocks, and bad cables
///
/// The link is a network card with the slaves at its end (nic:eth1), simulated slaves in virtual time (sim:), or a chip
/// ECM-XF (xf-spi:, xf-usb:, xf-sim:). Simulated slaves are switched on anew for each verb. No axis is moved: all
/// slaves go to Init, those whose mailbox is needed to PreOP, and stay there. A network that another program runs is
/// not touched; a network that a chip runs keeps running.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk bus scan --link nic:eth1
  ecmsk bus errors --watch 60 --link nic:eth1
  export ECMSK_LINK='sim:?slaves=drive*3,io'
  ecmsk bus sdo dump 1
  ecmsk bus sii read 2 --output slave2.bin"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Scan(scan::Args),
    Sdo(sdo::Args),
    Sii(sii::Args),
    Foe(foe::Args),
    Dc(dc::Args),
    Errors(errors::Args),
}

/// `bus scan` on a network card, for `ecmsk list --scan`.
///
/// # Errors
/// [`BusVerbError`] if the card does not open, if no slave answers, or if standard output cannot be written to.
pub fn scan_card(card: &str, json: bool) -> Result<(), BusVerbError> {
    scan::show(Session::open(&format!("nic:{card}"), json)?)
}

/// Runs a verb of `ecmsk bus` and prints its results; returns the exit code.
///
/// # Errors
/// [`BusVerbError`] if the command line is wrong, if the network does not open, if a slave fails, or if a file or
/// standard output cannot be used.
pub fn run(args: &Args) -> Result<ExitCode, BusVerbError> {
    match &args.verb {
        Verb::Scan(args) => scan::run(args).map(|()| ExitCode::SUCCESS),
        Verb::Sdo(args) => sdo::run(args).map(|()| ExitCode::SUCCESS),
        Verb::Sii(args) => sii::run(args).map(|()| ExitCode::SUCCESS),
        Verb::Foe(args) => foe::run(args).map(|()| ExitCode::SUCCESS),
        Verb::Dc(args) => dc::run(args),
        Verb::Errors(args) => errors::run(args),
    }
}
