//! Homing of an axis: the mode's wishes become a position demand, and home becomes the origin of its positions.
//!
//! **No jump.** The plant's counts never change; what changes when home is attained is [`Axis::origin`], which object 0x6064 and its
//! kin have on top. A target in process data that the master had made before it could see the new positions would be a
//! jump in the next mode. So the axis takes no target position \[OURS] while the mode is 6, nor while it still brakes
//! after the mode was left, nor from the first exchange after a home event or after the end of such braking; it holds
//! where it is. The outputs of the exchange after that come from a master that has seen where the axis is.

use super::{Axis, Demand, Motion, rounded};
use crate::cia402::Mode;
use crate::ethercat::Ns;
use crate::slave::homing::{Homed, Homing, Shaft};
use crate::slave::plant::Effort;
use crate::slave::switches::{Input, Inputs, Switches, Travel};

/// So long a shaft does not move before it stands: where it turns it is still for a moment only \[OURS].
const STILL_NS: Ns = 5_000_000;

impl Axis {
    /// The same axis with switches along its travel; one that was only made has none.
    pub fn on(mut self, travel: &Travel, counts_per_turn: u32) -> Self {
        self.switches = Switches::new(travel, counts_per_turn);
        self.plant.set_stops(travel.stops);
        self
    }

    /// The mode 6, for its error.
    pub const fn homing(&self) -> &Homing {
        &self.homing
    }

    /// Position actual value (0x6064), counts: the shaft's and the origin that homing has set.
    pub const fn position(&self) -> i64 {
        self.plant.position().wrapping_add(self.origin)
    }

    /// The position actual value where the shaft's count is 0.
    pub const fn origin(&self) -> i64 {
        self.origin
    }

    /// The switches as they are now, bits 0 to 2 of 0x60FD.
    pub fn inputs(&self) -> Inputs {
        self.switches.read(self.plant.position())
    }

    /// An input sticks, or works again.
    pub const fn stick(&mut self, input: Input, value: Option<bool>) {
        self.switches.stick(input, value);
    }

    /// The shaft is jammed, or free again.
    pub const fn jam(&mut self, jammed: bool) {
        self.plant.jam(jammed);
    }

    /// A target position has come by process data; see this file's head for the one that is not taken.
    pub const fn take_target_position(&mut self, position: i32) {
        if self.stale {
            self.stale = false;
        } else {
            self.targets.position = position;
        }
    }

    /// `ns` pass in mode 6.
    pub(super) fn home(&mut self, ns: Ns) {
        let from = self.plant.position();
        let moves = self.demand.velocity != 0.0 || self.plant.velocity().abs() > self.velocity_reached;
        let shaft = Shaft { position: from, moves };
        let word = self.machine.controlword();
        self.homing.command(word, shaft, &self.settings.homing, &self.switches);
        let Some((at, speed)) = self.homing.destination() else {
            let way = self.glide(self.homing.velocity(), self.homing_ramp(), ns);
            return self.homing.pass(from, self.plant.position(), way, &self.switches);
        };
        self.approach(at, speed, ns);
        let is_there = self.demand.whole == at && self.plant.position() == at && self.stands();
        if is_there && let Some(homed) = self.homing.arrive() {
            self.come_home(homed);
        }
    }

    /// Following begins in mode 6: the demand is where the shaft is, to less than a count, so that nothing moves it.
    pub(super) const fn hold_for_homing(&mut self) {
        self.demand.fraction = self.plant.fraction();
    }

    /// The axis has stopped following, if it is in mode 6.
    pub(super) fn leave_homing_unpowered(&mut self) {
        if self.mode == Mode::Homing {
            self.homing.lose_power(self.machine.controlword());
        }
    }

    /// `ns` pass after mode 6 was left in motion: the axis brakes. False: it stands, and nothing has passed.
    pub(super) fn brake_after_homing(&mut self, ns: Ns) -> bool {
        if self.stands() {
            self.targets.position = self.position() as i32;
            self.stale = true;
            return false;
        }
        self.glide(0.0, self.homing.acceleration(), ns);
        true
    }

