//! The state of a board besides its reports: LEDs, BUSY pin, and what the board knows of the network.

use super::{Board, StateFailure};
use crate::fieldbus::{Ns, RingState, SlaveSet};
use crate::sk::{MasterState, StateByte};

/// The two LEDs that show the AL state of the network (UG17 1.3.2, SK-11).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Leds {
    /// On in SafeOP, and when a change of state has failed or a slave is lost.
    pub yellow: bool,
    /// On in OP, and when a change of state has failed or a slave is lost.
    pub green: bool,
}

impl Leds {
    /// The LEDs for a state of the network. Both are off in Init and PreOP; for Init this is \[OURS], since no user
    /// guide specifies the LEDs there.
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
    /// Why the newest change of state failed, or which slave was lost since; `None`: no failure.
    pub failure: Option<StateFailure>,
    /// The BUSY pin, when no SPI transfer is under way: high from a boot until the first PreOP after it. An SPI host
    /// that ignores the pin reads zeros while it is high (SK-4, SK-10).
    pub busy: bool,
    /// The yellow and the green LED that show the AL state of the network.
    pub leds: Leds,
    /// The power LED, LEDR1: always on.
    pub power: bool,
    /// The yellow LED of the network socket (100 Mbit/s). It is on while frames come back from the slaves: the engine
    /// has no other sign of a link.
    pub link: bool,
    /// Whether the green LED of the network socket flashes, which shows traffic. Frames are sent in every cycle, so the
    /// value equals `link`.
    pub traffic: bool,
    /// How many slaves were found at boot.
    pub slaves_found: u8,
    /// The slaves that are lost: they do not answer, have left SafeOP or OP by themselves, or sent no valid inputs for
    /// too long.
    pub lost: SlaveSet,
    /// The slave with the reference clock: the first one with distributed clocks. `None`: no slave has distributed
    /// clocks, the reference clock is that of an ECM-XF, or the bus has no way to find out.
    pub reference_clock: Option<u8>,
    /// The state of the cable ring, a line of slaves with a network card of the PC at each end. `None`: the bus has no
    /// second network card, so there is no ring.
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
