//! The state of a board besides its reports: LEDs, BUSY pin, and what the board knows of the network.

use super::{Board, StateFailure};
use crate::fieldbus::{Ns, RingState, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// The two LEDs that show the state (UG17 1.3.2, SK-11).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Leds {
    /// On in SafeOP, and when a change of state has failed or a slave is lost.
    pub yellow: bool,
    /// On in OP, and when a change of state has failed or a slave is lost.
    pub green: bool,
}

impl Leds {
    /// The LEDs for a state of the network. While the network is initialising both are off \[OURS], since no user guide
    /// specifies this.
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

/// The state of a board at one moment, as [`Board::snapshot`] takes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// The time of the snapshot, board time.
    pub at: Ns,
    /// The state of the network, byte 2 of slot 0.
    pub state: StateByte,
    /// Why the last change of state has failed; `None`: no failure.
    pub failure: Option<StateFailure>,
    /// The BUSY pin between two exchanges: high from a boot until the first PreOP after it. An SPI host that ignores
    /// the pin reads zeros meanwhile (SK-4, SK-10).
    pub busy: bool,
    /// The two LEDs that show the state of the network.
    pub leds: Leds,
    /// The power LED, LEDR1: always on.
    pub power: bool,
    /// The yellow LED of the network socket, 100 Mbit/s: on while frames come back, since a simulated bus reports
    /// nothing else about its link.
    pub link: bool,
    /// The green LED of the network socket flashes: traffic. There is traffic in every cycle while there is a link.
    pub traffic: bool,
    /// How many slaves were found at boot.
    pub slaves_found: u8,
    /// The slaves that are lost.
    pub lost: SlaveSet,
    /// The slave with the reference clock: the first one with distributed clocks. `None`: no slave has them, or the bus
    /// does not know.
    pub reference_clock: Option<u8>,
    /// The state of the ring of cables; `None`: there is no second network card.
    pub ring: Option<RingState>,
    /// The six local outputs of the chip (LIO_WR): bit k is output k.
    pub local_outputs: u8,
}

impl Board {
    /// Takes a snapshot of the board.
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
            ring: self.bus().ring(),
            local_outputs: engine.local_outputs(),
        }
    }
}
