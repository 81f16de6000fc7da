//! Computes several motors together that follow positions.
//!
//! Each sub-step of a motor depends on the previous one, so the processor mostly waits while it computes a single motor.
//! Several motors together take little more time than one. The results are bit-identical to those of [`Servo::run`],
//! because the operations and their order are the same.

use super::super::clamp_to;
use super::Servo;
use crate::ethercat::Ns;

/// The number of motors computed together. Their values take four vector registers of two numbers each: the processor works on
/// the other registers while it waits for the result for the first one.
pub const SIDE_BY_SIDE: usize = 8;

/// Up to this number of motors, computing them one by one is faster.
const FEW: usize = 2;

/// One value for each motor.
type Each = [f64; SIDE_BY_SIDE];

/// The values of all motors, as a structure of arrays, so that one instruction works on several motors.
#[derive(Default)]
struct Motors {
    feed_forward: Each,
    position_gain: Each,
    velocity_limit: Each,
    gain: Each,
    gain_wanted: Each,
    torque: Each,
    friction: Each,
    friction_wanted: Each,
    decay: Each,
    substep_s: Each,
    step: Each,
    demand: Each,
    velocity: Each,
    fraction: Each,
    wanted: Each,
    asked: Each,
}

/// Runs these motors for `ns` with the setpoints of [`Servo::aim_at`]. An element that is `None` has no motor to run.
pub fn follow_side_by_side(motors: &mut [Option<&mut Servo>; SIDE_BY_SIDE], ns: Ns) {
    if ns == 0 {
        return;
    }
    if motors.iter().flatten().count() <= FEW {
        for servo in motors.iter_mut().flatten() {
            servo.set_span(ns);
            let span = servo.span;
            servo.follow_position(&span, servo.way);
            servo.settle();
        }
        return;
    }
    // For an element without a motor all values are 0, so computing it together with the others has no effect.
    let mut of = Motors::default();
    let mut substeps = 0;
    for (n, motor) in motors.iter_mut().enumerate() {
        let Some(servo) = motor else { continue };
        servo.set_span(ns);
        let (span, way) = (&servo.span, &servo.way);
        substeps = span.substeps;
        of.feed_forward[n] = way.by * span.rate;
        of.position_gain[n] = servo.position_gain;
        of.velocity_limit[n] = servo.velocity_limit;
        of.gain[n] = span.gain;
        of.gain_wanted[n] = span.gain_wanted;
        of.torque[n] = span.torque;
        of.friction[n] = span.friction;
        of.friction_wanted[n] = span.friction_wanted;
        of.decay[n] = span.decay;
        of.substep_s[n] = span.substep_s;
        of.step[n] = way.by * span.share;
        of.demand[n] = way.start;
        of.velocity[n] = servo.velocity;
        of.fraction[n] = servo.fraction;
    }
    for _ in 0..substeps {
        of.substep();
    }
    for (n, motor) in motors.iter_mut().enumerate() {
        let Some(servo) = motor else { continue };
        (servo.velocity, servo.fraction) = (of.velocity[n], of.fraction[n]);
        let wanted = of.wanted[n];
        let limits = (servo.span.torque, servo.span.torque_per_change);
        servo.finish_span(limits, of.asked[n], clamp_to(wanted, of.velocity_limit[n]) != wanted);
        servo.settle();
    }
}

impl Motors {
    /// The same calculation as `follow_position`, `change_for` and `substep` of [`Servo`]. A shaft that friction holds is
    /// computed too, and its speed stays 0.
    #[inline(always)]
    fn substep(&mut self) {
        for n in 0..SIDE_BY_SIDE {
            let wanted = self.feed_forward[n] + self.position_gain[n] * (self.demand[n] - self.fraction[n]);
            let limited = clamp_to(wanted, self.velocity_limit[n]);
            let dry = clamp_to(self.friction_wanted[n] * limited, self.friction[n]);
            let asked = (self.gain_wanted[n] * limited - self.gain[n] * self.velocity[n]) + dry;
            let driven = self.velocity[n] + clamp_to(asked, self.torque[n]);
            self.velocity[n] = (driven - clamp_to(driven, self.friction[n])) * self.decay[n];
            self.fraction[n] += self.velocity[n] * self.substep_s[n];
            self.demand[n] += self.step[n];
            (self.wanted[n], self.asked[n]) = (wanted, asked);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::Setpoint;
    use super::super::Motor;
    use super::*;

    /// All visible values of a motor; floating-point numbers as bits.
    fn shown(servo: &Servo) -> (i64, [u64; 3], bool) {
        // 0 and -0 are the same speed but differ in their bits. Adding 0 turns -0 into 0.
        let numbers = [servo.fraction() + 0.0, servo.velocity() + 0.0, servo.torque() + 0.0];
        (servo.position(), numbers.map(f64::to_bits), servo.is_limited())
    }

    /// Motors computed side by side give the same bits as each motor alone: different motors, at rest, following,
    /// lagging their targets, blocked and at end stops, with elements without a motor, and with cycles of any length.
    #[test]
    fn side_by_side_is_as_one_by_one() {
        let mut dice = oorandom::Rand64::new(7);
        for _ in 0..200 {
            let mut alone: Vec<Servo> = (0..SIDE_BY_SIDE)
                .map(|n| {
                    let mut servo =
                        Servo::new(&if n == 1 { Motor::stepper() } else { Motor::default() }, n as i64 * 1000);
                    if dice.rand_range(0..4) == 0 {
                        servo.set_limits(dice.rand_range(0..1_000_000) as u32, dice.rand_range(0..4000) as u16);
                    }
                    if dice.rand_range(0..4) == 0 {
                        servo.set_stops(Some((n as i64 * 1000 - 50, n as i64 * 1000 + 50)));
                    }
                    servo
                })
                .collect();
            let mut together = alone.clone();
            let mut demand: [i64; SIDE_BY_SIDE] = std::array::from_fn(|n| n as i64 * 1000);
            for _ in 0..60 {
                let ns = [125_000, 250_000, 1_000_000, 1_300_000][dice.rand_range(0..4) as usize];
                let jam = dice.rand_range(0..40);
                if let (Some(a), Some(b)) = (alone.get_mut(jam as usize), together.get_mut(jam as usize)) {
                    a.jam(dice.rand_range(0..2) == 0);
                    b.jammed = a.jammed;
                    b.span.ns = 0;
                }
                let by: Each = std::array::from_fn(|_| match dice.rand_range(0..3) {
                    0 => 0.0,
                    1 => dice.rand_range(0..40) as f64 - 20.0,
                    _ => dice.rand_float() * 20_000.0 - 10_000.0,
                });
                let has_motor: [bool; SIDE_BY_SIDE] = std::array::from_fn(|_| dice.rand_range(0..5) > 0);
                for n in (0..SIDE_BY_SIDE).filter(|n| has_motor[*n]) {
                    alone[n].run(Setpoint::Position { from: demand[n], fraction: 0.25, by: by[n] }, ns);
                }
                let mut motors = [const { None }; SIDE_BY_SIDE];
                for (n, servo) in together.iter_mut().enumerate().filter(|(n, _)| has_motor[*n]) {
                    servo.aim_at(demand[n], 0.25, by[n]);
                    motors[n] = Some(servo);
                }
                follow_side_by_side(&mut motors, ns);
                for n in 0..SIDE_BY_SIDE {
                    assert_eq!(shown(&alone[n]), shown(&together[n]), "motor {n}");
                    demand[n] += by[n] as i64 * i64::from(has_motor[n]);
                }
            }
        }
    }
}
