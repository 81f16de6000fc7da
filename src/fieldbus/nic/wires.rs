//! What the bus needs of a way to the slaves besides its frames: a clock, and waiting.

use crate::ethercat::{CableEnd, Ns};
use crate::fieldbus::{CardsGone, RingState};
use crate::master::{FrameBuffer, Wire, WireDown};

/// A way to the slaves with a clock of its own.
pub trait NicWires: Wire {
    /// The time on its clock, which the master goes by, in nanoseconds.
    fn now(&self) -> Ns;

    /// Waits until a frame has come, at most until that time.
    fn wait(&mut self, until: Ns);

    /// Whether its clock goes on by itself. One that does not advances by waits alone.
    fn is_real_time(&self) -> bool;

    /// How the ring of the cables is; `None`: there is one card alone.
    fn ring(&self) -> Option<RingState> {
        None
    }

    /// The cards that are gone; `None`: all are there. It does not allocate.
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }
}

/// Two network cards, one at each end of a line of slaves, with one clock.
pub trait CardPair {
    /// Sends a frame by one of them, without its check sequence, at once.
    ///
    /// # Errors
    /// [`WireDown`]: the frame was not sent.
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown>;

    /// Puts the next frame that has come there into `buffer` and gives its length; `None`: no frame is waiting.
    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize>;

    /// As [`NicWires::now`].
    fn now(&self) -> Ns;

    /// Waits until a frame has come at either end, at most until that time.
    fn wait(&mut self, until: Ns);

    /// As [`NicWires::is_real_time`].
    fn is_real_time(&self) -> bool;

    /// As [`NicWires::cards_gone`].
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }
}
