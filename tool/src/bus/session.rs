//! The open network for a verb of `ecmsk bus`, and the options that name it.

use std::path::PathBuf;

use clap::ValueHint;
use ecmsk::bus::{self, BusError, FoundSlave, Network};
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::MachineFile;

use super::BusVerbError;
use super::words::state_text;
use crate::board::{AxisWord, Reporter};
use crate::link_option::ChosenLink;
use crate::machine_option;

// No doc comments on `NetworkArgs` and `SlaveArgs`: clap would show them as the help of every verb.
#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct NetworkArgs {
    /// Network to inspect: nic:INTERFACE, sim:?slaves=.. or a chip, see `ecmsk link help` [default: ECMSK_LINK, else
    /// the one of machine.toml or ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct SlaveArgs {
    /// The slave, from 1 in the order of the cable, or the name of its axis in the machine file
    #[arg(value_name = "SLAVE", value_parser = AxisWord::of_slave)]
    slave: AxisWord,
    #[command(flatten)]
    network: NetworkArgs,
}

impl SlaveArgs {
    /// Opens the network and checks that it has the slave of the command line; also returns the number of this slave.
    ///
    /// # Errors
    /// As [`NetworkArgs::open`]; the machine file has no axis with that name; [`BusError::NoSuchSlave`] if the scan has
    /// found no slave with that number.
    pub fn open(&self) -> Result<(Session, u8), BusVerbError> {
        let (chosen, machine) = self.network.find(Some(&self.slave))?;
        let slave = self.slave.slave("bus", machine.as_ref()).map_err(Box::new)?;
        let session = self.network.open_chosen(&chosen)?;
        let found = session.slaves.len();
        if !session.slaves.iter().any(|found| found.slave == slave) {
            return Err(BusError::NoSuchSlave { slave, found }.into());
        }
        Ok((session, slave))
    }
}

/// An open network and the slaves that a scan has found in it.
pub struct Session {
    pub network: Box<dyn Network>,
    pub slaves: Vec<FoundSlave>,
    pub reporter: Reporter,
}

impl NetworkArgs {
    /// Opens the network and scans it for slaves. If opening the network has brought a slave from a higher state to
    /// Init, a note is printed.
    ///
    /// # Errors
    /// The command line names no network, the network does not open, or it has no slave.
    pub fn open(&self) -> Result<Session, BusVerbError> {
        self.open_chosen(&self.find(None)?.0)
    }

    /// The link and the machine file for a verb. `word` is the slave in its command line.
    fn find(&self, word: Option<&AxisWord>) -> Result<(ChosenLink, Option<MachineFile>), BusVerbError> {
        let (chosen, machine) = ChosenLink::find_for(self.link.as_ref(), self.machine.as_deref(), word)?;
        if chosen.is_named() { Ok((chosen, machine)) } else { Err(BusVerbError::NoLink) }
    }

    fn open_chosen(&self, chosen: &ChosenLink) -> Result<Session, BusVerbError> {
        crate::recording_end::note_opened(&chosen.uri);
        Session::open(&chosen.uri.to_string(), self.json)
    }
}

impl Session {
    /// Opens the network of a link, as [`NetworkArgs::open`] does.
    ///
    /// # Errors
    /// The network does not open, or has no slave.
    pub fn open(link: &str, json: bool) -> Result<Self, BusVerbError> {
        let mut network = bus::open(link)?;
        let slaves = network.scan()?;
        let reporter = Reporter::new(json, network.is_virtual());
        let resets = network.resets_slaves();
        for slave in slaves.iter().filter(|slave| resets && slave.found.status.state().code() > 1) {
            let found = state_text(slave.found);
            reporter.note(format_args!("slave {} was found in {found}, and was brought to Init", slave.slave));
        }
        Ok(Self { network, slaves, reporter })
    }
}
