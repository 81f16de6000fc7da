//! The motion of one axis that is jogged, cycle by cycle. It follows the same profile as a `move` to its soft limit,
//! and brakes like a `move` when its key is released.

use ecmsk::ecm::{Guard, SoftLimits};

use super::super::frames::BRAKE_LIMIT;
use super::super::motion::Speeds;
use super::super::profile::{Limits, Profile};

/// \[OURS] The time at full speed in each planned profile, seconds. While the key is held, the motion at full speed is
/// prolonged before the profile would brake.
const CRUISE_S: f64 = 1.0;
/// The relative tolerance with which a point of a profile counts as motion at full speed.
const CLOSE: f64 = 1e-6;

/// The motion of one jogged axis.
pub struct JogAxis {
    speeds: Speeds,
    limits: SoftLimits,
    /// The position of the axis at rest, or the position at which its present profile begins, in counts.
    base: f64,
    motion: Motion,
}

/// The present motion of an axis.
enum Motion {
    Stands,
    /// The axis moves along a profile.
    Moves {
        profile: Profile,
        /// The time since the profile began, in seconds.
        time: f64,
        /// The direction, 1 or -1.
        sign: f64,
        /// How much longer the motion at full speed may become, in counts; 0 while the axis brakes.
        more: f64,
        brakes: bool,
    },
}

/// The phase of the motion of an axis, for the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    Stands,
    Runs,
    Brakes,
}

/// The soft limits narrowed to the distance `guard` from `start`. If the axis is beyond one of its limits, it has room
/// only in the direction back, as far as the guard allows.
pub fn within_guard(limits: SoftLimits, start: i32, guard: Guard) -> SoftLimits {
    let Guard::Within(way) = guard else { return limits };
    let SoftLimits { min, max } = limits;
    SoftLimits { min: min.max(start.saturating_sub_unsigned(way)), max: max.min(start.saturating_add_unsigned(way)) }
}

/// How far one tap of a key moves an axis, in counts, if the terminal does not report releases. The key counts as held
/// for `held_s` seconds, then the axis brakes. `cycle`: the cycle time in seconds.
///
/// # Errors
/// The trajectory library finds no motion within the limits.
pub fn tap(speeds: Speeds, held_s: f64, cycle: f64) -> Result<i32, String> {
    let mut axis = JogAxis::new(0, speeds, SoftLimits::NONE);
    axis.run(true)?;
    (0..(held_s / cycle).ceil() as u32).for_each(|_| axis.advance(cycle));
    axis.brake()?;
    while axis.doing() != Doing::Stands {
        axis.advance(cycle);
    }
    Ok(axis.target())
}

impl JogAxis {
    /// Creates an axis at rest at `position`.
    pub fn new(position: i32, speeds: Speeds, limits: SoftLimits) -> Self {
        Self { speeds, limits, base: position.into(), motion: Motion::Stands }
    }

    pub const fn speeds(&self) -> Speeds {
        self.speeds
    }

    pub const fn doing(&self) -> Doing {
        match self.motion {
            Motion::Stands => Doing::Stands,
            Motion::Moves { brakes: false, .. } => Doing::Runs,
            Motion::Moves { brakes: true, .. } => Doing::Brakes,
        }
    }

    /// How far the axis may move in this direction from its rest position, in counts: up to its soft limit; 0 if it is
    /// at that limit or beyond it.
    pub fn room(&self, is_positive: bool) -> f64 {
        let SoftLimits { min, max } = self.limits;
        let room = if is_positive { f64::from(max) - self.base } else { self.base - f64::from(min) };
        room.max(0.0)
    }

    /// Whether the axis can obey a key for this direction: it is at rest, or runs in this direction already.
    pub fn is_free_for(&self, is_positive: bool) -> bool {
        match self.motion {
            Motion::Stands => true,
            Motion::Moves { brakes, sign, .. } => !brakes && (sign > 0.0) == is_positive,
        }
    }

    /// Begins to move, if the axis is at rest and has room in this direction.
    ///
    /// # Errors
    /// The trajectory library finds no motion within the limits.
    pub fn run(&mut self, is_positive: bool) -> Result<(), String> {
        let room = self.room(is_positive);
        if !matches!(self.motion, Motion::Stands) || room < 1.0 {
            return Ok(());
        }
        let Speeds { velocity, acceleration, jerk } = self.speeds;
        // The length covers accelerating, braking and [`CRUISE_S`] at full speed. A longer profile would be less exact.
        let ramp_s = velocity / acceleration + jerk.map_or(0.0, |jerk| acceleration / jerk + (velocity / jerk).sqrt());
        let length = room.min(velocity * (2.0 * ramp_s + CRUISE_S));
        let profile = Profile::rest_to_rest(length, Limits { velocity, acceleration, jerk })?;
        let sign = if is_positive { 1.0 } else { -1.0 };
        self.motion = Motion::Moves { profile, time: 0.0, sign, more: room - length, brakes: false };
        Ok(())
    }

