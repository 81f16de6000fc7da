//! The trait of the wires to a chip, and one step of the driver over such wires.

use super::next::ExchangePlan;
use super::{Host, HostError, PendingExchange};
use crate::ethercat::Ns;

/// The wires to one chip (SPI or USB), with a clock for the driver.
pub trait Wires {
    /// The error of an exchange or a wait.
    type Error;

    /// The time in nanoseconds; its zero point is arbitrary.
    fn now(&self) -> Ns;

    /// Sends `to_chip` and receives the same number of bytes into `from_chip`, under one chip select.
    ///
    /// # Errors
    /// The wires cannot be used; it is unknown how many bytes were transferred.
    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Self::Error>;

    /// Waits until `time`; returns at once if it has passed.
    ///
    /// # Errors
    /// The wires cannot be used any more.
    fn wait_until(&mut self, time: Ns) -> Result<(), Self::Error>;

    /// Waits until INT0 becomes active after the last exchange, at most until the time `until`; returns whether INT0
    /// became active. Wires without INT0 return `false` at once.
    ///
    /// # Errors
    /// INT0 cannot be read.
    fn wait_ready(&mut self, until: Ns) -> Result<bool, Self::Error>;
}

/// Why a step of the driver over wires failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepError<E> {
    /// The driver has stopped, for this reason.
    Host(HostError),
    /// An exchange or a wait over the wires has failed.
    Wires(E),
}

impl Host {
    /// Makes one step over these wires: an exchange, or a wait for the next exchange that ends at `until`.
    ///
    /// # Errors
    /// The driver has stopped, or the wires cannot be used. A packet whose exchange failed is sent again by the next
    /// step, as after a damaged answer.
    pub fn step<W: Wires + ?Sized>(&mut self, wires: &mut W, until: Ns) -> Result<(), StepError<W::Error>> {
        match self.plan(wires.now()).map_err(StepError::Host)? {
            ExchangePlan::Exchange(what) => {
                let to_chip = match what {
                    PendingExchange::Filler => self.search.filler(),
                    PendingExchange::Packet => &self.packets[self.current][..self.size.packet_len()],
                };
                let len = to_chip.len();
                let done = wires.exchange(to_chip, &mut self.receive_buffer.packet()[..len]);
                self.came(wires.now(), if done.is_ok() { len } else { 0 });
                done
            }
            ExchangePlan::WaitUntil(time) => wires.wait_until(time.min(until)),
            ExchangePlan::WaitForReady { until: time } => wires.wait_ready(time.min(until)).map(|ready| {
                if ready {
                    self.ready(wires.now());
                }
            }),
        }
        .map_err(StepError::Wires)
    }
}