    /// The shaft stands and the demand too, and has done so for a while.
    pub(super) const fn stands(&self) -> bool {
        self.still_ns >= STILL_NS
    }

    /// Mode 6 begins: an axis that is still now has been so.
    pub(super) fn begin_to_stand(&mut self) {
        self.still_ns = if self.is_still() { STILL_NS } else { 0 };
    }

    /// `ns` have passed.
    pub(super) fn note_stand(&mut self, ns: Ns) {
        self.still_ns = if self.is_still() { self.still_ns.saturating_add(ns) } else { 0 };
    }

    fn is_still(&self) -> bool {
        let demanded = matches!(self.motion, Motion::Follow | Motion::BrakeAfterHoming) && self.demand.velocity != 0.0;
        self.plant.is_at_standstill() && !demanded
    }

    /// 0x609A, or what 0x605D says of a halt.
    fn homing_ramp(&self) -> f64 {
        match self.homing.halt_option() {
            Some(2) => self.settings.quick_stop.into(),
            Some(3 | 4) => self.plant.torque_as_acceleration(),
            _ => self.homing.acceleration(),
        }
    }

    /// The demand comes nearer to a count, at most so fast, counts/s, and with the ramp of homing. It ends there to the
    /// count, with nothing left.
    fn approach(&mut self, at: i64, speed: f64, ns: Ns) {
        let seconds = ns as f64 / 1e9;
        let ramp = self.homing.acceleration();
        let speed = speed.min(self.settings.max_velocity.into());
        let Demand { whole, fraction, velocity: from } = self.demand;
        let left = at.wrapping_sub(whole) as f64 - fraction;
        let most = ramp * seconds;
        // What the ramp would stop within, and the speed would go, in this time.
        if left.abs() <= (most * seconds).min(speed * seconds) && from.abs() <= most {
            self.plant.run(Effort::Position { from: whole, fraction, by: left }, ns);
            self.demand = Demand { whole: at, fraction: 0.0, velocity: 0.0 };
            return self.watch_following_error(ns);
        }
        // The greatest velocity at the end of this time from which the ramp still stops at the count: it solves
        // to^2 / 2a + (from + to) t / 2 = left.
        let towards = if left < 0.0 { -1.0 } else { 1.0 };
        let (way, now) = (left * towards, from * towards);
        let root = seconds * seconds * 0.25 + 2.0 / ramp * (way - now * seconds * 0.5);
        let wanted = if root > 0.0 { ramp * (root.sqrt() - seconds * 0.5) } else { 0.0 };
        self.glide(wanted.clamp(0.0, speed) * towards, ramp, ns);
    }

    /// The demand's velocity comes nearer to `wanted`, counts/s, by `ramp` counts/s² at most. The way it goes, counts.
    fn glide(&mut self, wanted: f64, ramp: f64, ns: Ns) -> f64 {
        let seconds = ns as f64 / 1e9;
        let limit = f64::from(self.settings.max_velocity);
        let Demand { whole, fraction, velocity: from } = self.demand;
        let most = ramp * seconds;
        let to = wanted.clamp(-limit, limit).clamp(from - most, from + most);
        let by = (from + to) * 0.5 * seconds;
        self.plant.run(Effort::Position { from: whole, fraction, by }, ns);
        self.move_demand(by);
        // Rounded, as the shaft's count is: where it stands it is where it should be.
        let counts = rounded(self.demand.fraction);
        self.demand.whole = self.demand.whole.wrapping_add(counts);
        self.demand.fraction -= counts as f64;
        self.demand.velocity = to;
        self.watch_following_error(ns);
        by
    }

    /// The axis stands at home: from now on positions are counted from there.
    fn come_home(&mut self, Homed { at, offset }: Homed) {
        self.origin = i64::from(offset).wrapping_sub(at);
        self.stale = true;
    }
}
