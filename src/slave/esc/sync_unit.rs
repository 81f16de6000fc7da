//! The unit that gives SYNC0 and SYNC1 at times of the distributed clock.

use crate::ethercat::registers::SyncActivation;

/// A pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncPulse {
    /// SYNC0.
    Sync0,
    /// SYNC1.
    Sync1,
}

/// How far ahead a start time may be if the near future is the nearer one, ns.
const NEAR_FUTURE_NS: i64 = 1 << 31;

/// The unit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SyncUnit {
    activation: SyncActivation,
    /// The system time of the next pulse of SYNC0, ns.
    next0: Option<u64>,
    /// That of SYNC1.
    next1: Option<u64>,
    cycle0_ns: u32,
    delay1_ns: u32,
    /// The start time was not in the near future.
    is_out_of_range: bool,
    /// SYNC0 and SYNC1 have had a pulse since the activation.
    fired: [bool; 2],
}

/// Whether a time has come, with times that wrap.
const fn is_reached(time: u64, now: u64) -> bool {
    (now.wrapping_sub(time)).cast_signed() >= 0
}

impl SyncUnit {
    /// The activation was written. `start`: the time of the first pulse.
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
                // A start in the past comes with the next turn of the counter, which nobody waits for.
                false => (ahead > 0).then_some(start),
            };
            self.next1 = self.next0.map(|first| first.wrapping_add(self.delay1_ns.into()));
            self.fired = [false; 2];
        }
    }

    /// Whether the unit gives SYNC0.
    pub(super) const fn is_running(&self) -> bool {
        self.activation.contains(SyncActivation(SyncActivation::ACTIVATE.0 | SyncActivation::SYNC0.0))
    }

    const fn gives_sync1(&self) -> bool {
        self.activation.contains(SyncActivation::SYNC1)
    }

    /// The system time of the next pulse of either signal, and which one it is; SYNC0 first if both are at once.
    pub(super) fn next(&self) -> Option<(u64, SyncPulse)> {
        let next1 = self.next1.filter(|_| self.gives_sync1());
        match (self.next0, next1) {
            (Some(zero), Some(one)) if one != zero && is_reached(one, zero) => Some((one, SyncPulse::Sync1)),
            (Some(zero), _) => Some((zero, SyncPulse::Sync0)),
            (None, one) => Some((one?, SyncPulse::Sync1)),
        }
    }

    /// The pulses that come up to `now`, one at a time.
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

    /// The period of SYNC1, ns: as many cycles of SYNC0 as fit into its delay, and one more.
    fn period1_ns(&self) -> u64 {
        let turns = self.delay1_ns.checked_div(self.cycle0_ns).map_or(0, |turns| u64::from(turns) + 1);
        turns * u64::from(self.cycle0_ns)
    }

    /// Leaves out the pulses that have come by now, and says of which signals there were some.
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

    /// Registers 0x0990 and 0x0998: when the next pulses come.
    pub(super) fn shown(&self) -> (Option<u64>, Option<u64>) {
        (self.next0, self.next1)
    }

    /// Register 0x0984: which first pulses are still to come, and whether the start time was out of range.
    pub(super) fn pending(&self) -> u8 {
        let zero = self.next0.is_some() && !self.fired[0];
        let one = self.gives_sync1() && self.next1.is_some() && !self.fired[1];
        u8::from(zero) | u8::from(one) << 1 | u8::from(self.is_out_of_range) << 2
    }
}
