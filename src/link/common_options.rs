//! The keys that every link has, as Rust types. The table `address/keys/table.rs` has their defaults and their help.

use std::path::PathBuf;
use std::time::Duration;

use super::fault::FaultOptions;
use super::record::flight::FlightOptions;
use super::{LinkInfo, Stamp, Wait};
use crate::address::keys::{byte_count, millis};
use crate::address::uri::{LinkUri, UriError, slot_size};
use crate::sk::SlotSize;

/// Options that every link has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommonOptions {
    /// The slot size (`slot=`); `None` if the URI does not give one. For a board that is modelled in this process it is
    /// never `None`, since the key then has a default.
    pub slot: Option<SlotSize>,
    /// How many unread reports are kept (`queue=`), 1 or more. When the queue is full the oldest report is dropped.
    pub queue: usize,
    /// The file to which the link is recorded (`record=`); `None`: no recording.
    pub record: Option<PathBuf>,
    /// The machine file with the axes (`axes=`, otherwise `machine=`); `None`: none.
    pub axes: Option<PathBuf>,
    /// The flight recorder of the link (`flight=` and `flight_*=`); `None`: there is none.
    pub flight: Option<FlightOptions>,
    /// The time limit of a read (`read_timeout_ms=`); `None`: a read waits until there is a report.
    pub read_timeout: Option<Duration>,
    /// The time limit of a write while the board does not accept the frame (`write_timeout_ms=`).
    pub write_timeout: Duration,
    /// The faults that the link injects into frames (`fault.*`); none by default.
    pub fault: FaultOptions,
}

/// The options of the flight recorder in a URI; `None` without `flight=`.
fn flight(uri: &LinkUri) -> Result<Option<FlightOptions>, UriError> {
    let Some(folder) = uri.typed("flight", |value| Some(PathBuf::from(value)))? else { return Ok(None) };
    Ok(Some(FlightOptions {
        folder,
        bytes: uri.required("flight_bytes", byte_count)?,
        kept_bytes: uri.required("flight_kept_bytes", byte_count)?,
        following_error: uri.typed("flight_following_error", |value| value.parse().ok())?,
    }))
}

impl CommonOptions {
    /// The options in a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError::BadValue`] if a value does not fit the type of its option.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        Ok(Self {
            slot: uri.typed("slot", slot_size)?,
            queue: uri.required("queue", |value| value.parse().ok())?,
            record: uri.typed("record", |value| Some(PathBuf::from(value)))?,
            axes: uri.value("axes").or_else(|| uri.value("machine")).map(PathBuf::from),
            flight: flight(uri)?,
            read_timeout: uri.typed("read_timeout_ms", millis)?,
            write_timeout: uri.required("write_timeout_ms", millis)?,
            fault: FaultOptions::from_uri(uri)?,
        })
    }

    /// The time limit of a read as a [`Wait`].
    pub fn read_wait(&self) -> Wait {
        self.read_timeout.map_or(Wait::Forever, Wait::For)
    }

    /// The time limit of a write as a [`Wait`].
    pub const fn write_wait(&self) -> Wait {
        Wait::For(self.write_timeout)
    }

    /// The properties of a link with these options that has a real clock. The clock counts from the opening of the
    /// link, so the link calls this function when it is opened.
    pub fn info(&self, name: String, slot: Option<SlotSize>) -> LinkInfo {
        let (read_wait, write_wait) = (self.read_wait(), self.write_wait());
        LinkInfo { name, slot, virtual_time: false, opened_at: Stamp(0), read_wait, write_wait }
    }
}
