//! `xf state`: shows or changes the state of the chip's network.

use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{SlaveNumber, Slaves};
use serde_json::json;

use super::session::{ChipArgs, Session};
use super::words::{al_status_text, parse_state, slave_number, state_name, state_text};
use super::{Shown, XfVerbError};

/// Show or change the EtherCAT state of the slaves
///
/// A network that is not up is initialised first. In OP the chip sends the outputs that were written last, at first 0;
/// no axis is switched on.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk xf state
  ecmsk xf state safeop
  ecmsk xf state preop --slave 2")]
pub struct Args {
    /// The state to go to; without it the states are shown
    #[arg(value_name = "init|preop|boot|safeop|op", value_parser = parse_state)]
    pub to: Option<EtherCatState>,

    /// Only this slave, from 0
    #[arg(long, value_name = "SLAVE", value_parser = slave_number)]
    pub slave: Option<u8>,

    #[command(flatten)]
    pub chip: ChipArgs,
}

/// Changes the state if `to` is given, then returns the states of all slaves, or of one slave.
///
/// # Errors
/// [`XfVerbError`] if the slave does not exist or does not reach the state, or if the chip does not answer.
pub fn state(session: &mut Session, to: Option<EtherCatState>, slave: Option<u8>) -> Result<Vec<Shown>, XfVerbError> {
    let found = session.join_or_start(EtherCatState::Init)?;
    let shown = match slave {
        None => 0..found,
        Some(slave) if slave < found => slave..slave + 1,
        Some(slave) => return Err(ecmsk::xf_api::XfError::NoSuchSlave { slave, found }.into()),
    };
    if let Some(to) = to {
        let slaves = slave.and_then(SlaveNumber::new).map_or(Slaves::All, Slaves::One);
        session.xf.set_state(slaves, to)?;
    } else {
        session.xf.state()?;
    }
    shown.map(|slave| show(session, slave)).collect()
}

fn show(session: &mut Session, slave: u8) -> Result<Shown, XfVerbError> {
    let slave = session.xf.slave_description(slave)?;
    let al_status = al_status_text(slave.al_status);
    let text = format!("slave {}: {}{al_status}", slave.slave, state_text(slave.state));
    let json = json!({
        "verb": "xf state", "slave": slave.slave, "state": slave.state.state().map(state_name),
        "failed": slave.state.has_error(), "al_status": slave.al_status,
    });
    Ok((text, json))
}