    /// Brakes within 1.5 s, with the acceleration of the axis or more.
    ///
    /// # Errors
    /// The trajectory library finds no profile to rest. The axis then holds its last target.
    pub fn brake(&mut self) -> Result<(), String> {
        let Motion::Moves { profile, time, brakes: false, sign, .. } = &self.motion else { return Ok(()) };
        let (point, sign) = (profile.at(*time), *sign);
        let Speeds { velocity, acceleration, jerk } = self.speeds;
        match Profile::to_rest(point, Limits { velocity, acceleration, jerk }, BRAKE_LIMIT) {
            Ok(profile) => {
                self.motion = Motion::Moves { profile, time: 0.0, sign, more: 0.0, brakes: true };
                Ok(())
            }
            Err(why) => {
                self.stand();
                Err(why)
            }
        }
    }

    /// Ends the motion: the axis holds its last target.
    pub fn stand(&mut self) {
        self.base = self.exact();
        self.motion = Motion::Stands;
    }

    /// Advances by a cycle of `cycle` seconds.
    pub fn advance(&mut self, cycle: f64) {
        let Motion::Moves { profile, time, sign, more, .. } = &mut self.motion else { return };
        let point = profile.at(*time);
        let is_at_speed = point.velocity >= self.speeds.velocity * (1.0 - CLOSE)
            && point.acceleration.abs() <= self.speeds.acceleration * CLOSE;
        let way = point.velocity * cycle;
        let taken = if is_at_speed && *more > 0.0 { way.min(*more) } else { 0.0 };
        // The part of the cycle that prolongs the motion at full speed does not advance the profile.
        self.base += *sign * taken;
        *more -= taken;
        *time += if taken > 0.0 { cycle * (1.0 - taken / way) } else { cycle };
        if *time >= profile.seconds() {
            self.stand();
        }
    }

    /// The target of the present cycle, in counts. It is never beyond a soft limit, except for an axis that started
    /// beyond it; such a target is never further beyond it than the start.
    pub fn target(&self) -> i32 {
        // Positions are in the range of i32, so the conversion only drops the fraction.
        self.exact().round() as i32
    }

