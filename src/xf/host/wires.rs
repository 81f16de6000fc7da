//! The wires to a chip as the driver uses them, and one step of the driver over them.

use super::next::Plan;
use super::{Host, HostError, Outstanding};
use crate::ethercat::Ns;

/// The wires to one chip, with a clock.
pub trait Wires {
    /// Why an exchange or a wait failed.
    type Error;

    /// The time in nanoseconds. Where zero lies is up to the wires.
    fn now(&self) -> Ns;

    /// Clocks `to_chip` out and as many bytes into `from_chip`, under one chip select.
    ///
    /// # Errors
    /// The wires cannot be used; how many bytes passed is not known then.
    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Self::Error>;

    /// Waits until that time; not at all if it has passed.
    ///
    /// # Errors
    /// The wires cannot be used any more.
    fn wait_until(&mut self, time: Ns) -> Result<(), Self::Error>;

    /// Waits for INT0 to become active after the last exchange, until that time at the latest; whether it did. Wires
    /// without INT0 wait for nothing and give `false`.
    ///
    /// # Errors
    /// INT0 cannot be read.
    fn wait_ready(&mut self, until: Ns) -> Result<bool, Self::Error>;
}

/// Why a step failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepError<E> {
    /// The driver has stopped.
    Host(HostError),
    /// The wires cannot be used.
    Wires(E),
}

impl Host {
    /// One step over these wires: an exchange, or a wait for the next one that ends at `until`.
    ///
    /// # Errors
    /// The driver has stopped, or the wires cannot be used. What was on its way in an exchange that failed is sent
    /// again by the next step, as after a damaged answer.
    pub fn step<W: Wires + ?Sized>(&mut self, wires: &mut W, until: Ns) -> Result<(), StepError<W::Error>> {
        match self.plan(wires.now()).map_err(StepError::Host)? {
            Plan::Exchange(what) => {
                let to_chip = match what {
                    Outstanding::Filler => self.search.filler(),
                    Outstanding::Packet => &self.packets[self.current][..self.size.packet_len()],
                };
                let len = to_chip.len();
                let done = wires.exchange(to_chip, &mut self.inbox.packet()[..len]);
                self.came(wires.now(), if done.is_ok() { len } else { 0 });
                done
            }
            Plan::WaitUntil(time) => wires.wait_until(time.min(until)),
            Plan::WaitForReady { until: time } => wires.wait_ready(time.min(until)).map(|ready| {
                if ready {
                    self.ready(wires.now());
                }
            }),
        }
        .map_err(StepError::Wires)
    }
}
