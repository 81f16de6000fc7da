//! Settings of an [`Ecm`](super::Ecm): timeouts, checks, and what happens to the axes when it is closed.

use std::time::Duration;

use crate::sk::SlotSize;

/// SK `[OURS]`: the time limit for closing a board.
pub const CLOSE_LIMIT: Duration = Duration::from_secs(2);

/// What happens to the axes when an [`Ecm`](super::Ecm) is closed or dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Close {
    /// Moving axes are brought to a standstill and stay enabled, so that a vertical axis does not drop: in CSP they
    /// hold the last target that the board has accepted; velocities and torques are ramped to 0.
    #[default]
    Hold,
    /// As [`Close::Hold`]; then the axes are switched off.
    ServoOff,
    /// Nothing is sent: the board goes on executing the entries of its FIFO.
    Leave,
}

/// Settings of an [`Ecm`](super::Ecm). Every value has a default; all limits are \[OURS].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// The slot size of the board, for a link that does not know it.
    pub slot: Option<SlotSize>,
    /// Whether a CRC byte of 0 in a report is checked as any other value is. If not, 0 means that the report has no CRC
    /// (SK-1).
    pub strict_crc: bool,
    /// Whether the guard of each axis ([`Guard`](super::Guard)) checks the distance of its targets; `false` switches all
    /// guards off.
    pub guard: bool,
    /// The time without a report after which the board counts as silent: 1 s, and at least three cycles.
    pub read_limit: Duration,
    /// How long a write waits for the board to accept the frame: 1 s.
    pub write_limit: Duration,
    /// The timeout of a change of state: 30 s, more than the board's own timeout.
    pub state_limit: Duration,
    /// The timeout of an SDO transfer: 3 s, more than the board's own timeout.
    pub sdo_limit: Duration,
    /// The timeout of switching axes on or off, clearing alarms, reading inputs and setting outputs: 5 s.
    pub servo_limit: Duration,
    /// What happens to the axes when the [`Ecm`](super::Ecm) is dropped.
    pub close: Close,
    /// How long a velocity or torque takes to fall to 0 when a stream ends or the board is closed: 250 ms by default, at
    /// most 1.5 s.
    pub ramp: Duration,
}

impl Options {
    /// The longest ramp, so that closing ends within [`CLOSE_LIMIT`].
    pub const MAX_RAMP: Duration = Duration::from_millis(1500);
}

impl Default for Options {
    fn default() -> Self {
        Self {
            slot: None,
            strict_crc: false,
            guard: true,
            read_limit: Duration::from_secs(1),
            write_limit: Duration::from_secs(1),
            state_limit: Duration::from_secs(30),
            sdo_limit: Duration::from_secs(3),
            servo_limit: Duration::from_secs(5),
            close: Close::Hold,
            ramp: Duration::from_millis(250),
        }
    }
}
