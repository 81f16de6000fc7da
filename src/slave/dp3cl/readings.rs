//! The motion values that the drive's objects show: positions and velocities, with the sign that the polarity (0x607E) gives
//! them, and the values of the monitors (groups U0 to U4).

use super::monitors::Monitored;
use super::{Dp3cl, objects, parameters};

impl Dp3cl {
    /// The position of the shaft, counts: the position where it is jammed, or else the demand limited by the end stops.
    pub(super) fn shaft_position_now(&self) -> i64 {
        let position = self.jammed_at.unwrap_or(self.axis.plant().position());
        self.config.travel.stops.map_or(position, |(low, high)| position.clamp(low, high.max(low)))
    }

    /// The sign between positions of the shaft and positions in objects (0x607A, for example): -1 if bit 7 of the polarity,
    /// 0x607E, is set, otherwise 1.
    pub(super) fn position_sign(&self) -> i64 {
        if self.base.values.get(objects::POLARITY) & 1 << 7 != 0 { -1 } else { 1 }
    }

    /// The sign between velocities of the shaft and velocities in objects: -1 if bit 6 of the polarity, 0x607E, is set,
    /// otherwise 1.
    pub(super) fn velocity_sign(&self) -> f64 {
        if self.base.values.get(objects::POLARITY) & 1 << 6 != 0 { -1.0 } else { 1.0 }
    }

    /// Converts a position in an object (0x607A, for example) to a position of the shaft. The unit is the same; the
    /// polarity 0x607E can change the sign.
    pub(super) fn shaft_position(&self, position: i32) -> i32 {
        if self.position_sign() < 0 { position.wrapping_neg() } else { position }
    }

    /// The target position, 0x607A, as a position of the shaft.
    pub(super) fn shaft_target(&self) -> i32 {
        self.shaft_position(self.motion.target_position)
    }

    /// 0x6062, position demand value, command units, with the sign that the polarity gives it.
    pub(super) fn demand_value(&self) -> i64 {
        self.axis.demand().wrapping_mul(self.position_sign())
    }

    /// 0x6064, position actual value, command units, with the sign that the polarity gives it.
    pub(super) fn actual_value(&self) -> i64 {
        self.shown.wrapping_add(self.axis.origin()).wrapping_mul(self.position_sign())
    }

    /// 0x60F4, following error actual value: 0x6062 - 0x6064.
    pub(super) fn following_error(&self) -> i64 {
        self.demand_value().wrapping_sub(self.actual_value())
    }

    /// Converts a position from command units to encoder counts. \[OURS] A turn has P4-01 counts, for 0x6063 and 0x60FC alike.
    pub(super) fn as_increments(&self, position: i64) -> i64 {
        let turn = i128::from(self.memory.subdivision());
        (i128::from(position) * i128::from(parameters::ENCODER_COUNTS)).div_euclid(turn) as i64
    }

    /// The velocity that objects show, command units/s: the velocity of the demand while a mode of operation controls
    /// the axis, otherwise the velocity of the motor, for example while the drive brakes on the ramp of a quick stop.
    pub(super) fn velocity_value(&self) -> f64 {
        let velocity = if self.is_in_control() { self.motion.velocity() } else { self.axis.plant().velocity() };
        velocity * self.velocity_sign()
    }

    pub(super) fn monitored(&self) -> Monitored {
        let pulses = self.axis.plant().position().wrapping_sub(self.config.position);
        Monitored::of(pulses, self.motion.velocity(), self.memory.subdivision(), self.motor_ma())
    }

    pub(super) const fn on_seconds(&self) -> u64 {
        self.on_ns / 1_000_000_000
    }

    /// U3-08, the cycle time of the drive. \[OURS] In microseconds.
    pub(super) const fn cycle_us(&self) -> i64 {
        (self.cycle_ns / 1000) as i64 & 0xFFFF
    }
}
