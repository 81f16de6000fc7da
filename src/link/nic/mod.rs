//! `nic:INTERFACE`: a board whose slaves are at the end of a network card, without any board: the EC01M is the model in this
//! process, and our own master runs the network.
//!
//! - `mod.rs`: opening it
//! - `card.rs`: the frames and the clock of the card, or of two

mod card;

use super::LinkError;
use super::engine::EngineLink;
use super::options::{BoardOptions, CommonOptions};
use super::own_board::{boots, switching_off};
use super::uri::LinkUri;
use crate::engine::{Board, Rate};
use crate::fieldbus::Fieldbus;
use crate::fieldbus::nic::{NicBus, Ring};
use crate::master::Settings;
pub(crate) use card::Card;
use card::Cards;

/// Opens the board: the network is scanned, and its slaves are brought to PreOP.
pub(super) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<EngineLink, LinkError> {
    let options = BoardOptions::from_uri(uri)?;
    let name = uri.to_string();
    let no_board = |reason: String| LinkError::NoBoard { name: name.clone(), reason };
    let first = Card::of(uri)?;
    let settings = Settings { source: first.source(), ..Settings::default() };
    let bus: Box<dyn Fieldbus> = match uri.value("second") {
        None => Box::new(NicBus::new(first, settings)),
        Some(second) if second == uri.path() => {
            return Err(no_board("a ring needs two cards, and `second` is the first one; name another one".into()));
        }
        Some(second) => {
            let second = Card::open(second, &name)?;
            let probe_source = second.source();
            if probe_source == settings.source {
                return Err(no_board("both cards have the same address; name two".into()));
            }
            Box::new(NicBus::new(Ring::new(Cards { first, second }, probe_source), settings))
        }
    };
    let mut board = Board::new(options.engine(), bus);
    if !boots(&mut board) {
        return Err(no_board(
            "it finds no slave that comes to PreOP; look at the cable to the first slave and at the slaves' power, and try \
             `ecmsk doctor`"
                .into(),
        ));
    }
    EngineLink::open(&name, board, options.run(common, false, Rate::default()), Some(switching_off()))
}
