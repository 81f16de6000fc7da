//! `nic:INTERFACE`: slaves on a network card of this machine, without a real board. This process runs the model of the
//! EC01M, and the EtherCAT master of this crate runs the network.
//!
//! - `mod.rs`: opens the link
//! - `card.rs`: the frames and the clock of one card, or of two

mod card;

use super::engine::EngineLink;
use super::options::BoardOptions;
use super::{boots, switching_off};
use crate::address::uri::LinkUri;
use crate::engine::{Board, Rate, StateFailure};
use crate::fieldbus::nic::{NicBus, Ring};
use crate::fieldbus::{Fieldbus, Strangers};
use crate::link::LinkError;
use crate::link::common_options::CommonOptions;
use crate::master::Settings;
use card::{Card, Cards};

/// The network cards of a link, to which its slaves are connected.
pub(crate) enum CardWires {
    /// One card, at the beginning of a line of slaves.
    Line(Card),
    /// Two cards, one at each end of the slaves' cable.
    Ring(Ring<Cards>),
}

/// Opens the one or two cards of a link. Also returns the settings of the master, with the source address of its
/// frames.
///
/// # Errors
/// Those of [`Card::of`]; [`LinkError::NoBoard`] if both cards are the same one.
pub(crate) fn wires(uri: &LinkUri) -> Result<(CardWires, Settings), LinkError> {
    let name = uri.to_string();
    let no_board = |reason: &str| LinkError::NoBoard { name: name.clone(), reason: reason.to_owned() };
    let first = Card::of(uri)?;
    let settings = Settings { source: first.source(), ..Settings::default() };
    let Some(second) = uri.value("second") else { return Ok((CardWires::Line(first), settings)) };
    if second == uri.path() {
        return Err(no_board("a ring needs two cards, and `second` is the first one; name another one"));
    }
    let second = Card::open(second, &name)?;
    let probe_source = second.source();
    if probe_source == settings.source {
        return Err(no_board("both cards have the same address; name two"));
    }
    Ok((CardWires::Ring(Ring::new(Cards::new(first, second), probe_source)), settings))
}

/// The error text for a board that did not reach PreOP: the reason, and the next step for the user.
fn why_not(board: &Board) -> String {
    if let Some(why) = board.engine().state_failure().filter(|why| *why != StateFailure::NoSlave) {
        return format!("no PreOP: {why}; see who is there with `ecmsk bus scan`");
    }
    match board.strangers().unpassed {
        0 => "it finds no slave that comes to PreOP; look at the cable to the first slave and at the slaves' power, and try `ecmsk \
              doctor`"
            .to_owned(),
        frames => Strangers::echo(frames),
    }
}

/// Opens the board: scans the network and brings its slaves to PreOP.
pub(crate) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<EngineLink, LinkError> {
    let options = BoardOptions::from_uri(uri)?;
    let name = uri.to_string();
    let bus: Box<dyn Fieldbus> = match wires(uri)? {
        (CardWires::Line(card), settings) => Box::new(NicBus::new(card, settings)),
        (CardWires::Ring(ring), settings) => Box::new(NicBus::new(ring, settings)),
    };
    let board = booted(&name, Board::new(options.engine(), bus))?;
    EngineLink::open(&name, board, options.run(common, false, Rate::default()), Some(switching_off()))
}

/// Starts the board. Returns it once it has found its slaves and has brought them to PreOP.
fn booted(name: &str, mut board: Board) -> Result<Board, LinkError> {
    if boots(&mut board) {
        return Ok(board);
    }
    let gone = board.cards_gone().filter(|gone| gone.is_all);
    let reason = gone.map_or_else(|| why_not(&board), |gone| gone.text.to_string());
    Err(LinkError::NoBoard { name: name.to_owned(), reason })
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::engine::EngineConfig;
    use crate::ethercat::Ns;
    use crate::fieldbus::nic::NicWires;
    use crate::master::{FrameBuffer, Wire, WireDown};

    /// A cable without slaves. Its end returns each frame unchanged (a loopback plug), or is open.
    struct Plug {
        sends_back: bool,
        frames: VecDeque<Vec<u8>>,
        now: Ns,
    }

    impl Wire for Plug {
        fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
            if self.sends_back {
                self.frames.push_back(frame.to_vec());
            }
            Ok(())
        }

        fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
            let frame = self.frames.pop_front()?;
            buffer[..frame.len()].copy_from_slice(&frame);
            Some(frame.len())
        }
    }

    impl NicWires for Plug {
        fn now(&self) -> Ns {
            self.now
        }

        fn wait(&mut self, until: Ns) {
            self.now = until.max(self.now);
        }

        fn is_real_time(&self) -> bool {
            false
        }
    }

    /// BUS-2.3 If a cable returns frames with their source address unchanged, the error says so. If nothing comes back
    /// from the cable, the error says that no slave was found.
    #[test]
    fn a_board_says_what_came_back_as_it_was_sent() {
        let refused = |sends_back| {
            let wires = Plug { sends_back, frames: VecDeque::new(), now: 1_000_000 };
            let bus = NicBus::new(wires, Settings::default());
            match booted("nic:eth1", Board::new(EngineConfig::default(), Box::new(bus))) {
                Err(LinkError::NoBoard { name, reason }) if name == "nic:eth1" => reason,
                other => panic!("{:?}", other.err()),
            }
        };
        let echo = refused(true);
        let frames = echo.split(' ').next().and_then(|count| count.parse::<u64>().ok()).expect("a count");
        assert!(frames > 0 && echo == Strangers::echo(frames), "{echo}");
        let silence = refused(false);
        assert!(silence.starts_with("it finds no slave that comes to PreOP"), "{silence}");
    }
}
