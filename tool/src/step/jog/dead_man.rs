//! The dead man's rule: which key counts as held, by the times at which keys arrive.
//!
//! A terminal reports a key again and again while it is held, and nothing when it is released. So an axis runs only as
//! long as its key arrives again in time. Over a slow line, keys may come late and many at once. Such a burst says no more
//! than that the key was held at some time before: it counts once, and begins no motion.

use std::time::Duration;

/// \[OURS] Keys that follow one another within this time are a burst, whose keys have waited somewhere: keyboards repeat a
/// key 50 times a second at most.
const BURST: Duration = Duration::from_millis(10);
/// \[OURS] For how long no key counts after the beginning, and after this process has stalled. The keys that were typed
/// before arrive then.
const DEAF: Duration = Duration::from_millis(100);

/// A key that moves an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotionKey {
    /// The index of the axis among those of the verb.
    pub axis: usize,
    /// Whether the key moves the axis in the positive direction of its unit.
    pub is_positive: bool,
}

/// How long the repeat of a key may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// After the first key: until the keyboard begins to repeat it.
    pub first: Duration,
    /// After a repeat.
    pub repeat: Duration,
}

/// The key that counts as held. Times count from the moment at which keys begin to be read.
#[derive(Debug)]
pub struct DeadMan {
    times: Times,
    held: Option<Held>,
    /// When the newest key has arrived.
    newest: Option<Duration>,
    deaf_until: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    key: MotionKey,
    until: Duration,
    /// Whether the key has been repeated since the motion began.
    is_repeated: bool,
}

impl DeadMan {
    pub const fn new(times: Times) -> Self {
        Self { times, held: None, newest: None, deaf_until: DEAF }
    }

    /// The key that counts as held at the time `now`; `None`: all axes have to stand.
    pub fn held(&self, now: Duration) -> Option<MotionKey> {
        self.held.filter(|held| now < held.until).map(|held| held.key)
    }

    /// A key that moves an axis has arrived, for the first time or again.
    pub fn press(&mut self, at: Duration, key: MotionKey) {
        let is_burst = self.newest.replace(at).is_some_and(|newest| at < newest + BURST);
        if at < self.deaf_until {
            return;
        }
        self.held = match self.held.filter(|held| at < held.until) {
            // A key that moves the axis already goes on until the time that the first key of the burst has allowed.
            Some(held) if is_burst => (held.key == key && held.is_repeated).then_some(held),
            None if is_burst => None,
            Some(held) if held.key == key => Some(Held { key, until: at + self.times.repeat, is_repeated: true }),
            _ => Some(Held { key, until: at + self.times.first, is_repeated: false }),
        };
    }

    /// A key was released, or another one has arrived that moves no axis: all axes stop.
    pub const fn stop(&mut self, at: Duration) {
        self.newest = Some(at);
        self.held = None;
    }

