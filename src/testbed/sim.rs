//! The links `sim:` and `xf-sim:`: the model of an EC01M, the chip of the board, in this process. Its simulated slaves are
//! connected to it directly, or through the model of an ECM-XF.

use std::sync::Arc;
#[cfg(unix)]
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::boards::{self, Key, Parked};
use super::build;
use super::chip::SimChip;
use super::chip_options::ChipNetwork;
#[cfg(unix)]
use super::control::Control;
use super::manufacturer_objects;
use super::options::{ModelledBus, SimOptions};
#[cfg(unix)]
use super::script::injected::Abilities;
use super::script::injected::{InjectedScript, Slot};
use super::script::{self, Script};
use crate::address::uri::LinkUri;
use crate::engine::{self, Board, Rate};
use crate::fieldbus::sim::{SimBus, SimHandle};
use crate::fieldbus::{Fieldbus, Ns};
use crate::link::common_options::CommonOptions;
use crate::link::{FAILED_OPEN, LinkError, Share};
use crate::own_board::engine::{EngineLink, Keeper};
use crate::recording::Clock;
use crate::slave::{ManufacturerObjects, Slave};

/// How long a board may take to start up, in its own time. If its host interface does not answer by then, the board has found
/// no slave.
const BOOT_LIMIT_NS: Ns = 60_000_000_000;

/// Opens the board that the URI describes. A link with `name=`, or any link if `share` is [`Share::ByUri`], gets the parked
/// board with the same name or options: this process keeps, or parks, such a board when its link is closed. Otherwise the link
/// gets a new board, which is returned after its start-up.
pub(crate) fn open(uri: &LinkUri, common: &CommonOptions, share: Share) -> Result<EngineLink, LinkError> {
    let options = SimOptions::from_uri(uri)?;
    // These files are loaded before a board is reserved or its time is advanced, so that an error in them changes nothing.
    let script = script_of(&options)?;
    let objects = manufacturer_objects::of_slaves(&options.slaves)?;
    let name = uri.to_string();
    let key = match (&options.name, share) {
        (Some(name), _) => Some(Key::Name(name.clone())),
        (None, Share::ByUri) => Some(Key::Options(Box::new(options.clone()))),
        (None, Share::ByName) => None,
    };
    let found = match &key {
        Some(key) => boards::claim(key, &options, &name)?,
        None => None,
    };
    let control = match control_of(&name, &options) {
        Ok(control) => control,
        Err(error) => {
            give_back(key.as_ref(), found);
            return Err(error);
        }
    };
    let (mut board, network) = match found {
        None => switch_on(&name, &options, objects)?,
        Some(parked) => {
            let (mut board, network, since) = *parked;
            if script.is_some() || control.is_some() {
                board.set_script(None);
                script::undo_all(&network, &board.handle());
            }
            (catch_up(board, since.elapsed(options.clock), &options), network)
        }
    };
    let (control, slot) = control.unzip();
    start(script, slot, &mut board, &network);
    let keeper = keeper(key.clone(), control, network);
    let link = EngineLink::open(
        &name,
        board,
        options.board.run(common, options.clock == Clock::Virtual, rate(&options)),
        keeper,
    );
    if let (Err(LinkError::Io { .. }), Some(key)) = (&link, &key) {
        boards::forget(key);
    }
    link
}

/// The board that the URI describes, without a link: just started up. Its time advances only when the caller advances it.
pub(crate) fn model(uri: &LinkUri) -> Result<Board, LinkError> {
    let options = SimOptions::from_uri(uri)?;
    let script = script_of(&options)?;
    let name = uri.to_string();
    let (mut board, network) = switch_on(&name, &options, manufacturer_objects::of_slaves(&options.slaves)?)?;
    start(script, None, &mut board, &network);
    if board.engine().talks() {
        return Ok(board);
    }
    Err(LinkError::NoBoard { name, reason: "it finds no slave; give it some with `slaves=`".into() })
}

/// Reads the script of a link, if the link has one.
fn script_of(options: &SimOptions) -> Result<Option<Script>, LinkError> {
    let Some(path) = options.script.as_deref() else { return Ok(None) };
    Ok(Some(Script::load_for(path, &options.slaves, has_frames(options))?))
}

/// Whether the board reaches its slaves by EtherCAT frames.
fn has_frames(options: &SimOptions) -> bool {
    matches!(&options.bus, ModelledBus::Chip { chip, .. } if chip.network == Some(ChipNetwork::Controllers))
}

/// Starts the control socket of a link, if the link has one. Its events wait in the returned slot for the next cycle.
#[cfg(unix)]
fn control_of(link: &str, options: &SimOptions) -> Result<Option<(Control, Arc<Slot>)>, LinkError> {
    let Some(name) = &options.control else { return Ok(None) };
    let slot = Arc::new(Slot::default());
    let abilities = Abilities { has_frames: has_frames(options) };
    let control = Control::start(link, name, options.slaves.clone(), abilities, Arc::clone(&slot))?;
    Ok(Some((control, slot)))
}

/// The type of control sockets on a system without Unix sockets; it has no values.
#[cfg(not(unix))]
enum Control {}

