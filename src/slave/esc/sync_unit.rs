//! The SYNC unit, which generates SYNC0 and SYNC1 at times of the distributed clock.

use crate::ethercat::registers::SyncActivation;

/// A pulse of the SYNC unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncPulse {
    /// A pulse of the signal SYNC0.
    Sync0,
    /// A pulse of the signal SYNC1.
    Sync1,
}

/// The limit for the start time of SYNC0 if the master has set bit 6 (near future) of the activation register, ns: a start time
/// that is this far ahead of the system time, or farther, is out of range.
const NEAR_FUTURE_NS: i64 = 1 << 31;

/// The SYNC unit of a slave controller: its settings and the times of its next pulses.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SyncUnit {
    activation: SyncActivation,
    /// The system time of the next SYNC0 pulse, ns; `None` if none is scheduled.
    next0: Option<u64>,
    /// The system time of the next SYNC1 pulse, ns; `None` if none is scheduled.
    next1: Option<u64>,
    cycle0_ns: u32,
    delay1_ns: u32,
    /// Whether the start time was out of range: not ahead, or too far ahead. Register 0x0984 shows it.
    is_out_of_range: bool,
    /// Whether SYNC0 and SYNC1 have had a pulse since the activation.
    fired: [bool; 2],
}

/// Whether `now` has reached `time`. Both are system times, which wrap around.
const fn is_reached(time: u64, now: u64) -> bool {
    (now.wrapping_sub(time)).cast_signed() >= 0
}

impl SyncUnit {
    /// Handles a write to the activation register. `start` is the system time of the first pulse, ns; `cycles` are the
    /// SYNC0 cycle time and the delay of SYNC1, ns.
    pub(super) fn activate(&mut self, activation: SyncActivation, start: u64, now: u64, cycles: (u32, u32)) {
        let was_running = self.is_running();
        self.activation = activation;
        (self.cycle0_ns, self.delay1_ns) = cycles;
        if !self.is_running() {
            *self = Self { activation, ..Self::default() };
            return;
        }
        if !was_running {
            let ahead = start.wrapping_sub(now).cast_signed();
            let range = if activation.contains(SyncActivation::NEAR_FUTURE) { NEAR_FUTURE_NS } else { i64::MAX };
            self.is_out_of_range = !(1..range).contains(&ahead);
            self.next0 = match activation.contains(SyncActivation::CHECK_START) && self.is_out_of_range {
                true => Some(now),
                // Without the check of the start time (bit 5 of the activation register), a start time in the past schedules no
                // pulse: the 64-bit system time wraps only after centuries.
                false => (ahead > 0).then_some(start),
            };
            self.next1 = self.next0.map(|first| first.wrapping_add(self.delay1_ns.into()));
            self.fired = [false; 2];
        }
    }

    /// Whether the unit generates SYNC0.
    pub(super) const fn is_running(&self) -> bool {
        self.activation.contains(SyncActivation(SyncActivation::ACTIVATE.0 | SyncActivation::SYNC0.0))
    }

    const fn gives_sync1(&self) -> bool {
        self.activation.contains(SyncActivation::SYNC1)
    }

    /// The system time of the next pulse and its signal. If both are due at the same time, SYNC0 comes first.
    pub(super) fn next(&self) -> Option<(u64, SyncPulse)> {
        let next1 = self.next1.filter(|_| self.gives_sync1());
        match (self.next0, next1) {
            (Some(zero), Some(one)) if one != zero && is_reached(one, zero) => Some((one, SyncPulse::Sync1)),
            (Some(zero), _) => Some((zero, SyncPulse::Sync0)),
            (None, one) => Some((one?, SyncPulse::Sync1)),
        }
    }

    /// Takes the next pulse that is due at `now`.
    pub(super) fn take(&mut self, now: u64) -> Option<(u64, SyncPulse)> {
        let (at, pulse) = self.next().filter(|(at, _)| is_reached(*at, now))?;
        match pulse {
            SyncPulse::Sync0 => {
                self.fired[0] = true;
                self.next0 = (self.cycle0_ns > 0).then(|| at.wrapping_add(self.cycle0_ns.into()));
            }
            SyncPulse::Sync1 => {
                self.fired[1] = true;
                let period = self.period1_ns();
                self.next1 = (period > 0).then(|| at.wrapping_add(period));
            }
        }
        Some((at, pulse))
    }

    /// The period of SYNC1, ns. A SYNC0 pulse starts the delay of SYNC1, and the SYNC0 pulses during the delay do not start it
    /// again. So the period is the number of whole SYNC0 cycles in the delay plus one, times the SYNC0 cycle time.
    fn period1_ns(&self) -> u64 {
        let turns = self.delay1_ns.checked_div(self.cycle0_ns).map_or(0, |turns| u64::from(turns) + 1);
        turns * u64::from(self.cycle0_ns)
    }

    /// Skips the pulses that are due at `now`. Returns for each signal whether pulses were skipped.
    pub(super) fn skip_to(&mut self, now: u64) -> [bool; 2] {
        let periods = [u64::from(self.cycle0_ns), self.period1_ns()];
        let nexts = [&mut self.next0, &mut self.next1];
        let mut skipped = [false; 2];
        for ((next, period), skipped) in nexts.into_iter().zip(periods).zip(&mut skipped) {
            if let Some(at) = next.filter(|at| is_reached(*at, now)) {
                *skipped = true;
                *next = now.wrapping_sub(at).checked_div(period).map(|missed| at.wrapping_add((missed + 1) * period));
            }
        }
        skipped[1] &= self.gives_sync1();
        self.fired = [self.fired[0] | skipped[0], self.fired[1] | skipped[1]];
        skipped
    }

    /// The values of registers 0x0990 and 0x0998: the system times of the next SYNC0 and SYNC1 pulses, ns.
    pub(super) fn shown(&self) -> (Option<u64>, Option<u64>) {
        (self.next0, self.next1)
    }

    /// The value of register 0x0984: which first pulses are pending, and whether the start time was out of range.
    pub(super) fn pending(&self) -> u8 {
        let zero = self.next0.is_some() && !self.fired[0];
        let one = self.gives_sync1() && self.next1.is_some() && !self.fired[1];
        u8::from(zero) | u8::from(one) << 1 | u8::from(self.is_out_of_range) << 2
    }
}
