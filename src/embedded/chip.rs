//! The wires to an ECM-XF on SPI.

use core::sync::atomic::{AtomicBool, Ordering};

use embedded_hal::spi::SpiDevice;

use crate::ethercat::Ns;
use crate::xf::host::Wires;

/// The wires to an ECM-XF on SPI (mode 0, up to 24 MHz, chip select low during a whole packet) for its driver,
/// [`Host`](crate::xf::host::Host). It waits by reading the clock in a loop.
///
/// ```
/// use core::sync::atomic::AtomicBool;
///
/// use ecmsk::embedded::ChipWires;
/// use ecmsk::xf::host::{Host, HostConfig, HostError, HostPacing, StepError, Wires};
/// # use embedded_hal::spi::SpiDevice;
///
/// /// Set by the interrupt of the pin of INT0, at each edge to its active level.
/// static INT0: AtomicBool = AtomicBool::new(false);
///
/// /// Runs the driver until it stops. `now` is a timer that counts nanoseconds.
/// fn run<S: SpiDevice>(spi: S, now: impl Fn() -> u64) -> StepError<S::Error> {
///     let mut wires = ChipWires::with_int0(spi, now, &INT0);
///     let config = HostConfig { pacing: HostPacing::Int0, ..HostConfig::default() };
///     let mut host = Host::new(wires.now(), config);
///     loop {
///         if let Err(error) = host.step(&mut wires, u64::MAX) {
///             return error;
///         }
///         // Here commands are submitted, and their answers taken.
///     }
/// }
/// ```
#[derive(Clone, Debug)]
pub struct ChipWires<'a, S, N> {
    spi: S,
    now: N,
    ready: Option<&'a AtomicBool>,
}

impl<S: SpiDevice, N: Fn() -> Ns> ChipWires<'static, S, N> {
    /// Wires without INT0, for [`HostPacing::Idle`](crate::xf::host::HostPacing::Idle). `now` returns the time in
    /// nanoseconds, from any zero; it never goes back.
    pub const fn new(spi: S, now: N) -> Self {
        Self { spi, now, ready: None }
    }
}

impl<'a, S: SpiDevice, N: Fn() -> Ns> ChipWires<'a, S, N> {
    /// Wires with INT0, for [`HostPacing::Int0`](crate::xf::host::HostPacing::Int0). An interrupt sets `ready` at each edge
    /// of INT0 to its active level: the level alone does not say whether the chip has taken the packet (XF EN 1706).
    pub const fn with_int0(spi: S, now: N, ready: &'a AtomicBool) -> Self {
        Self { spi, now, ready: Some(ready) }
    }

    /// Gives the SPI device back.
    pub fn release(self) -> S {
        self.spi
    }
}

impl<S: SpiDevice, N: Fn() -> Ns> Wires for ChipWires<'_, S, N> {
    type Error = S::Error;

    fn now(&self) -> Ns {
        (self.now)()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), S::Error> {
        if let Some(ready) = self.ready {
            // Edges from before the exchange say nothing of this packet.
            ready.store(false, Ordering::SeqCst);
        }
        self.spi.transfer(from_chip, to_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), S::Error> {
        while self.now() < time {
            core::hint::spin_loop();
        }
        Ok(())
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, S::Error> {
        let Some(ready) = self.ready else { return Ok(false) };
        loop {
            // Loads and stores alone, for processors without a swap.
            if ready.load(Ordering::SeqCst) {
                ready.store(false, Ordering::SeqCst);
                return Ok(true);
            }
            if self.now() >= until {
                return Ok(false);
            }
            core::hint::spin_loop();
        }
    }
}