#[cfg(not(unix))]
fn control_of(link: &str, options: &SimOptions) -> Result<Option<(Control, Arc<Slot>)>, LinkError> {
    if options.control.is_none() {
        return Ok(None);
    }
    let reason = "`control=` needs Unix sockets, which this system does not have; use `script=`".to_owned();
    Err(LinkError::NoBoard { name: link.to_owned(), reason })
}

/// Ends the reservation of a board for a link that is not opened; a board that was parked is parked again.
fn give_back(key: Option<&Key>, found: Option<Box<Parked>>) {
    match (key, found) {
        (Some(key), Some(parked)) => {
            let (board, network, since) = *parked;
            boards::park_since(key, board, network, since);
        }
        (Some(key), None) => boards::forget(key),
        (None, _) => {}
    }
}

/// The function to call when the link is closed: it ends the control socket, and parks a board that has a key.
fn keeper(key: Option<Key>, control: Option<Control>, network: SimHandle) -> Option<Keeper> {
    if key.is_none() && control.is_none() {
        return None;
    }
    #[cfg(unix)]
    let control = Mutex::new(control);
    Some(Box::new(move |board| {
        // The control socket ends before the board is parked, so that no event reaches a board without a link.
        #[cfg(unix)]
        drop(control.lock().unwrap_or_else(PoisonError::into_inner).take());
        match (&key, board) {
            (Some(key), Some(board)) => boards::park(key, board, network.clone()),
            (Some(key), None) => boards::forget(key),
            (None, _) => {}
        }
    }))
}

/// Starts a script, if there is one, on a board and its network, and the events of a control socket.
fn start(script: Option<Script>, slot: Option<Arc<Slot>>, board: &mut Board, network: &SimHandle) {
    let now = board.now();
    let script = script.map(|script| script.start(network.cable().clone(), board.handle(), now));
    let script: Box<dyn engine::Script> = match (script, slot) {
        (script, Some(slot)) => {
            Box::new(InjectedScript::new(script, slot, (network.cable().clone(), board.handle()), now))
        }
        (Some(script), None) => Box::new(script),
        (None, None) => return,
    };
    board.set_script(Some(script));
}

/// Makes a board in its power-on state, with its network. `name` is the name of its link.
///
/// # Errors
/// As [`bus`]: a slave does not define the content of its EEPROM.
fn switch_on(
    name: &str,
    options: &SimOptions,
    manufacturer_objects: Vec<Option<ManufacturerObjects>>,
) -> Result<(Board, SimHandle), LinkError> {
    let (bus, network) = bus(name, options, build::models(&options.slaves, manufacturer_objects))?;
    let mut board = Board::new(options.board.engine(), bus);
    board.boot(BOOT_LIMIT_NS);
    Ok((board, network))
}

/// Builds the bus with these slaves, and the handle that controls them.
///
/// # Errors
/// [`LinkError::NoBoard`]: a slave does not define the content of the EEPROM of its slave controller.
fn bus(
    name: &str,
    options: &SimOptions,
    slaves: Vec<Box<dyn Slave>>,
) -> Result<(Box<dyn Fieldbus>, SimHandle), LinkError> {
    Ok(match &options.bus {
        ModelledBus::Direct => {
            let bus = SimBus::new(slaves);
            let network = bus.handle();
            (Box::new(bus), network)
        }
        ModelledBus::Chip { chip, used } => {
            let network = SimHandle::default();
            let slaves = chip.network.unwrap_or(ChipNetwork::Models).with(slaves, network.clone());
            let slaves =
                slaves.map_err(|error| LinkError::NoBoard { name: name.to_owned(), reason: error.to_string() })?;
            // The chip has a virtual clock, even if the board runs on the real one: the board's runner waits for the real time
            // and passes it to each call, and the chip's clock follows.
            let chip = SimChip::over(name, *chip, Clock::Virtual, slaves);
            (Box::new(used.bus(chip)), network)
        }
    })
}

/// Advances a board by the time for which it was parked, at most by `catch_up_ms=`. On a virtual clock this time is 0,
/// unless the program's waits take virtual time. A board on a virtual clock that is still starting up is advanced by at
/// least [`FAILED_OPEN`].
fn catch_up(mut board: Board, away: Duration, options: &SimOptions) -> Board {
    let away = rate(options).slowed(away);
    let away = if board.engine().talks() {
        away.min(options.catch_up).as_nanos() as Ns
    } else {
        // A board that is still starting up is advanced without the limit of `catch_up_ms=`: otherwise it might never
        // finish its start-up, and could not be opened.
        let away = Ns::try_from(away.as_nanos()).unwrap_or(Ns::MAX).min(BOOT_LIMIT_NS);
        match options.clock {
            Clock::Real => away,
            Clock::Virtual => away.max(FAILED_OPEN.as_nanos() as Ns),
        }
    };
    let now = board.now() + away;
    board.advance(now, &mut |_, _| {});
    board
}

const fn rate(options: &SimOptions) -> Rate {
    Rate::billionths(options.rate.billionths())
}
