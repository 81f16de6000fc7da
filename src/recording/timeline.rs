//! Makes the times of frames consistent, even if the clock that stamped them was set meanwhile.
//!
//! The clock of a capture may be set, by NTP or by a person, while it stamps frames, and a bit of the file may flip.
//! Then the times seem to jump by years, but the replay of a recording must not simulate years.

/// The longest time between two frames that is kept unchanged; a longer one is shortened to it. \[OURS] After an hour
/// nothing that the board did before is still going on.
pub const LONGEST_SILENCE_NS: i64 = 3_600_000_000_000;
/// The limit for the sum of all times between frames that are longer than [`SHORT_SILENCE_NS`]: 25 hours. \[OURS]
const SILENCE_IN_ALL_NS: i64 = 25 * LONGEST_SILENCE_NS;
/// The longest time between two frames that is no silence, ns. It is always kept.
const SHORT_SILENCE_NS: i64 = 1_000_000_000;
/// How much earlier than the previous frame a frame's time may be without counting as a jump of the clock, ns. A report
/// has the time at which it was made, but the host may read it late, after commands that it wrote later. 5 s are enough
/// for 31 buffered reports in cycles of up to 128 ms. \[OURS]
const LATE_MAX_NS: i64 = 5_000_000_000;

/// The jumps of a recording's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Jumps {
    /// The number of jumps.
    pub count: u64,
    /// When the clock jumped first, nanoseconds since the first frame in the consistent time.
    pub first_at_ns: i64,
    /// How far the clock jumped the first time, nanoseconds; negative if it jumped back.
    pub first_by_ns: i64,
}

impl std::fmt::Display for Jumps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let seconds = |ns: i64| ns as f64 / 1e9;
        let (at, by) = (seconds(self.first_at_ns), seconds(self.first_by_ns));
        match self.count {
            1 => write!(f, "its times jump once, at {at:.3} s by {by:.3} s")?,
            count => write!(f, "its times jump {count} times, first at {at:.3} s by {by:.3} s")?,
        }
        f.write_str(": that counts as no time, and a silence as an hour at most; see them by `ecmsk dump`")
    }
}

/// Gives frames, in the order of the file, a consistent time since the first frame.
///
/// A frame whose time is far from the times of both neighbours gets their time. If the clock was set back, no time
/// counts as passed. A silence counts as an hour at most, and all silences together as 25 hours.
#[derive(Debug)]
pub struct Timeline<T> {
    /// The time and the frame read last. It is held back until the following frame is read, because only that one shows
    /// whether this time is an outlier. `None`: no frame was read yet.
    held: Option<(u64, T)>,
    /// The latest time of the recording's clock, ns, and the offset that turns a time of this clock into the time since
    /// the first frame, ns. `None` before the first frame.
    clock: Option<(i128, i128)>,
    latest_ns: i64,
    silence_left_ns: i64,
    jumps: Jumps,
}

impl<T> Default for Timeline<T> {
    fn default() -> Self {
        Self { held: None, clock: None, latest_ns: 0, silence_left_ns: SILENCE_IN_ALL_NS, jumps: Jumps::default() }
    }
}

impl<T> Timeline<T> {
    /// Adds the next frame of the file with its time in nanoseconds. Returns the frame before it, with its time since
    /// the first frame in nanoseconds. `None` after the first frame.
    pub fn push(&mut self, at_ns: u64, frame: T) -> Option<(i64, T)> {
        let (before_ns, before) = self.held.replace((at_ns, frame))?;
        Some((self.place(before_ns, Some(at_ns)), before))
    }

    /// Removes the last frame, with its time since the first frame in nanoseconds. `None`: no frame is left.
    pub fn pop(&mut self) -> Option<(i64, T)> {
        let (at_ns, frame) = self.held.take()?;
        Some((self.place(at_ns, None), frame))
    }

    /// The jumps so far; `None` if the clock has not jumped.
    pub const fn jumps(&self) -> Option<Jumps> {
        if self.jumps.count > 0 { Some(self.jumps) } else { None }
    }

    /// Converts the time of a frame to the time since the first frame. `next`: the time of the frame after it.
    fn place(&mut self, at_ns: u64, next: Option<u64>) -> i64 {
        const LATE: i128 = LATE_MAX_NS as i128;
        let at = i128::from(at_ns);
        let Some((clock, offset)) = self.clock else {
            self.clock = Some((at, -at));
            return 0;
        };
        let passed = at - clock;
        // The time is an outlier if it is far from the time of the frame before, and the time of the next frame is not.
        let is_odd = |next: u64| {
            let next = i128::from(next) - clock;
            passed.abs() > LATE
                && (next - passed).abs() > LATE
                && (-LATE..i128::from(LONGEST_SILENCE_NS)).contains(&next)
                && next < passed.max(LATE)
        };
        if next.map_or(passed.abs() > i128::from(LONGEST_SILENCE_NS), is_odd) {
            self.jumped(passed);
            return self.latest_ns;
        }
        let silence =
            passed.min(i128::from(self.silence_left_ns.min(LONGEST_SILENCE_NS)).max(i128::from(SHORT_SILENCE_NS)));
        if passed < -LATE || silence < passed {
            // The clock was set, or a silence was longer than allowed: the difference counts as a jump.
            let counts = if passed < 0 { 0 } else { silence as i64 };
            self.jumped(passed - i128::from(counts));
            self.latest_ns = self.latest_ns.saturating_add(counts);
            self.clock = Some((at, i128::from(self.latest_ns) - at));
        } else {
            self.clock = Some((clock.max(at), offset));
            self.latest_ns = self.latest_ns.max(clamped(at + offset));
        }
        if silence > i128::from(SHORT_SILENCE_NS) {
            self.silence_left_ns = self.silence_left_ns.saturating_sub(clamped(silence)).max(0);
        }
        let (_, offset) = self.clock.unwrap_or_default();
        clamped(at + offset)
    }

