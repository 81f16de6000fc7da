//! The touch probes: 0x60B8 selects the signal and the edge that latch the position, 0x60B9 is the status, 0x60BA to 0x60BD
//! are the latched positions.

use super::Dp3cl;
use crate::ethercat::Ns;
use crate::slave::communication::LatchChange;

/// The number of touch probes of the drive. Probe 1 latches at SI1 or the index pulse, probe 2 at SI2 or the index
/// pulse.
pub(super) const PROBES: usize = 2;

/// Bits of 0x60B8 for probe 1; the bits for probe 2 are 8 positions higher.
const ENABLE: u16 = 1 << 0;
const CONTINUOUS: u16 = 1 << 1;
const BY_INDEX: u16 = 1 << 2;
const RISING: u16 = 1 << 4;
const FALLING: u16 = 1 << 5;
/// Bits of 0x60B9 for probe 1; the bits for probe 2 are 8 positions higher.
const ENABLED: u16 = 1 << 0;
const RISING_STORED: u16 = 1 << 1;
const FALLING_STORED: u16 = 1 << 2;

/// \[OURS] The maximum number of edges of one signal that a cycle evaluates: more than a motor can pass in a cycle. Further
/// edges of the cycle are ignored.
const EDGES_MAX: usize = 256;

/// The state of one touch probe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Probe {
    function: u16,
    status: u16,
    rising: i32,
    falling: i32,
}

/// The signal whose edges trigger a touch probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signal {
    /// The probe's input: SI1 for probe 1, SI2 for probe 2.
    Input,
    /// The index pulse of the motor.
    Index,
}

impl Probe {
    /// Writes the probe's half of 0x60B8. \[OURS] Clearing bit 0 also clears the status and keeps the positions; a
    /// rising edge of bit 0 restarts the probe.
    const fn set_function(&mut self, function: u16) {
        if function & ENABLE == 0 {
            self.status = 0;
        } else if self.function & ENABLE == 0 {
            self.status = ENABLED;
        }
        self.function = function;
    }

    const fn signal(&self) -> Option<Signal> {
        match self.function {
            function if function & ENABLE == 0 => None,
            function if function & BY_INDEX != 0 => Some(Signal::Index),
            _ => Some(Signal::Input),
        }
    }

    /// Handles an edge of the signal when the axis is at `position`. \[OURS] If both edges are selected, both are latched;
    /// in continuous mode the status bit stays 1.
    const fn edge(&mut self, rises: bool, position: i32) {
        let (selected, stored) = if rises { (RISING, RISING_STORED) } else { (FALLING, FALLING_STORED) };
        let is_first = self.status & stored == 0;
        if self.function & selected == 0 || !(is_first || self.function & CONTINUOUS != 0) {
            return;
        }
        self.status |= stored;
        if rises {
            self.rising = position;
        } else {
            self.falling = position;
        }
    }
}

/// The motion of the shaft and the changes at SI1 and SI2 in the last step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastStep {
    /// The position of the shaft at the beginning and at the end of the step, counts.
    pub(super) from: i64,
    pub(super) to: i64,
    /// The duration of the step, ns.
    pub(super) ns: Ns,
    /// For SI1 and SI2, the new level if it has changed without motion of the shaft, because an input is forced or
    /// stuck; `None` for an unchanged level.
    pub(super) forced: [Option<bool>; PROBES],
}

/// The state of the two touch probes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TouchProbes {
    probes: [Probe; PROBES],
    /// The value written to 0x60B8.
    function: u16,
}

impl TouchProbes {
    /// 0x60B8, touch probe function.
    pub(super) const fn function(&self) -> u16 {
        self.function
    }

    /// Writes 0x60B8, touch probe function.
    pub(super) const fn set_function(&mut self, function: u16) {
        self.function = function;
        let [first, second] = &mut self.probes;
        first.set_function(function & 0xFF);
        second.set_function(function >> 8);
    }

    /// 0x60B9, touch probe status.
    pub(super) const fn status(&self) -> u16 {
        self.probes[0].status | self.probes[1].status << 8
    }

    /// The value of the object 0x60BA + `place`, with `place` 0 to 3: the position at the rising and at the falling edge of
    /// probe 1, then of probe 2.
    pub(super) const fn position(&self, place: usize) -> i32 {
        let probe = &self.probes[place / 2];
        if place.is_multiple_of(2) { probe.rising } else { probe.falling }
    }

    /// The signal of a probe (0 or 1); `None` if the probe is off.
    pub(super) const fn signal(&self, probe: usize) -> Option<Signal> {
        self.probes[probe].signal()
    }

    /// Handles an edge of a probe's signal when the axis is at `position`.
    pub(super) const fn edge(&mut self, probe: usize, rises: bool, position: i32) {
        self.probes[probe].edge(rises, position);
    }
}

impl Dp3cl {
    /// Latches the position at each edge of a probe's signal between the shaft positions `from` and `to`, counts, through which
    /// the shaft has moved.
    pub(super) fn probe(&mut self, from: i64, to: i64) {
        for probe in 0..PROBES {
            let Some(signal) = self.probes.signal(probe) else { continue };
            let mut at = from;
            for _ in 0..EDGES_MAX {
                let next = match signal {
                    Signal::Input => self.pins.next_change(probe, at, to),
                    Signal::Index => self.axis.switches().next_pulse(at, to),
                };
                let Some(next) = next else { break };
                let rises = signal == Signal::Index || self.pins.is_on(probe, next);
                self.store(probe, rises, next);
                at = next;
            }
        }
    }

    /// Latches the position if SI1 or SI2 has changed since the last cycle without motion of the shaft, because an
    /// input is forced or stuck. Returns the new levels of the terminals that have changed.
    pub(super) fn probe_forced(&mut self) -> [Option<bool>; PROBES] {
        let at = self.shaft_position_now();
        let mut changed = [None; PROBES];
        for (probe, was) in self.seen_pins.into_iter().enumerate() {
            let is = self.pins.is_on(probe, at);
            if is == was {
                continue;
            }
            changed[probe] = Some(is);
            if self.probes.signal(probe) == Some(Signal::Input) {
                self.store(probe, is, at);
            }
        }
        changed
    }

    /// Calls `tell` once for each change at the terminals SI1 and SI2 during the last step, so that the slave
    /// controller can capture the time of the change. \[OURS] SI1 is latch input 0 of the slave controller, SI2 is
    /// latch input 1. The shaft moves evenly during a step, and a forced terminal changes at the beginning of the step.
    pub(super) fn tell_terminal_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        let LastStep { from, to, ns, forced } = std::mem::take(&mut self.last_step);
        for (input, forced) in forced.into_iter().enumerate() {
            if let Some(is_on) = forced {
                tell(LatchChange { input, is_on, ago_ns: ns });
            }
            let mut at = from;
            for _ in 0..EDGES_MAX {
                let Some(next) = self.pins.next_change(input, at, to) else { break };
                let left = u128::from(to.abs_diff(next)) * u128::from(ns) / u128::from(to.abs_diff(from).max(1));
                tell(LatchChange { input, is_on: self.pins.is_on(input, next), ago_ns: left as Ns });
                at = next;
            }
        }
    }

    fn store(&mut self, probe: usize, rises: bool, at: i64) {
        let position = at.wrapping_add(self.axis.origin()).wrapping_mul(self.position_sign());
        self.probes.edge(probe, rises, position as i32);
    }

    pub(super) fn probe_pins(&self) -> [bool; PROBES] {
        [0, 1].map(|pin| self.pins.is_on(pin, self.shaft_position_now()))
    }
}
