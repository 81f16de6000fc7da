//! The open network that a verb of `ecmsk bus` works on, and the options that name it.

use ecmsk::bus::{self, BusError, FoundSlave, Network};
use ecmsk::link::uri::LinkUri;

use super::BusVerbError;
use super::words::state_text;
use crate::board::Reporter;
use crate::link_option::ChosenLink;

// No doc comments on `NetworkArgs` and `SlaveArgs`: clap would show them as the help of every verb.
#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct NetworkArgs {
    /// Network to inspect: nic:INTERFACE, sim:?slaves=.. or a chip, see `ecmsk link help` [default: ECMSK_LINK, else
    /// the one of ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct SlaveArgs {
    /// The slave, from 1 in the order of the cable
    #[arg(value_name = "SLAVE", value_parser = clap::value_parser!(u8).range(1..=40))]
    pub slave: u8,
    #[command(flatten)]
    network: NetworkArgs,
}

impl SlaveArgs {
    /// Opens the network and checks that it has the slave of the command line.
    ///
    /// # Errors
    /// As [`NetworkArgs::open`]; [`BusError::NoSuchSlave`] if the scan has found no slave with that number.
    pub fn open(&self) -> Result<Session, BusVerbError> {
        let session = self.network.open()?;
        let (slave, found) = (self.slave, session.slaves.len());
        if !session.slaves.iter().any(|found| found.slave == slave) {
            return Err(BusError::NoSuchSlave { slave, found }.into());
        }
        Ok(session)
    }
}

/// An open network and the slaves that a scan has found in it.
pub struct Session {
    pub network: Box<dyn Network>,
    pub slaves: Vec<FoundSlave>,
    pub reporter: Reporter,
}

impl NetworkArgs {
    /// Opens the network and finds its slaves. Prints a note for each slave that was above Init and that opening has brought to
    /// Init.
    ///
    /// # Errors
    /// The command line names no network, the network does not open, or it has no slave.
    pub fn open(&self) -> Result<Session, BusVerbError> {
        let chosen = ChosenLink::find(self.link.as_ref())?;
        if !chosen.is_named() {
            return Err(BusVerbError::NoLink);
        }
        crate::recording_end::opens(&chosen.uri);
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