    fn exact(&self) -> f64 {
        match &self.motion {
            Motion::Stands => self.base,
            Motion::Moves { profile, time, sign, .. } => {
                let at = self.base + sign * profile.at(*time).length;
                let SoftLimits { min, max } = self.limits;
                if *sign > 0.0 { at.min(f64::from(max).max(self.base)) } else { at.max(f64::from(min).min(self.base)) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CYCLE: f64 = 0.001;

    fn speeds(velocity: f64) -> Speeds {
        Speeds::of((Some(velocity), None), (None, None), None)
    }

    /// The targets of the next `count` cycles.
    fn cycles(axis: &mut JogAxis, count: usize) -> Vec<i32> {
        let target = |axis: &mut JogAxis| {
            axis.advance(CYCLE);
            axis.target()
        };
        (0..count).map(|_| target(axis)).collect()
    }

    /// The number of cycles until the axis is at rest, and the lowest and the highest target.
    fn until_it_stands(axis: &mut JogAxis) -> (usize, i32, i32) {
        let (mut count, mut low, mut high) = (0, axis.target(), axis.target());
        while axis.doing() != Doing::Stands {
            axis.advance(CYCLE);
            (low, high) = (low.min(axis.target()), high.max(axis.target()));
            count += 1;
            assert!(count < 1_000_000, "it never stands");
        }
        (count, low, high)
    }

    /// A key that is held for a long time moves the axis at its speed; releasing it brakes the axis with the default
    /// acceleration.
    #[test]
    fn a_held_axis_runs_at_its_speed_and_brakes_when_it_is_released() {
        let mut axis = JogAxis::new(100, speeds(10_000.0), SoftLimits::NONE);
        axis.run(true).unwrap();
        let targets = cycles(&mut axis, 20_000);
        assert!(targets[400..].windows(2).all(|pair| (9..=11).contains(&(pair[1] - pair[0]))), "it runs at its speed");
        let released = axis.target();
        axis.brake().unwrap();
        let (count, _, high) = until_it_stands(&mut axis);
        assert!((200..=500).contains(&count), "{count} ms: 10000 counts/s with 50000 counts/s^2 and their jerk");
        assert!((1000..=2000).contains(&(high - released)), "{}", high - released);
        assert_eq!(axis.target(), high);
    }

    /// A tap moves the axis as far as its speed would in the time for which the key counts as held, since accelerating
    /// and braking take equal times.
    #[test]
    fn a_tap_moves_the_axis_for_the_time_of_a_key() {
        for (velocity, held_s) in [(10_000.0, 0.4), (20_000.0, 0.4), (2000.0, 1.0)] {
            let way = f64::from(tap(speeds(velocity), held_s, CYCLE).unwrap());
            assert!((way / (velocity * held_s) - 1.0).abs() < 0.05, "{velocity} {held_s}: {way}");
        }
        // In 0.05 s the jerk raises the acceleration to half of its limit, so the axis does not reach its speed. The
        // motion has four such phases, and a speed of 1250 counts/s in the middle of 0.2 s.
        let short = tap(speeds(10_000.0), 0.05, CYCLE).unwrap();
        assert!((124..=126).contains(&short), "{short}");
    }

    /// A jogged axis stops exactly at its soft limit, goes no further, and comes back. From beyond a limit it moves
    /// only back.
    #[test]
    fn a_held_axis_stops_at_its_soft_limit() {
        let limits = SoftLimits { min: -500, max: 40_000 };
        let mut axis = JogAxis::new(0, speeds(10_000.0), limits);
        axis.run(true).unwrap();
        assert_eq!(until_it_stands(&mut axis).2, 40_000);
        axis.run(true).unwrap();
        assert_eq!(axis.doing(), Doing::Stands, "there is no room");
        axis.run(false).unwrap();
        assert_eq!(until_it_stands(&mut axis).1, -500);

        let mut beyond = JogAxis::new(50_000, speeds(10_000.0), limits);
        beyond.run(true).unwrap();
        assert_eq!((beyond.doing(), beyond.target()), (Doing::Stands, 50_000));
        beyond.run(false).unwrap();
        let (_, low, high) = until_it_stands(&mut beyond);
        assert_eq!((low, high), (-500, 50_000));
    }

    /// `--guard` limits the motion in both directions, in addition to the limits of the machine file, also for an axis
    /// beyond one.
    #[test]
    fn a_guard_limits_the_way_from_the_start() {
        let limits = SoftLimits { min: -500, max: 40_000 };
        for (start, ends) in [(10_000, (9000, 11_000)), (39_500, (38_500, 40_000)), (50_000, (49_000, 50_000))] {
            let mut axis = JogAxis::new(start, speeds(10_000.0), within_guard(limits, start, Guard::Within(1000)));
            axis.run(true).unwrap();
            assert_eq!(until_it_stands(&mut axis).2, ends.1, "{start}");
            axis.run(false).unwrap();
            assert_eq!(until_it_stands(&mut axis).1, ends.0, "{start}");
            axis.run(false).unwrap();
            assert_eq!(axis.doing(), Doing::Stands, "there is no room");
        }
        assert_eq!(within_guard(limits, 0, Guard::Off), limits);
        let everywhere = within_guard(SoftLimits::NONE, i32::MAX, Guard::Within(u32::MAX));
        assert_eq!((everywhere.min, everywhere.max), (i32::MIN, i32::MAX));
    }

    /// An axis at the end of the range of positions stays within it.
    #[test]
    fn an_axis_stays_within_the_range_of_positions() {
        let mut axis = JogAxis::new(i32::MAX - 3000, speeds(1e6), SoftLimits::NONE);
        axis.run(true).unwrap();
        let (_, _, high) = until_it_stands(&mut axis);
        assert_eq!(high, i32::MAX);
    }

    proptest! {
        /// Whichever keys are held for whatever time: no target is beyond a limit, and the distance of two successive
        /// targets is never more than the speed allows.
        #[test]
        fn no_target_is_beyond_a_limit_or_too_fast(
            start in -60_000..60_000_i32, velocity in 10.0..1e6_f64, holds in prop::collection::vec((any::<bool>(), 1..1500_usize, 0..400_usize), 1..12),
        ) {
            let limits = SoftLimits { min: -50_000, max: 50_000 };
            let mut axis = JogAxis::new(start, speeds(velocity), limits);
            let mut last = axis.target();
            let (low, high) = (limits.min.min(start), limits.max.max(start));
            for (is_positive, held, released) in holds {
                for n in 0..held + released {
                    if n < held { axis.run(is_positive).unwrap() } else { axis.brake().unwrap() }
                    axis.advance(CYCLE);
                    let now = axis.target();
                    prop_assert!((low..=high).contains(&now), "{now}");
                    prop_assert!(f64::from(now.abs_diff(last)) <= velocity * CYCLE * 1.01 + 1.0, "{last} to {now}");
                    last = now;
                }
            }
            axis.brake().unwrap();
            let (_, at_least, at_most) = until_it_stands(&mut axis);
            prop_assert!(low <= at_least && at_most <= high);
        }
    }
}
