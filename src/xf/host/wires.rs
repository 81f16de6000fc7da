//! The wires to a chip as the driver uses them, and one step of the driver over them.

use super::{Host, HostError, Next};
use crate::ethercat::Ns;
use crate::xf::MAX_PACKET;

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
    /// One step over these wires: an exchange, or a wait for the next one that ends at `until`. `back` is room for what
    /// the chip sends.
    ///
    /// # Errors
    /// The driver has stopped, or the wires cannot be used. What was on its way in an exchange that failed is sent
    /// again by the next step, as after a damaged answer.
    pub fn step<W: Wires + ?Sized>(
        &mut self,
        wires: &mut W,
        back: &mut [u8; MAX_PACKET],
        until: Ns,
    ) -> Result<(), StepError<W::Error>> {
        match self.next(wires.now()).map_err(StepError::Host)? {
            Next::Exchange(packet) => {
                let back = &mut back[..packet.len()];
                let done = wires.exchange(packet, back);
                let came: &[u8] = if done.is_ok() { back } else { &[] };
                self.received(wires.now(), came);
                done
            }
            Next::WaitUntil(time) => wires.wait_until(time.min(until)),
            Next::WaitForReady { until: time } => wires.wait_ready(time.min(until)).map(|ready| {
                if ready {
                    self.ready(wires.now());
                }
            }),
        }
        .map_err(StepError::Wires)
    }
}