    /// This process has stalled until now: all axes stop, and the keys that were typed meanwhile do not count.
    pub fn stalled(&mut self, now: Duration) {
        self.held = None;
        self.deaf_until = now + DEAF;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TIMES: Times = Times { first: Duration::from_millis(400), repeat: Duration::from_millis(150) };
    const RIGHT: MotionKey = MotionKey { axis: 0, is_positive: true };
    const LEFT: MotionKey = MotionKey { axis: 0, is_positive: false };

    /// A time, counted from when keys begin to count.
    fn ms(time: u64) -> Duration {
        DEAF + Duration::from_millis(time)
    }

    /// The key held at each of these times, after keys that arrived at those times.
    fn held(keys: &[(u64, MotionKey)], looks: &[u64]) -> Vec<bool> {
        let mut dead_man = DeadMan::new(TIMES);
        let mut keys = keys.iter().peekable();
        looks
            .iter()
            .map(|look| {
                while let Some((at, key)) = keys.next_if(|(at, _)| at <= look) {
                    dead_man.press(ms(*at), *key);
                }
                dead_man.held(ms(*look)).is_some()
            })
            .collect()
    }

    /// docs/SAFETY.md: without a repeat an axis stops 400 ms after the first key, and 150 ms after a repeat.
    #[test]
    fn a_key_without_a_repeat_is_released() {
        assert_eq!(held(&[(0, RIGHT)], &[0, 399, 400]), [true, true, false]);
        assert_eq!(held(&[(0, RIGHT), (300, RIGHT)], &[449, 450]), [true, false]);
        let keys: Vec<_> = std::iter::once(0).chain((300..2000).step_by(33)).map(|at| (at, RIGHT)).collect();
        // The last one arrives after 1983 ms.
        assert_eq!(held(&keys, &[100, 1000, 1990, 2132, 2133]), [true, true, true, true, false]);
        // After that it is a first key again.
        assert_eq!(held(&[(0, RIGHT), (1000, RIGHT)], &[500, 1399, 1400]), [false, true, false]);
    }

    /// docs/SAFETY.md: keys that a stalled line delivers in a burst begin no motion, and prolong one only by the time of
    /// one key.
    #[test]
    fn a_burst_counts_once() {
        let burst = |from: u64| (0..100).map(move |n| (from + n / 10, RIGHT));
        assert_eq!(held(&burst(0).collect::<Vec<_>>(), &[11, 50, 300]), [false; 3]);
        let held_before = [(0, RIGHT), (300, RIGHT), (333, RIGHT)];
        let keys: Vec<_> = held_before.into_iter().chain(burst(450)).collect();
        assert_eq!(held(&keys, &[449, 460, 599, 600]), [true, true, true, false]);
        // A trickle of old keys, each 5 ms after the last one, is a burst as well.
        let trickle = (0..400).map(|n| (450 + 5 * n, RIGHT));
        let keys: Vec<_> = held_before.into_iter().chain(trickle).collect();
        assert_eq!(held(&keys, &[599, 600, 1000]), [true, false, false]);
        // The key that is held still, behind the burst, moves the axis again.
        let keys: Vec<_> = burst(0).chain([(60, RIGHT), (93, RIGHT)]).collect();
        assert_eq!(held(&keys, &[59, 61, 242, 243]), [false, true, true, false]);
    }

    /// What was typed before the beginning, and arrives just after it, does not count. A key that is held still does.
    #[test]
    fn keys_from_before_the_beginning_do_not_count() {
        let mut dead_man = DeadMan::new(TIMES);
        for at in [0, 33, 66, 99] {
            dead_man.press(Duration::from_millis(at), RIGHT);
            assert_eq!(dead_man.held(Duration::from_millis(at)), None);
        }
        dead_man.press(Duration::from_millis(132), RIGHT);
        assert_eq!(dead_man.held(Duration::from_millis(132)), Some(RIGHT));
    }

    /// Another key, a release and a stall end the motion. What was typed during a stall does not count.
    #[test]
    fn another_key_a_release_and_a_stall_end_the_motion() {
        let mut dead_man = DeadMan::new(TIMES);
        dead_man.press(ms(0), RIGHT);
        dead_man.press(ms(100), LEFT);
        assert_eq!(dead_man.held(ms(110)), Some(LEFT));
        dead_man.stop(ms(120));
        assert_eq!(dead_man.held(ms(121)), None);
        dead_man.press(ms(200), LEFT);
        dead_man.stalled(ms(300));
        assert_eq!(dead_man.held(ms(300)), None);
        dead_man.press(ms(350), LEFT);
        assert_eq!(dead_man.held(ms(351)), None);
        dead_man.press(ms(401), LEFT);
        assert_eq!(dead_man.held(ms(402)), Some(LEFT));
    }

    proptest! {
        /// Whatever arrives, and however late: nothing runs longer than the newest key allows.
        #[test]
        fn nothing_runs_longer_than_the_newest_key_allows(steps in prop::collection::vec((0_u64..700, any::<bool>(), 0..8), 1..60)) {
            let mut dead_man = DeadMan::new(TIMES);
            let mut now = 1000;
            for (wait, is_positive, what) in steps {
                now += wait / if what == 0 { 100 } else { 1 };
                match what {
                    1 => dead_man.stop(ms(now)),
                    2 => dead_man.stalled(ms(now)),
                    _ => dead_man.press(ms(now), MotionKey { axis: 0, is_positive }),
                }
                prop_assert_eq!(dead_man.held(ms(now + 400)), None);
                let is_running = dead_man.held(ms(now + 150)).is_some();
                prop_assert!(!is_running || dead_man.held.is_some_and(|held| !held.is_repeated));
            }
        }
    }
}
