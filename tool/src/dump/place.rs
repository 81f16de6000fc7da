//! The position of a frame or packet in the input, and its direction.

use ecmsk::link::Dir;

/// The position of a frame or packet in the input, and its direction.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The number of the frame or packet in the recording, or of the line of standard input, from 1.
    pub number: u64,
    /// The time; `None` for lines of hexadecimal digits.
    pub time: Option<Time>,
    /// The direction: to the board or chip, or from it.
    pub direction: Dir,
    /// Whether the direction was guessed from the bytes, because the input does not contain it.
    pub guessed: bool,
}

impl Place {
    /// The position of a line of hexadecimal digits. `told` is the direction from the line or from an option. Without
    /// it, `guess` determines the direction.
    pub fn of_line(line: u64, told: Option<Dir>, guess: impl FnOnce() -> Dir) -> Self {
        Self { number: line, time: None, direction: told.unwrap_or_else(guess), guessed: told.is_none() }
    }
}

/// The time of a frame or packet.
#[derive(Clone, Copy, Debug)]
pub struct Time {
    /// Time of the recording in nanoseconds.
    pub since_start_ns: i64,
    /// The recorded time in nanoseconds: since 1970-01-01, or of a virtual clock.
    pub recorded_ns: u64,
}
