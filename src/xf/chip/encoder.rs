//! The chip's encoder input.

use crate::xf::request::{EncoderMode, PeripheralInterrupts};

/// The count at which the modes `X2Compare` and `X4Compare` raise their interrupt and the count wraps. `[OURS]` The
/// manuals have no command that sets this limit, so the limit is the largest u32, after which the count wraps in every
/// mode.
const COMPARE_LIMIT: u32 = u32::MAX;

pub(super) struct Encoder {
    mode: Option<EncoderMode>,
    is_running: bool,
    /// Position since the encoder was opened, in quarters of a period of its signals A and B.
    quarters: i64,
    count: u32,
    pub flags: PeripheralInterrupts,
}

impl Encoder {
    pub const fn new() -> Self {
        Self { mode: None, is_running: false, quarters: 0, count: 0, flags: PeripheralInterrupts::NONE }
    }

    /// Opens the encoder. `[OURS]` The count is 0, and counting is stopped.
    pub const fn open(&mut self, mode: EncoderMode) {
        (self.mode, self.is_running, self.quarters, self.count) = (Some(mode), false, 0, 0);
    }

    /// Starts or stops counting; returns false if the encoder is not open.
    pub const fn run(&mut self, on: bool) -> bool {
        self.is_running = on && self.mode.is_some();
        self.mode.is_some()
    }

    /// The count; `None` if the encoder is not open.
    pub fn count(&self) -> Option<u32> {
        self.mode.map(|_| self.count)
    }

    /// Turns the shaft by `quarters` quarters of a period of the signals A and B.
    pub fn turn(&mut self, quarters: i32) {
        let Some(mode) = self.mode.filter(|_| self.is_running) else { return };
        let per_count = match mode {
            EncoderMode::X4Free | EncoderMode::X4Compare => 1,
            EncoderMode::X2Free | EncoderMode::X2Compare => 2,
        };
        let was = self.quarters.div_euclid(per_count);
        self.quarters += i64::from(quarters);
        let count = i64::from(self.count) + self.quarters.div_euclid(per_count) - was;
        let wraps = count < 0 || count > i64::from(COMPARE_LIMIT);
        self.count = count as u32;
        if wraps {
            self.flags = self.flags
                | match mode {
                    EncoderMode::X4Free | EncoderMode::X2Free => PeripheralInterrupts::ENCODER_OVERFLOW,
                    EncoderMode::X4Compare | EncoderMode::X2Compare => PeripheralInterrupts::ENCODER_COMPARE,
                };
        }
    }

    /// Handles the index pulse: sets its interrupt flag; the count is kept.
    pub fn index(&mut self) {
        if self.is_running {
            self.flags = self.flags | PeripheralInterrupts::ENCODER_INDEX;
        }
    }
}
