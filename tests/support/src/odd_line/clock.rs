//! Distributed clocks: receive times, and a clock that is led to the time of the reference.

use super::{Ns, OddSlave};

/// Of the difference to the reference so much is taken away each time that its time comes, at most that of [`LIMIT_NS`].
const PHASE: f64 = 1.0 / 16.0;
/// And so much of it, of which the speed is wrong, with each.
const SPEED: f64 = 1.0 / 1024.0;
/// A greater difference counts as this, ns: a clock never jumps.
const LIMIT_NS: f64 = 1_000.0;
/// By how much a clock is made faster or slower at most.
const SPEED_MAX: f64 = 60e-6;

/// A clock.
pub struct Clock {
    /// By how much its crystal is too fast, parts per million.
    pub ppm: f64,
    /// What it shows when everything begins, ns.
    pub base: u64,
    /// The port times that a frame leaves are swapped, although the frame takes its usual way.
    pub swaps_times: bool,
    /// What was added to it to follow the reference, ns, up to `at`, and how fast that grows.
    slewed: f64,
    speed: f64,
    at: Ns,
    /// The mean difference, register 0x092C.
    mean: f64,
    /// The greatest difference in the last second, ns.
    is_told: bool,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            ppm: 0.0,
            base: 0x0012_3456_789A,
            swaps_times: false,
            slewed: 0.0,
            speed: 0.0,
            at: 0,
            mean: 0.0,
            is_told: false,
        }
    }
}

impl Clock {
    fn local(&self, now: Ns) -> u64 {
        let own = now as f64 * self.ppm * 1e-6 + self.slewed + (now.saturating_sub(self.at)) as f64 * self.speed;
        self.base.wrapping_add(now).wrapping_add_signed(own.round() as i64)
    }

    /// The speed counter was written: what was averaged is forgotten.
    pub(super) const fn forget(&mut self) {
        self.mean = 0.0;
        self.is_told = false;
    }

    /// It is behind the reference by so much: `ahead` is negative then.
    fn follow(&mut self, now: Ns, ahead: i32) {
        let since = now.saturating_sub(self.at);
        self.slewed += since as f64 * self.speed;
        self.at = now;
        let shown = f64::from(ahead);
        self.mean = if self.is_told { self.mean + (shown - self.mean) / 16.0 } else { shown };
        self.is_told = true;
        let ahead = shown.clamp(-LIMIT_NS, LIMIT_NS);
        self.slewed -= ahead * PHASE;
        self.speed = (self.speed - ahead * SPEED / since.max(100_000) as f64).clamp(-SPEED_MAX, SPEED_MAX);
    }
}

impl OddSlave {
    fn system_time(&self, at: Ns) -> Option<u64> {
        let offset = u64::from_le_bytes(*self.memory[0x0920..].first_chunk()?);
        let delay = u32::from_le_bytes(*self.memory[0x0928..].first_chunk()?);
        Some(self.clock.as_ref()?.local(at).wrapping_add(offset).wrapping_sub(delay.into()))
    }

    pub(super) fn show_time(&mut self) {
        if let Some(time) = self.system_time(self.now) {
            self.put(0x0910, &time.to_le_bytes());
        }
    }

    /// A write to 0x0900: the times at which this frame passes.
    pub(super) fn latch(&mut self) {
        let Some(clock) = &self.clock else { return };
        let mut times = self.passed.map(|at| clock.local(at));
        let unit = clock.local(self.now);
        if clock.swaps_times {
            times.reverse();
        }
        let status = self.word(0x0110);
        for (n, time) in times.into_iter().enumerate() {
            // A port that is closed keeps what it had.
            if status & 1 << (8 + 2 * n) == 0 {
                self.put(0x0900 + 4 * n, &(time as u32).to_le_bytes());
            }
        }
        self.put(0x0918, &unit.to_le_bytes());
    }

    /// The time of the reference comes.
    pub(super) fn take_time(&mut self, data: &[u8]) {
        let Some(sent) = data.first_chunk().map(|four| u32::from_le_bytes(*four)) else { return };
        let Some(own) = self.system_time(self.now) else { return };
        let ahead = (own as u32).wrapping_sub(sent).cast_signed();
        let Some(clock) = &mut self.clock else { return };
        clock.follow(self.now, ahead);
        let mean = clock.mean.round() as i64;
        // Bit 31: the local time is less than the one that came.
        let shown = (mean.unsigned_abs() as u32).min(0x7FFF_FFFF) | if mean < 0 { 1 << 31 } else { 0 };
        self.put(0x092C, &shown.to_le_bytes());
    }
}
