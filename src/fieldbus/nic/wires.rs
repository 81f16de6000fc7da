//! The traits through which the bus uses network cards: a wire with a clock of its own, and a pair of cards.

use crate::ethercat::{CableEnd, Ns};
use crate::fieldbus::{CardsGone, RingState};
use crate::master::{FrameBuffer, Wire, WireDown};

/// Network cards with a clock of their own, as the bus uses them. `Wire` sends and receives the frames.
pub trait NicWires: Wire {
    /// The time on the clock of the wires, nanoseconds from an origin that does not change. It never goes back. The
    /// master uses this time.
    fn now(&self) -> Ns;

    /// Waits until a frame has been received, at most until the time `until`.
    fn wait(&mut self, until: Ns);

    /// Whether the clock advances by itself. Otherwise it advances only during waits.
    fn is_real_time(&self) -> bool;

    /// The state of the cable ring; `None`: there is only one card.
    fn ring(&self) -> Option<RingState> {
        None
    }

    /// The network cards that are gone; `None`: none is. Must not allocate.
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }
}

/// Two network cards, one at each end of a line of slaves, with one clock.
pub trait CardPair {
    /// Sends a frame, without its frame check sequence, through the card at `end` at once.
    ///
    /// # Errors
    /// [`WireDown`]: the frame was not sent.
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown>;

    /// Copies the next frame that was received at `end` into `buffer` and returns its length; `None`: no frame is waiting.
    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize>;

    /// Like [`NicWires::now`].
    fn now(&self) -> Ns;

    /// Waits until a frame has come at either end, at most until the time `until`.
    fn wait(&mut self, until: Ns);

    /// Like [`NicWires::is_real_time`].
    fn is_real_time(&self) -> bool;

    /// Like [`NicWires::cards_gone`].
    fn cards_gone(&self) -> Option<CardsGone> {
        None
    }
}
