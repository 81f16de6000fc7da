//! The options that name the network or board with the drives, and the open link to it.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use ecmsk::bus::{self, BusError, FoundSlave, Network};
use ecmsk::ecm::Ecm;
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::link::manufacturer_objects;
use ecmsk::link::uri::LinkUri;
use ecmsk::sk::MasterState;
use ecmsk::slave::ManufacturerObjects;
use serde_json::json;

use super::ParamsError;
use super::drive::{BehindBoard, Drive, OnNetwork};
use super::file::Device;
use super::kept::{self, Kept};
use crate::board::{AxisWord, Reporter};
use crate::link_option::ChosenLink;
use crate::machine_option;

// No doc comment: clap would show it as the help of every verb.
#[derive(Clone, clap::Args)]
#[group(skip)]
pub struct Place {
    /// Network or board with the drive, see `ecmsk link help` [default: ECMSK_LINK, else the one of machine.toml or
    /// ecmsk.toml]
    #[arg(long, value_name = "URI", value_parser = LinkUri::parse)]
    link: Option<LinkUri>,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// The objects of the drive with their types, which a board cannot list: an ESI file (.xml), or a list, see `ecmsk objects
    /// from-esi`
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    objects: Option<PathBuf>,

    /// Print JSON: one JSON object per line
    #[arg(long)]
    pub json: bool,
}

/// An open link to drives, on a network or behind a board.
pub struct Opened {
    pub link: String,
    pub reporter: Reporter,
    pub json: bool,
    /// The file of `--objects`.
    pub objects: Option<PathBuf>,
    /// On the network of a chip: a slave that is in SafeOP or OP, and the name of this state. Another program runs the
    /// network then.
    pub runs: Option<(u8, &'static str)>,
    drive: Box<dyn Drive>,
}

impl Place {
    /// Opens the link, and scans a network for its slaves. Also returns the number of the slave that `word` names.
    ///
    /// # Errors
    /// As [`open`](Self::open); and an error if the machine file has no axis with that name.
    pub fn open_for(&self, word: &AxisWord) -> Result<(Opened, u8), ParamsError> {
        let (chosen, machine) = ChosenLink::find_for(self.link.as_ref(), self.machine.as_deref(), Some(word))?;
        let slave = word.slave("params", machine.as_ref()).map_err(Box::new)?;
        Ok((self.open_chosen(&chosen)?, slave))
    }

    /// Whether the machine file has an axis with that name.
    ///
    /// # Errors
    /// The machine file cannot be used.
    pub fn has_axis(&self, name: &AxisWord) -> Result<bool, ParamsError> {
        let (_, machine) = ChosenLink::find_for(self.link.as_ref(), self.machine.as_deref(), Some(name))?;
        Ok(name.slave("params", machine.as_ref()).is_ok())
    }

    /// Opens the link, and scans a network for its slaves.
    ///
    /// # Errors
    /// The command line names no link, it does not open, there is no slave, or the network of a board is above PreOP.
    pub fn open(&self) -> Result<Opened, ParamsError> {
        self.open_chosen(&ChosenLink::find_for(self.link.as_ref(), self.machine.as_deref(), None)?.0)
    }

    fn open_chosen(&self, chosen: &ChosenLink) -> Result<Opened, ParamsError> {
        if !chosen.is_named() {
            return Err(ParamsError::NoLink);
        }
        crate::recording_end::note_opened(&chosen.uri);
        let link = chosen.uri.to_string();
        let opened = match bus::open(&link) {
            Ok(network) => Opened::network(&link, network, self.json)?,
            Err(BusError::IsBoard { .. }) => Opened::board(&link, Ecm::open(&link)?, self.json)?,
            Err(error) => return Err(error.into()),
        };
        Ok(opened.with_objects(self.objects.clone()))
    }
}

impl Opened {
    /// Scans a network for its slaves.
    ///
    /// # Errors
    /// There is no slave, or another master runs the network.
    pub fn network(link: &str, mut network: Box<dyn Network>, json: bool) -> Result<Self, ParamsError> {
        let found = network.scan()?;
        let runs = if network.resets_slaves() { None } else { above_preop(&found) };
        let reporter = Reporter::new(json, network.is_virtual());
        let slaves = found.iter().map(|slave| slave.slave).collect();
        let drive = Box::new(OnNetwork { network, slaves, slave: 1 });
        Ok(Self { link: link.to_owned(), reporter, json, objects: None, runs, drive })
    }

