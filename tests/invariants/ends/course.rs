//! What a brake may command an axis, judged by the drive's own record of each cycle. It holds for every writer, also for
//! one that has jumped or homed, and while something is broken:
//!
//! - first come the targets that the board has accepted, in their order;
//! - in CSP a target of the brake's own is between the axis and the last accepted target, and the axis comes no further
//!   from that again: no brake passes the last accepted target, or turns round;
//! - in CSV and CST those of the brake's own have the sign of the last one, and decrease; a torque may rise by noise.

use std::collections::BTreeMap;

use ecmsk::cia402::Mode;

use crate::machine::Unit;
use crate::tap::Cycle;

/// Noise of a position, counts.
const NOISE: i64 = 60;
/// The cycles from a report to the execution of a target that follows from it.
const LAG_CYCLES: i64 = 4;

/// The targets, velocities or torques that the board has accepted, by slave and in their order.
pub type Accepted = BTreeMap<u8, Vec<[i32; 2]>>;

/// Begins to record the drives' cycles.
pub fn begin(units: &[Unit]) {
    units.iter().for_each(|unit| *unit.track.lock().expect("no panic") = Some(Vec::new()));
}

/// Ends the record, and checks it. Returns the number of commands of brakes' own.
pub fn check(units: &[Unit], accepted: &Accepted) -> u64 {
    let mut own = 0;
    for unit in units {
        let track = unit.track.lock().expect("no panic").take().expect("it has begun");
        let Some(accepted) = accepted.get(&(unit.slave as u8)) else { continue };
        for axis in 0..unit.axes {
            let accepted: Vec<i32> = accepted.iter().map(|targets| targets[axis]).collect();
            let at = format!("slave {}, axis {axis}, {:?}", unit.slave, unit.mode);
            own += Course { axis, accepted: &accepted, mode: unit.mode, at: &at }.check(&track);
        }
    }
    own
}

/// The commands of an axis.
struct Course<'a> {
    axis: usize,
    accepted: &'a [i32],
    mode: Mode,
    at: &'a str,
}

impl Course<'_> {
    fn check(&self, track: &[Cycle]) -> u64 {
        let (mut own, mut taken) = (0, 0);
        // In a brake in CSP, the least distance of the axis from the last accepted target.
        let mut nearest = i64::MAX;
        // The last command, and the last one of the brake's own.
        let (mut before, mut braked): (Option<i32>, Option<i32>) = (None, None);
        for pair in track.windows(2) {
            let Some(target) = pair[1].targets[self.axis] else {
                (before, braked, nearest) = (None, None, i64::MAX);
                continue;
            };
            if braked.is_some() && self.mode == Mode::Csp {
                let at = self.distance(pair[1].positions[self.axis]).abs();
                nearest = nearest.min(at);
                assert!(at <= nearest + NOISE, "{}: it turns round, {at} counts from its last target", self.at);
            }
            let is_new = before.is_some_and(|before| before != target);
            if before.is_none() {
                taken = self.accepted.iter().rposition(|one| *one == target).map_or(0, |n| n + 1);
            } else if is_new && braked.is_none() && self.is_next(target, &mut taken) {
                // An accepted one.
            } else if is_new {
                own += 1;
                match self.mode {
                    Mode::Csp => self.check_position(target, braked, pair),
                    _ => self.check_fall(target, braked, before),
                }
                braked = Some(target);
            }
            before = Some(target);
        }
        own
    }

    /// Whether the command is one of the accepted ones that are still to come; it and those before it are taken.
    fn is_next(&self, target: i32, taken: &mut usize) -> bool {
        let found = self.accepted[*taken..].iter().position(|one| *one == target);
        *taken += found.map_or(0, |n| n + 1);
        found.is_some()
    }

    /// The newest of the accepted commands.
    fn last(&self) -> i32 {
        self.accepted.last().copied().unwrap_or_default()
    }

    /// The distance of a position from the newest accepted target. Positions wrap around at 32 bits.
    fn distance(&self, position: i32) -> i64 {
        i64::from(position.wrapping_sub(self.last()))
    }

    fn check_position(&self, target: i32, braked: Option<i32>, pair: &[Cycle]) {
        let [was, is] = [0, 1].map(|n| self.distance(pair[n].positions[self.axis]));
        let (target, slack) = (self.distance(target), LAG_CYCLES * (is - was).abs() + NOISE);
        let (low, high) = match is {
            is if is.abs() <= slack => (-slack, slack),
            is if is < 0 => (is - slack, 0),
            is => (0, is + slack),
        };
        assert!(
            (low..=high).contains(&target),
            "{}: the brake's target is {target} counts from the last accepted one, the axis {is}, after {was}",
            self.at
        );
        if let Some(braked) = braked.map(|braked| self.distance(braked)) {
            // A brake that has stalled begins again where the axis is, which lags behind its target.
            let comes_nearer = target.abs() <= braked.abs() + slack;
            assert!(comes_nearer, "{}: {target} after {braked} counts from the last accepted target", self.at);
        }
    }

    fn check_fall(&self, value: i32, braked: Option<i32>, before: Option<i32>) {
        // Reports show a velocity, or a torque, that is not quite the commanded one.
        let noise = if self.mode == Mode::Csv { 5000 } else { 20 };
        let [value, last, before] = [value, self.last(), before.unwrap_or_default()].map(i64::from);
        let Some(braked) = braked.map(i64::from) else {
            let most = last.abs().max(before.abs()) * 5 / 4 + noise;
            assert!(value.abs() <= most, "{}: {value} after {before}, and {last} was the last", self.at);
            return;
        };
        // A brake that begins again after a stall begins with the torque that a report shows, which is behind its last command.
        let rise = if self.mode == Mode::Cst { noise } else { 0 };
        let falls = value.abs() <= braked.abs() + rise && value * braked >= 0;
        assert!(falls, "{}: {value} after {braked}", self.at);
    }
}
