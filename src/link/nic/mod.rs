//! `nic:INTERFACE`: a board whose slaves are at the end of a network card, without any board: the EC01M is the model in this
//! process, and our own master runs the network.
//!
//! - `mod.rs`: opening it
//! - `card.rs`: the frames and the clock of the card

mod card;

use super::LinkError;
use super::engine::EngineLink;
use super::options::{BoardOptions, CommonOptions};
use super::own_board::{boots, switching_off};
use super::uri::LinkUri;
use crate::engine::{Board, Rate};
use crate::fieldbus::nic::NicBus;
use crate::master::Settings;
pub(crate) use card::Card;

/// Opens the board: the network is scanned, and its slaves are brought to PreOP.
pub(super) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<EngineLink, LinkError> {
    let options = BoardOptions::from_uri(uri)?;
    let name = uri.to_string();
    let no_board = |reason: String| LinkError::NoBoard { name: name.clone(), reason };
    let card = Card::of(uri)?;
    let settings = Settings { source: card.source(), ..Settings::default() };
    let mut board = Board::new(options.engine(), Box::new(NicBus::new(card, settings)));
    if !boots(&mut board) {
        return Err(no_board(
            "it finds no slave that comes to PreOP; look at the cable to the first slave and at the slaves' power, and try \
             `ecmsk doctor`"
                .into(),
        ));
    }
    EngineLink::open(&name, board, options.run(common, false, Rate::default()), Some(switching_off()))
}