    /// Gives access to the slaves behind a board.
    ///
    /// # Errors
    /// [`ParamsError::Runs`], or the board sends no report.
    pub fn board(link: &str, ecm: Ecm, json: bool) -> Result<Self, ParamsError> {
        let state = ecm.state()?;
        if state.state().is_some_and(|state| state > MasterState::PreOp) {
            return Err(ParamsError::Runs { state: state.to_string() });
        }
        let drive = Box::new(BehindBoard { ecm, slave: 1 });
        let reporter = Reporter::new(json, false);
        Ok(Self { link: link.to_owned(), reporter, json, objects: None, runs: None, drive })
    }

    /// Sets the file of `--objects`.
    pub fn with_objects(self, objects: Option<PathBuf>) -> Self {
        Self { objects, ..self }
    }

    /// The numbers of all slaves. A board does not list its slaves, so each slave is queried in turn.
    ///
    /// # Errors
    /// There is no slave, or the link is lost.
    pub fn slaves(&mut self) -> Result<Vec<u8>, ParamsError> {
        self.drive.slaves()
    }

    /// The slave with this number.
    ///
    /// # Errors
    /// The network has no such slave.
    pub fn drive(&mut self, slave: u8) -> Result<&mut dyn Drive, ParamsError> {
        self.drive.choose(slave)?;
        Ok(&mut *self.drive)
    }

    /// Reads the identity of a slave, and its parameters: those that the file of `--objects` lists, or without it all
    /// parameters of the drive.
    ///
    /// # Errors
    /// The file cannot be used, the drive lists no objects, or it does not answer.
    pub fn read(&mut self, slave: u8) -> Result<(Device, Kept), ParamsError> {
        let reporter = Reporter::new(false, false);
        let mut at = progress(&reporter, slave);
        let objects = self.objects.clone();
        let drive = self.drive(slave)?;
        let device = drive.device()?;
        let kept = match objects {
            Some(file) => kept::read_listed(drive, &list(&file, &device)?, &mut at)?,
            None => drive.parameters(&mut at)?,
        };
        reporter.clear();
        Ok((device, kept))
    }
}

/// The first slave in SafeOP or OP, and the name of this state; `None` if there is none.
fn above_preop(found: &[FoundSlave]) -> Option<(u8, &'static str)> {
    found.iter().find_map(|slave| match slave.found.status.state() {
        RequestedState::State(AlState::SafeOp) => Some((slave.slave, "SafeOP")),
        RequestedState::State(AlState::Op) => Some((slave.slave, "OP")),
        _ => None,
    })
}

/// Reads the file of `--objects`. In an ESI file, the device with the product code of the drive is used.
fn list(file: &Path, device: &Device) -> Result<ManufacturerObjects, ParamsError> {
    if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml")) {
        return Ok(crate::objects::of_esi(file, device.product)?);
    }
    Ok(manufacturer_objects::load(file)?)
}

/// Returns a callback that shows which index is being read, if standard error is a terminal.
pub fn progress(reporter: &Reporter, slave: u8) -> impl FnMut(u16) {
    let mut shown = u16::MAX;
    let is_watched = std::io::stderr().is_terminal();
    move |index| {
        if is_watched && index >> 4 != shown {
            shown = index >> 4;
            // The result is ignored: reading goes on even if the terminal was closed.
            let _ = reporter.progress(format_args!("slave {slave}: 0x{index:04X}"), || json!({}));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On the network of a chip, which another program may run, a slave above PreOP is detected.
    #[test]
    fn a_network_that_runs_is_noticed() {
        use ecmsk::ethercat::registers::AlStatusRegister;
        let mut found = bus::open("xf-sim:?slaves=drive*2").unwrap().scan().unwrap();
        assert_eq!(above_preop(&found), None);
        found[1].found.status = AlStatusRegister(8);
        assert_eq!(above_preop(&found), Some((2, "OP")));
    }
}
