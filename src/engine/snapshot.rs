//! What can be seen of a board without asking it: its LEDs, its BUSY pin, and what it knows of its network.

use super::{Board, StateFailure};
use crate::fieldbus::{Ns, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// The two LEDs that show the state (UG17 1.3.2, SK-11).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Leds {
    /// On in SafeOP, and when something is wrong.
    pub yellow: bool,
    /// On in OP, and when something is wrong.
    pub green: bool,
}

impl Leds {
    /// The LEDs in a state. While the network is initialising both are off \[OURS]: no guide says.
    pub const fn in_state(state: StateByte) -> Self {
        let (yellow, green) = match state.state() {
            _ if state.is_failed() => (true, true),
            Some(MasterState::SafeOp) => (true, false),
            Some(MasterState::Op) => (false, true),
            Some(MasterState::Init | MasterState::PreOp) | None => (false, false),
        };
        Self { yellow, green }
    }
}

/// A board at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// When, in board time.
    pub at: Ns,
    /// Byte 2 of slot 0.
    pub state: StateByte,
    /// Why the state has failed; `None`: it has not.
    pub failure: Option<StateFailure>,
    /// The BUSY pin while nothing is exchanged: high until the first PreOP since the board booted. A host on SPI sees
    /// it, or, without looking at it, zeros (SK-4, SK-10).
    pub busy: bool,
    /// The LEDs of the state.
    pub leds: Leds,
    /// LEDR1, power: on as long as there is a board.
    pub power: bool,
    /// The network socket's yellow LED, 100 Mbit/s: frames come back, so there is a link. A bus that is only a model of
    /// one cannot say more.
    pub link: bool,
    /// The network socket's green LED flashes: traffic. There is some in every cycle while there is a link.
    pub traffic: bool,
    /// Slaves found at boot.
    pub slaves_found: u8,
    /// Slaves that are lost.
    pub lost: SlaveSet,
    /// The slave whose clock the others follow: the first one with distributed clocks; `None`: none has, or the bus does
    /// not say.
    pub reference_clock: Option<u8>,
    /// The chip's six outputs, bit k is output k.
    pub local_outputs: u8,
}

impl Board {
    /// The board as it is now.
    pub fn snapshot(&self) -> Snapshot {
        let engine = self.engine();
        let link = self.network_answers();
        Snapshot {
            at: self.now(),
            state: engine.state(),
            failure: engine.state_failure(),
            busy: self.busy(),
            leds: engine.leds(),
            power: true,
            link,
            traffic: link,
            slaves_found: engine.slaves_found(),
            lost: engine.lost(),
            reference_clock: self.bus().reference_clock(),
            local_outputs: engine.local_outputs(),
        }
    }
}
