//! Where a frame or packet stands in the input, and its direction.

use ecmsk::link::Dir;

/// The place of a frame or packet.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The number in the recording, or the line of the input, from 1.
    pub number: u64,
    /// The time; `None` for what hexadecimal digits give.
    pub time: Option<Time>,
    /// To the board or chip, or from it.
    pub direction: Dir,
    /// Whether the direction is a guess.
    pub guessed: bool,
}

impl Place {
    /// The place of a line of digits, whose direction is told or else guessed.
    pub fn of_line(line: u64, told: Option<Dir>, guess: impl FnOnce() -> Dir) -> Self {
        Self { number: line, time: None, direction: told.unwrap_or_else(guess), guessed: told.is_none() }
    }
}

/// The time of a frame or packet.
#[derive(Clone, Copy, Debug)]
pub struct Time {
    /// Nanoseconds since the recording's first frame or packet.
    pub since_start_ns: i64,
    /// Nanoseconds as recorded: since 1970-01-01, or of a virtual clock.
    pub recorded_ns: u64,
}
