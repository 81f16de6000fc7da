//! Groups the motions of an axis by their start and end. The following error of a motion is meaningful only if it is
//! compared with the same motion at another time.

use std::collections::BTreeMap;

/// A motion ends when the target has not changed for this long, ns. \[OURS] These are ten cycles of the slowest board.
const REST_NS: i64 = 100_000_000;
/// The largest number of different motions that are kept for an axis; the longest ones are kept. \[OURS] It limits
/// memory for a program that follows a sensor and never repeats a motion.
const MOTIONS_MAX: usize = 64;

/// The start and the end of a motion, in counts.
pub type Way = (i32, i32);

/// The statistics of all motions with the same start and end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// The number of these motions.
    pub times: u64,
    /// Their largest following error, in counts.
    pub error: u64,
}

/// The motions of an axis, by start and end.
#[derive(Clone, Debug, Default)]
pub struct Motions(BTreeMap<Way, Seen>);

impl Motions {
    pub fn add(&mut self, way: Way, error: u64) {
        let length = |(from, to): Way| i64::from(to).abs_diff(i64::from(from));
        if self.0.len() == MOTIONS_MAX && !self.0.contains_key(&way) {
            let shortest = self.0.keys().copied().min_by_key(|way| length(*way));
            match shortest.filter(|shortest| length(*shortest) < length(way)) {
                Some(shortest) => self.0.remove(&shortest),
                None => return,
            };
        }
        let seen = self.0.entry(way).or_default();
        *seen = Seen { times: seen.times + 1, error: seen.error.max(error) };
    }

    /// The statistics of a motion; `None` if the axis has not made it.
    pub fn of(&self, way: Way) -> Option<Seen> {
        self.0.get(&way).copied()
    }

    pub fn all(&self) -> impl Iterator<Item = (Way, Seen)> {
        self.0.iter().map(|(way, seen)| (*way, *seen))
    }
}

/// The motion that occurs in most items of `all`. If several do, it is the most frequent one of them, then the longest
/// one. `None` if no motion occurs in more than one item.
pub fn common<'a>(all: impl Iterator<Item = &'a Motions>) -> Option<Way> {
    let mut found: BTreeMap<Way, (u64, u64)> = BTreeMap::new();
    for (way, seen) in all.flat_map(Motions::all) {
        let (parts, times) = found.entry(way).or_default();
        (*parts, *times) = (*parts + 1, *times + seen.times);
    }
    let length = |(from, to): Way| i64::from(to).abs_diff(i64::from(from));
    let (way, (parts, _)) = found.into_iter().max_by_key(|(way, seen)| (*seen, length(*way)))?;
    (parts > 1).then_some(way)
}

/// Finds the motions of an axis in its targets: a motion ends where the target rests or turns.
#[derive(Clone, Debug, Default)]
pub struct MotionFinder {
    target: Option<Target>,
}

#[derive(Clone, Copy, Debug)]
struct Target {
    now: i32,
    changed_ns: i64,
    /// The target at which the motion began; `None` if it is unknown, because the first target was seen during a
    /// motion.
    from: Option<i32>,
    /// The sign of the motion; 0 at rest.
    sign: i32,
    error: u64,
}

impl MotionFinder {
    /// Processes a report: the target in force and the following error, both in counts. Returns the motion that has
    /// ended with this report, and its largest following error.
    pub fn report(&mut self, at_ns: i64, target: Option<i32>, error: Option<u64>) -> Option<(Way, u64)> {
        let Some(now) = target else {
            self.target = None;
            return None;
        };
        let Some(last) = &mut self.target else {
            self.target = Some(Target { now, changed_ns: at_ns, from: None, sign: 0, error: 0 });
            return None;
        };
        let sign = (i64::from(now) - i64::from(last.now)).signum() as i32;
        let rests = sign == 0 && at_ns.saturating_sub(last.changed_ns) >= REST_NS;
        let turns = sign != 0 && last.sign != 0 && sign != last.sign;
        let ended = (rests || turns).then(|| Some(((last.from?, last.now), last.error))).flatten();
        if rests || turns {
            (last.from, last.error) = (Some(last.now), 0);
            last.sign = sign;
        } else if sign != 0 {
            last.sign = sign;
        }
        // This comes after the reset above, so the error counts for the new motion and not for the one that has just
        // ended.
        last.error = last.error.max(error.unwrap_or_default());
        if sign != 0 {
            (last.now, last.changed_ns) = (now, at_ns);
        }
        ended.filter(|((from, to), _)| from != to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// The motions that are found in these targets, one per millisecond. The following error is a tenth of the target.
    fn found(targets: impl IntoIterator<Item = i32>) -> Vec<(Way, u64)> {
        let mut finder = MotionFinder::default();
        let targets = targets.into_iter().enumerate();
        targets
            .filter_map(|(ms, target)| {
                finder.report(ms as i64 * MS, Some(target), Some(u64::from(target.unsigned_abs()) / 10))
            })
            .collect()
    }

    /// A motion ends where the target rests for a tenth of a second, and where it turns. A motion that may have begun
    /// before the first target is left out.
    #[test]
    fn motions_end_at_rest_and_where_they_turn() {
        let rest = |at: i32| std::iter::repeat_n(at, 200);
        let to = |from: i32, to: i32| (0..=100).map(move |n| from + (to - from) * n / 100);
        let way =
            rest(500).chain(to(500, 1500)).chain(rest(1500)).chain(to(1500, 0)).chain(to(0, 300)).chain(rest(300));
        assert_eq!(found(way), [((500, 1500), 150), ((1500, 0), 150), ((0, 300), 30)]);
        assert_eq!(found(to(7, 400).chain(rest(400)).chain(to(400, 7)).chain(rest(7))), [((400, 7), 40)]);
        // A short pause of the target does not end the motion.
        let pause = rest(0).chain(to(0, 500)).chain(std::iter::repeat_n(500, 50)).chain(to(500, 900)).chain(rest(900));
        assert_eq!(found(pause), [((0, 900), 90)]);
    }

    /// The motion that is compared is the one that occurs in most parts.
    #[test]
    fn the_common_motion_is_in_most_parts() {
        let motions = |ways: &[Way]| {
            let mut motions = Motions::default();
            ways.iter().for_each(|way| motions.add(*way, 5));
            motions
        };
        let parts = [motions(&[(0, 9), (9, 0)]), motions(&[(0, 9), (0, 9)]), motions(&[(9, 0), (0, 9), (0, 1)])];
        assert_eq!(common(parts.iter()), Some((0, 9)));
        assert_eq!(common(parts[..1].iter()), None);
        // If there are too many motions, the longest ones are kept.
        let mut many = Motions::default();
        (1..1000).for_each(|to| many.add((0, to), 1));
        assert!(many.all().count() == MOTIONS_MAX && many.of((0, 999)).is_some() && many.of((0, 1)).is_none());
    }
}
