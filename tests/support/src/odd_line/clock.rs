//! Distributed clocks: receive times, and a clock that is synchronised to the reference.

use super::{Ns, OddSlave};

/// Phase gain: the share of the phase error that each received reference time corrects. The error counts at most as
/// [`LIMIT_NS`].
const PHASE: f64 = 1.0 / 16.0;
/// Frequency gain: the share of the phase error that corrects the speed.
const SPEED: f64 = 1.0 / 1024.0;
/// A greater phase error counts as this, ns: a clock never jumps.
const LIMIT_NS: f64 = 1_000.0;
/// The greatest correction of a clock's speed.
const SPEED_MAX: f64 = 60e-6;

/// A clock.
pub struct Clock {
    /// Error of the crystal, parts per million; positive if it is too fast.
    pub ppm: f64,
    /// The local time at the start, ns.
    pub base: u64,
    /// The clock has 32 bits: the upper halves of its times read 0.
    pub is_short: bool,
    /// The receive times of the ports are swapped, although the frame takes its usual way.
    pub swaps_times: bool,
    /// The correction up to `at`, ns, and its rate of change.
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
            is_short: false,
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

    /// The speed counter was written: the average starts anew.
    pub(super) const fn forget(&mut self) {
        self.mean = 0.0;
        self.is_told = false;
    }

    /// Corrects the clock by its phase error; `ahead` is negative if the clock is behind the reference.
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

    /// A time as a register of 8 bytes shows it.
    fn shown(&self, time: u64) -> [u8; 8] {
        let is_short = self.clock.as_ref().is_some_and(|clock| clock.is_short);
        if is_short { u64::from(time as u32) } else { time }.to_le_bytes()
    }

    pub(super) fn show_time(&mut self) {
        if let Some(time) = self.system_time(self.now) {
            self.put(0x0910, &self.shown(time));
        }
    }

    /// A write to 0x0900 latches the times at which this frame passes.
    pub(super) fn latch(&mut self) {
        let Some(clock) = &self.clock else { return };
        let mut times = self.passed.map(|at| clock.local(at));
        let unit = clock.local(self.now);
        if clock.swaps_times {
            times.reverse();
        }
        let status = self.word(0x0110);
        for (n, time) in times.into_iter().enumerate() {
            // A closed port keeps its old time.
            if status & 1 << (8 + 2 * n) == 0 {
                self.put(0x0900 + 4 * n, &(time as u32).to_le_bytes());
            }
        }
        self.put(0x0918, &self.shown(unit));
    }

    /// Takes the time of the reference.
    pub(super) fn take_time(&mut self, data: &[u8]) {
        let Some(sent) = data.first_chunk().map(|four| u32::from_le_bytes(*four)) else { return };
        let Some(own) = self.system_time(self.now) else { return };
        let ahead = (own as u32).wrapping_sub(sent).cast_signed();
        let Some(clock) = &mut self.clock else { return };
        clock.follow(self.now, ahead);
        let mean = clock.mean.round() as i64;
        // Bit 31: the local time is less than the received one.
        let shown = (mean.unsigned_abs() as u32).min(0x7FFF_FFFF) | if mean < 0 { 1 << 31 } else { 0 };
        self.put(0x092C, &shown.to_le_bytes());
    }
}
