//! The keys `fault.*` as Rust types.

use std::time::Duration;

use crate::address::Fraction;
use crate::address::keys::millis;
use crate::address::uri::{LinkUri, UriError};

/// The fault rates of one direction: for each fault the fraction of frames that it affects, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultRates {
    /// The fraction of frames that are lost.
    pub drop: Fraction,
    /// The fraction of frames in which one bit is flipped.
    pub corrupt: Fraction,
    /// The fraction of frames that arrive twice.
    pub duplicate: Fraction,
    /// The fraction of frames that arrive late, by [`FaultOptions::delay`].
    pub delay: Fraction,
}

/// The faults that a link injects: how often, and which pseudorandom sequence chooses the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultOptions {
    /// The seed of the pseudorandom sequences. The same seed gives the same faults.
    pub seed: u64,
    /// The fault rates of command frames.
    pub write: FaultRates,
    /// The fault rates of reports.
    pub read: FaultRates,
    /// How long a delayed frame is held back.
    pub delay: Duration,
    /// The number of frames written and read after which the board is disconnected, 1 or more; calls that failed do not
    /// count. `None`: never.
    pub disconnect_after: Option<u64>,
    /// The time after the opening of the link at which the board is disconnected; `None`: never.
    pub disconnect_at: Option<Duration>,
}

impl Default for FaultOptions {
    /// Options without any faults.
    fn default() -> Self {
        Self {
            seed: 1,
            write: FaultRates::default(),
            read: FaultRates::default(),
            delay: Duration::from_millis(10),
            disconnect_after: None,
            disconnect_at: None,
        }
    }
}

impl FaultOptions {
    /// Reads the faults to inject from the keys `fault.*` of a URI.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        let share = |kind: &str, direction: &str| {
            let both = uri.required(&format!("fault.{kind}"), Fraction::parse)?;
            let own = uri.typed(&format!("fault.{kind}.{direction}"), Fraction::parse)?;
            Ok::<_, UriError>(own.unwrap_or(both))
        };
        let rates = |direction| {
            Ok::<_, UriError>(FaultRates {
                drop: share("drop", direction)?,
                corrupt: share("corrupt", direction)?,
                duplicate: share("duplicate", direction)?,
                delay: share("delay", direction)?,
            })
        };
        Ok(Self {
            seed: uri.required("fault.seed", |value| value.parse().ok())?,
            write: rates("write")?,
            read: rates("read")?,
            delay: uri.required("fault.delay_ms", millis)?,
            disconnect_after: uri.typed("fault.disconnect_after", |value| value.parse().ok())?,
            disconnect_at: uri.typed("fault.disconnect_ms", millis)?,
        })
    }

    /// Whether these options inject any fault.
    pub fn any(&self) -> bool {
        let quiet = FaultRates::default();
        self.write != quiet || self.read != quiet || self.disconnect_after.is_some() || self.disconnect_at.is_some()
    }
}