    fn jumped(&mut self, by: i128) {
        if self.jumps.count == 0 {
            (self.jumps.first_at_ns, self.jumps.first_by_ns) = (self.latest_ns, clamped(by));
        }
        self.jumps.count += 1;
    }
}

fn clamped(ns: i128) -> i64 {
    i64::try_from(ns).unwrap_or(if ns < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const HOUR: u64 = 3600 * S;

    /// The resulting times of frames, in seconds, and the jumps.
    fn placed(times: &[u64]) -> (Vec<i64>, Option<Jumps>) {
        let mut timeline = Timeline::default();
        let mut found: Vec<i64> = times.iter().filter_map(|at| timeline.push(*at, ())).map(|(at, ())| at).collect();
        found.extend(timeline.pop().map(|(at, ())| at));
        (found.iter().map(|at| at / S as i64).collect(), timeline.jumps())
    }

    /// The times of a clock that was never set are kept, also those of late frames and after silences of up to an hour.
    #[test]
    fn a_clock_that_goes() {
        let calendar = 1_700_000_000 * S;
        for zero in [0, calendar] {
            let times = [10 * S, 11 * S, 8 * S, 12 * S, HOUR, 2 * HOUR - S, 2 * HOUR].map(|at| zero + at);
            let (found, jumps) = placed(&times);
            assert_eq!((found, jumps), (vec![0, 1, -2, 2, 3590, 7189, 7190], None));
        }
        assert_eq!(placed(&[]), (vec![], None));
        assert_eq!(placed(&[7]), (vec![0], None));
    }

    /// If a single frame has a wrong time, because any one bit of it flipped, it gets the time of its neighbours.
    #[test]
    fn a_flipped_bit() {
        let times: Vec<u64> = (0..10).map(|n| 1_700_000_000 * S + n * S).collect();
        for frame in 1..10 {
            for bit in 33..64 {
                let mut times = times.clone();
                times[frame] ^= 1 << bit;
                let (found, jumps) = placed(&times);
                let expected: Vec<i64> = (0..10).collect();
                for (n, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    let apart = (found - expected).abs();
                    // The last frame has no successor that would show an outlier. Only a difference of more than an
                    // hour is recognized, so its time may be wrong by up to an hour.
                    assert!(
                        apart <= if n == frame { if frame == 9 { 3600 } else { 9 } } else { 0 },
                        "{frame} {bit}: {n}"
                    );
                }
                let far = (times[frame] as i128 - (1_700_000_000 + frame as i128) * S as i128).abs() > 6 * S as i128;
                assert!(!far || jumps.is_some() || frame == 9, "{frame} {bit}");
            }
        }
    }

    /// If a clock is set back, no time counts as passed; if it is set forward, by seconds or years, at most an hour.
    #[test]
    fn a_clock_that_is_set() {
        for (by, hours) in [(3 * HOUR as i128, 1), (-3 * HOUR as i128, 0), (-7 * S as i128, 0), (1 << 62, 1)] {
            let zero = 1_700_000_000 * i128::from(S);
            let times: Vec<u64> =
                (0..10).map(|n| (zero + n * i128::from(S) + if n > 4 { by } else { 0 }) as u64).collect();
            let (found, jumps) = placed(&times);
            let passed = hours * 3600;
            let expected = [0, 1, 2, 3, 4, passed + 4, passed + 5, passed + 6, passed + 7, passed + 8];
            assert_eq!(found, expected, "{by}");
            let jumps = jumps.expect("it jumped");
            assert_eq!((jumps.count, jumps.first_at_ns), (1, 4 * S as i64));
            assert_eq!(jumps.first_by_ns.signum(), by.signum() as i64);
        }
    }

    /// All silences together count as 25 hours at most.
    #[test]
    fn silences_in_all() {
        let (found, jumps) = placed(&(0..200).map(|n| n * HOUR).collect::<Vec<_>>());
        let last = *found.last().expect("a time");
        assert!((25 * 3600..26 * 3600 + 200).contains(&last), "{last}");
        assert!(jumps.expect("silences that count less").count > 150);
        // Times between frames of at most a second have no limit.
        let (found, jumps) = placed(&(0..200_000).map(|n| n * S).collect::<Vec<_>>());
        assert_eq!((found.last(), jumps), (Some(&199_999), None));
    }
}
