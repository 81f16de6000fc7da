//! The touch probes: 0x60B8 says which edge of which signal stores the position, 0x60B9 what was stored, 0x60BA to 0x60BD
//! are the positions.

use super::Dp3cl;
use crate::ethercat::Ns;
use crate::slave::communication::LatchChange;

/// How many probes there are.
pub(super) const PROBES: usize = 2;

/// Bits of 0x60B8 of probe 1; those of probe 2 are 8 higher.
const ENABLE: u16 = 1 << 0;
const CONTINUOUS: u16 = 1 << 1;
const BY_INDEX: u16 = 1 << 2;
const RISING: u16 = 1 << 4;
const FALLING: u16 = 1 << 5;
/// Bits of 0x60B9 of probe 1; those of probe 2 are 8 higher.
const ENABLED: u16 = 1 << 0;
const RISING_STORED: u16 = 1 << 1;
const FALLING_STORED: u16 = 1 << 2;

/// The most edges of one signal that are looked at in a cycle \[OURS]: more than any motor makes.
const EDGES_MAX: usize = 256;

/// A probe by which the position is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Probe {
    function: u16,
    status: u16,
    rising: i32,
    falling: i32,
}

/// What a probe listens to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signal {
    /// Its input: SI1 of probe 1, SI2 of probe 2.
    Input,
    /// The index pulse.
    Index,
}

impl Probe {
    /// Takes its part of 0x60B8. \[OURS] When bit 0 is cleared the status is, too, and the positions stay; a rising bit 0
    /// begins anew.
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

    /// The signal has an edge with the axis at that position. \[OURS] With both edges selected both are stored; in the
    /// continuous mode the bit of the status stays 1.
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

/// What happened to the shaft and to SI1 and SI2 during the last step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastStep {
    /// Where the shaft was when it began, and when it ended, counts.
    pub(super) from: i64,
    pub(super) to: i64,
    /// How long it took.
    pub(super) ns: Ns,
    /// The levels that SI1 and SI2 have got without the shaft.
    pub(super) forced: [Option<bool>; PROBES],
}

/// The two probes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TouchProbes {
    probes: [Probe; PROBES],
    /// 0x60B8 as it was written.
    function: u16,
}

impl TouchProbes {
    /// 0x60B8.
    pub(super) const fn function(&self) -> u16 {
        self.function
    }

    /// Writes 0x60B8.
    pub(super) const fn set_function(&mut self, function: u16) {
        self.function = function;
        let [first, second] = &mut self.probes;
        first.set_function(function & 0xFF);
        second.set_function(function >> 8);
    }

    /// 0x60B9.
    pub(super) const fn status(&self) -> u16 {
        self.probes[0].status | self.probes[1].status << 8
    }

    /// 0x60BA, 0x60BB, 0x60BC, 0x60BD: the position at the rising and at the falling edge of probe 1, then of probe 2.
    pub(super) const fn position(&self, place: usize) -> i32 {
        let probe = &self.probes[place / 2];
        if place.is_multiple_of(2) { probe.rising } else { probe.falling }
    }

    /// What a probe (0 or 1) listens to; `None`: it is off.
    pub(super) const fn signal(&self, probe: usize) -> Option<Signal> {
        self.probes[probe].signal()
    }

    /// The signal of a probe has an edge with the axis at that position.
    pub(super) const fn edge(&mut self, probe: usize, rises: bool, position: i32) {
        self.probes[probe].edge(rises, position);
    }
}

impl Dp3cl {
    /// The shaft has moved from one count to another: the probes store the positions of the edges between.
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

    /// A terminal that is forced has changed since the last cycle, while the shaft stands at a count: the levels of those that have.
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

    /// Tells the changes at SI1 and SI2 during the last step, once. \[OURS] SI1 is latch input 0 of the controller, SI2 is 1; the
    /// shaft moves evenly during a step, and a terminal that is forced changes when the step begins.
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
