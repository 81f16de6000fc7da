//! What the bus needs of a way to the slaves besides its frames: a clock, and waiting.

use crate::ethercat::Ns;
use crate::master::Wire;

/// A way to the slaves with a clock of its own.
pub trait NicWires: Wire {
    /// The time on its clock, which the master goes by, in nanoseconds.
    fn now(&self) -> Ns;

    /// Waits until a frame has come, at most until that time.
    fn wait(&mut self, until: Ns);

    /// Whether its clock goes on by itself. One that does not advances by waits alone.
    fn is_real_time(&self) -> bool;
}
