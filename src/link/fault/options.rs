//! What the keys `fault.*` say, as types.

use std::time::Duration;

use crate::link::Fraction;
use crate::link::options::millis;
use crate::link::uri::{LinkUri, UriError};

/// What befalls frames of one direction. Each is the share of frames, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultRates {
    /// Lost on the way.
    pub drop: Fraction,
    /// One bit is turned over.
    pub corrupt: Fraction,
    /// They arrive twice.
    pub duplicate: Fraction,
    /// They are held up for [`FaultOptions::delay`].
    pub delay: Fraction,
}

/// Faults of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultOptions {
    /// Which sequence of random faults.
    pub seed: u64,
    /// Of command frames.
    pub write: FaultRates,
    /// Of reports.
    pub read: FaultRates,
    /// How long a frame is held up.
    pub delay: Duration,
    /// The board is lost after that many frames in both directions: 1 or more.
    pub disconnect_after: Option<u64>,
    /// The board is lost that long after the link was opened.
    pub disconnect_at: Option<Duration>,
}

impl Default for FaultOptions {
    /// None.
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
    /// The faults of that link.
    ///
    /// # Errors
    /// [`UriError`] if the table of keys and these types disagree.
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

    /// Whether there is any fault at all.
    pub fn any(&self) -> bool {
        let quiet = FaultRates::default();
        self.write != quiet || self.read != quiet || self.disconnect_after.is_some() || self.disconnect_at.is_some()
    }
}
