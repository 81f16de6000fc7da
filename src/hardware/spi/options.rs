//! The keys of `spi:` as Rust types, and which of their values exclude each other.

use std::path::PathBuf;
use std::time::Duration;

use crate::address::keys::{self, Scheme};
use crate::address::uri::{LinkUri, UriError, slot_size};
use crate::io::spi::{GpioLine, SpiSettings};
use crate::sk::{CycleTime, SlotSize};

/// SK-10: the shortest time between the starts of two exchanges if BUSY is not connected. Then nothing else shows when
/// the board is ready.
pub(super) const PERIOD_WITHOUT_BUSY: Duration = Duration::from_micros(800);
/// SK-10: the shortest cycle time if BUSY is not connected.
const LEAST_CYCLE_WITHOUT_BUSY_US: u32 = 1000;
/// SK-10: the minimum number of SCLK clocks per cycle. A cycle of 250 us needs 24 MHz and a cycle of 1 ms needs 6 MHz:
/// both are 6000 clocks. Other cycle times need the same number \[OURS].
const LEAST_CLOCKS_PER_CYCLE: u64 = 6000;
/// How long a board may take to answer when its link is opened, since it may still be starting up. \[OURS]
const OPEN_LIMIT: Duration = Duration::from_secs(3);
/// How long BUSY may stay high after a frame before the board counts as lost. \[OURS]
const BUSY_LIMIT: Duration = Duration::from_secs(1);

/// Options of a link over SPI.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpiOptions {
    /// The slot size; an exchange has 504 bytes for 12-byte slots and 512 bytes for 16-byte slots.
    pub slot: SlotSize,
    /// The frequency of SCLK in Hz.
    pub speed_hz: u32,
    /// The cycle time in OP, until the program sets another one by SET_DC.
    pub cycle: CycleTime,
    /// How many command frames to keep in the board's FIFO ahead of their execution, 0..=120 (`prefill=`). While they
    /// last, a cycle for which the program has no frame does not interrupt the motion.
    pub prefill: u16,
    /// How long a board may take to answer when its link is opened, since it may still be starting up.
    pub open_limit: Duration,
    /// How long BUSY may stay high after a frame before the board counts as lost.
    pub busy_limit: Duration,
}

impl Default for SpiOptions {
    fn default() -> Self {
        Self {
            slot: SlotSize::default(),
            speed_hz: 24_000_000,
            cycle: CycleTime::DEFAULT,
            prefill: 0,
            open_limit: OPEN_LIMIT,
            busy_limit: BUSY_LIMIT,
        }
    }
}

impl SpiOptions {
    /// The options in a URI, and the devices that it names. Missing keys have their defaults.
    ///
    /// # Errors
    /// [`UriError::OtherScheme`] if it is not an `spi:` link; [`UriError::BadPath`] without a device;
    /// [`UriError::BadValue`] for a cycle time that is not 250 us * 2^n or is too short for these wires.
    pub fn from_uri(uri: &LinkUri) -> Result<(Self, SpiSettings), UriError> {
        uri.expect_scheme(Scheme::Spi)?;
        let hertz = |value: &str| keys::hertz(value)?.try_into().ok();
        let places = SpiSettings {
            device: device(uri, "spi:/dev/spidevB.C, e.g. spi:/dev/spidev0.0")?,
            speed_hz: uri.required("speed", hertz)?,
            mode: uri.required("mode", |value| value.parse().ok())?,
            busy: uri.typed("busy", GpioLine::parse)?,
            reset: uri.typed("reset", GpioLine::parse)?,
        };
        let options = Self {
            slot: uri.required("slot", slot_size)?,
            speed_hz: places.speed_hz,
            cycle: uri
                .required("cycle_us", |value| Some(value.parse().ok().and_then(CycleTime::from_us)))?
                .ok_or_else(|| {
                    bad_cycle(
                        uri,
                        "a cycle is 250 us, 500 us, 1000 us and so on up to 1 s; allowed: 250 * 2^n".to_owned(),
                    )
                })?,
            prefill: uri.required("prefill", |value| value.parse().ok())?,
            ..Self::default()
        };
        match options.refuses(options.cycle, places.busy.is_some()) {
            Some(why) if options.cycle != CycleTime::DEFAULT => Err(bad_cycle(uri, why)),
            // The default cycle time is checked only when OP is requested: a program that stays below OP, or sets a
            // longer cycle, can use these wires.
            _ => Ok((options, places)),
        }
    }

    /// Returns the text that says why OP with that cycle time does not work over these wires, and what to do; `None` if
    /// it works. `busy`: whether BUSY is connected.
    pub(super) fn refuses(&self, cycle: CycleTime, busy: bool) -> Option<String> {
        if !busy && cycle.us() < LEAST_CYCLE_WITHOUT_BUSY_US {
            return Some(format!(
                "without BUSY a cycle has {LEAST_CYCLE_WITHOUT_BUSY_US} us at least, this one has {}; connect BUSY \
                 (J3/J2 pin 5) and name its line with busy=",
                cycle.us()
            ));
        }
        let least = LEAST_CLOCKS_PER_CYCLE * 1_000_000 / u64::from(cycle.us());
        (u64::from(self.speed_hz) < least).then(|| {
            format!(
                "a cycle of {} us needs a clock of {least} Hz at least, this one has {}; set speed={least}, or a longer \
                 cycle with SET_DC",
                cycle.us(),
                self.speed_hz
            )
        })
    }

    /// The time that the transfer of one frame takes at the clock frequency `speed_hz`.
    pub(super) fn on_the_wires(&self) -> Duration {
        let bits = self.slot.frame_len() as u64 * 8;
        Duration::from_nanos(bits * 1_000_000_000 / u64::from(self.speed_hz.max(1)))
    }
}

/// The path of the spidev file in a link. `allowed`: the expected form of a link, for the error text.
pub(crate) fn device(uri: &LinkUri, allowed: &'static str) -> Result<PathBuf, UriError> {
    if uri.path().starts_with('/') && !uri.path().contains('\0') {
        return Ok(PathBuf::from(uri.path()));
    }
    Err(UriError::BadPath { scheme: uri.scheme(), path: uri.path().to_owned(), allowed })
}

fn bad_cycle(uri: &LinkUri, why: String) -> UriError {
    let value = uri.value("cycle_us").unwrap_or_default().to_owned();
    UriError::BadValue { key: "cycle_us".to_owned(), value, why }
}
