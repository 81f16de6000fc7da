//! `xf scan`: lists the slaves of the chip's network.

use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{Reconfig, Slaves};
use ecmsk::xf_api::{SlaveDescription, XfError};
use serde_json::{Value, json};

use super::session::{ChipArgs, Session};
use super::words::{al_status_text, state_name, state_text};
use super::{Shown, XfVerbError};
use crate::bus::words::name;
use crate::output::counted;

/// List the slaves of the chip's network
///
/// A network that is not up, or is in Init, is initialised and brought to PreOP. A network above Init is not touched:
/// the list is what the chip knows of it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk xf scan --link 'xf-sim:?slaves=drive*3,io'
  ecmsk xf scan --json | jq -r .name")]
pub struct Args {
    #[command(flatten)]
    pub chip: ChipArgs,

    /// Initialise a network above Init too: its slaves go to Init, and axes stop as their drives do without a master
    #[arg(long)]
    pub force: bool,
}

/// Lists the slaves of the network.
///
/// # Errors
/// [`XfVerbError`] if the chip does not answer or cannot initialise the network, or if a slave does not describe itself.
pub fn scan(session: &mut Session, force: bool) -> Result<Vec<Shown>, XfVerbError> {
    let slaves = find(session, force)?;
    if slaves > 0 {
        session.xf.state()?;
    }
    let list = (0..slaves).map(|slave| session.xf.slave_description(slave)).collect::<Result<Vec<_>, _>>()?;
    if list.is_empty() {
        session.reporter.note("no slave was found; check cable and power of the first one");
    }
    let columns = Columns::of(&list);
    Ok(list.iter().map(|slave| (columns.line(slave), line_json(slave))).collect())
}

/// Returns the number of slaves. The network is initialised first. A network above Init is initialised only with
/// `force`.
fn find(session: &mut Session, force: bool) -> Result<u8, XfVerbError> {
    let state = session.state().filter(|state| *state != EtherCatState::Init);
    if let (Some(state), false) = (state, force) {
        session.reporter.note(format_args!(
            "the network is in {} and was not touched: this is what the chip knows of it; --force initialises it anew",
            state_name(state)
        ));
        return Ok(session.xf.count_slaves()?);
    }
    let slaves = match session.start() {
        Ok(slaves) => slaves,
        // The chip answers with an error if it finds no slave. For this verb that is no error.
        Err(error) => return none_found(session, error),
    };
    match session.xf.set_state(Slaves::All, EtherCatState::PreOp) {
        Ok(()) => {}
        Err(error @ XfError::StateStuck { .. }) => {
            session.reporter.note(error);
            return Ok(slaves);
        }
        Err(error) => return Err(error.into()),
    }
    if let Err(error) = session.xf.run(&Reconfig) {
        session.reporter.note(format_args!("process data are not laid out: {error}"));
    }
    Ok(slaves)
}

fn none_found(session: &mut Session, error: XfError) -> Result<u8, XfVerbError> {
    match session.xf.count_slaves()? {
        0 => Ok(0),
        slaves => {
            session.reporter.note(format_args!("{} answered", counted(slaves, "slave")));
            Err(error.into())
        }
    }
}

/// The widths of the columns in characters; each is the width of its longest text.
struct Columns {
    place: usize,
    name: usize,
    state: usize,
}

impl Columns {
    fn of(list: &[SlaveDescription]) -> Self {
        let widest = |text: fn(&SlaveDescription) -> String| {
            list.iter().map(|slave| text(slave).chars().count()).max().unwrap_or(0)
        };
        Self {
            place: widest(|slave| slave.slave.to_string()),
            name: widest(|slave| name(&slave.name).to_owned()),
            state: widest(|slave| state_text(slave.state)),
        }
    }

    fn line(&self, slave: &SlaveDescription) -> String {
        let dc = match slave.has_dc {
            Some(true) => "DC",
            Some(false) => "no DC",
            None => "DC not known",
        };
        let al_status = al_status_text(slave.al_status);
        format!(
            "{:>place$}  {:name$}  vendor 0x{:08X}  product 0x{:08X}  revision 0x{:08X}  {:state$}  {} bytes out, {} in, \
             {dc}{al_status}",
            slave.slave,
            name(&slave.name),
            slave.vendor,
            slave.product,
            slave.revision,
            state_text(slave.state),
            slave.output_bytes,
            slave.input_bytes,
            place = self.place,
            name = self.name,
            state = self.state,
        )
    }
}

fn line_json(slave: &SlaveDescription) -> Value {
    json!({
        "verb": "xf scan", "slave": slave.slave, "name": slave.name, "vendor_id": slave.vendor,
        "product_code": slave.product, "revision": slave.revision, "station_address": slave.station_address,
        "alias": slave.alias, "state": slave.state.state().map(state_name), "failed": slave.state.has_error(),
        "al_status": slave.al_status, "output_bytes": slave.output_bytes, "input_bytes": slave.input_bytes,
        "has_dc": slave.has_dc,
    })
}
