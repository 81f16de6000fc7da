//! The dead man's switch: decides from the arrival times of keys which key counts as held.
//!
//! A terminal reports a key again and again while it is held, and nothing when it is released. So an axis runs only as
//! long as its key arrives again in time. Over a slow line, keys may arrive late and many at once. Such a burst only
//! shows that the key was held at some earlier time, so it counts as one key and starts no motion. If the delay of the
//! line is measured, keys that may be old do not count at all.

use std::time::Duration;

use super::JogMotion;
use super::line::Line;

/// \[OURS] Keys that arrive within this time of each other are a burst, which was delayed on the line: a keyboard
/// repeats a key at most 50 times a second.
const BURST: Duration = Duration::from_millis(10);
/// \[OURS] For this long after the beginning and after a stall of this process no key counts, because keys that were
/// typed before arrive in this time.
const DEAF: Duration = Duration::from_millis(100);

/// How long the repeat of a held key may take; after this time the key counts as released.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// The time after the first press, in which the keyboard must begin to repeat the key.
    pub first: Duration,
    /// The time after each repeat.
    pub repeat: Duration,
}

/// Tracks which key counts as held. All times are relative to the moment at which reading keys begins.
#[derive(Debug)]
pub struct DeadMan {
    times: Times,
    held: Option<Held>,
    /// The arrival time of the latest key.
    newest: Option<Duration>,
    deaf_until: Duration,
    /// Measures the delay of the line to the terminal; `None` if it is not measured.
    line: Option<Line>,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    key: JogMotion,
    until: Duration,
    /// Whether the key has been repeated since the motion began.
    is_repeated: bool,
}

impl DeadMan {
    /// Starts with no key held. `is_measured`: a key counts only if the measured delay of the line shows that it is not
    /// old.
    pub fn new(times: Times, is_measured: bool) -> Self {
        let line = is_measured.then(Line::default);
        Self { times, held: None, newest: None, deaf_until: DEAF, line }
    }

    /// Records that a status query is sent to the terminal; returns false if none should be sent, see [`Line::ask`].
    pub fn ask(&mut self, at: Duration) -> bool {
        self.line.as_mut().is_some_and(|line| line.ask(at))
    }

    /// Records that the terminal has answered a query.
    pub fn answer(&mut self) {
        self.line.iter_mut().for_each(Line::answer);
    }

    /// Whether no key counts at present, because the line to the terminal is too slow.
    pub fn is_line_late(&self, now: Duration) -> bool {
        self.line.as_ref().is_some_and(|line| line.is_late(now))
    }

    /// The key that counts as held at the time `now`; `None` if all axes must stop.
    pub fn held(&self, now: Duration) -> Option<JogMotion> {
        self.held.filter(|held| now < held.until).map(|held| held.key)
    }

    /// Processes a key that moves an axis: its first press or a repeat.
    pub fn press(&mut self, at: Duration, key: JogMotion) {
        let is_burst = self.newest.replace(at).is_some_and(|newest| at < newest + BURST);
        if at < self.deaf_until {
            return;
        }
        if self.is_line_late(at) {
            self.held = None;
            return;
        }
        self.held = match self.held.filter(|held| at < held.until) {
            // In a burst, a key that already moves the axis stays held, but only until the time set by the first key of
            // the burst.
            Some(held) if is_burst => (held.key == key && held.is_repeated).then_some(held),
            None if is_burst => None,
            Some(held) if held.key == key => Some(Held { key, until: at + self.times.repeat, is_repeated: true }),
            _ => Some(Held { key, until: at + self.times.first, is_repeated: false }),
        };
    }

    /// Stops all axes, because a key was released, or a key has arrived that moves no axis.
    pub const fn stop(&mut self, at: Duration) {
        self.newest = Some(at);
        self.held = None;
    }

    /// Stops all axes, because this process has stalled until now. Keys that were typed meanwhile do not count.
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
    const RIGHT: JogMotion = JogMotion { axis: 0, is_positive: true };
    const LEFT: JogMotion = JogMotion { axis: 0, is_positive: false };

    /// A time after [`DEAF`], from which on keys count.
    fn ms(time: u64) -> Duration {
        DEAF + Duration::from_millis(time)
    }

    /// Whether a key counts as held at each of the times `looks`, if keys arrive as in `keys` (time, key).
    fn held(keys: &[(u64, JogMotion)], looks: &[u64]) -> Vec<bool> {
        let mut dead_man = DeadMan::new(TIMES, false);
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

    /// docs/SAFETY.md: without a repeat of its key, an axis stops 400 ms after the first key and 150 ms after a repeat.
    #[test]
    fn a_key_without_a_repeat_is_released() {
        assert_eq!(held(&[(0, RIGHT)], &[0, 399, 400]), [true, true, false]);
        assert_eq!(held(&[(0, RIGHT), (300, RIGHT)], &[449, 450]), [true, false]);
        let keys: Vec<_> = std::iter::once(0).chain((300..2000).step_by(33)).map(|at| (at, RIGHT)).collect();
        // The last repeat arrives after 1983 ms.
        assert_eq!(held(&keys, &[100, 1000, 1990, 2132, 2133]), [true, true, true, true, false]);
        // After the key has counted as released, the same key counts as a first key again.
        assert_eq!(held(&[(0, RIGHT), (1000, RIGHT)], &[500, 1399, 1400]), [false, true, false]);
    }

    /// docs/SAFETY.md: keys that a stalled line delivers in a burst start no motion, and prolong a motion only by the
    /// time of one key.
    #[test]
    fn a_burst_counts_once() {
        let burst = |from: u64| (0..100).map(move |n| (from + n / 10, RIGHT));
        assert_eq!(held(&burst(0).collect::<Vec<_>>(), &[11, 50, 300]), [false; 3]);
        let held_before = [(0, RIGHT), (300, RIGHT), (333, RIGHT)];
        let keys: Vec<_> = held_before.into_iter().chain(burst(450)).collect();
        assert_eq!(held(&keys, &[449, 460, 599, 600]), [true, true, true, false]);
        // A sequence of old keys, each 5 ms after the previous one, is a burst too.
        let trickle = (0..400).map(|n| (450 + 5 * n, RIGHT));
        let keys: Vec<_> = held_before.into_iter().chain(trickle).collect();
        assert_eq!(held(&keys, &[599, 600, 1000]), [true, false, false]);
        // A key that is still held after the burst moves the axis again.
        let keys: Vec<_> = burst(0).chain([(60, RIGHT), (93, RIGHT)]).collect();
        assert_eq!(held(&keys, &[59, 61, 242, 243]), [false, true, true, false]);
    }

    /// Simulates a key that is held for a second, over a line with this delay in each direction. Returns when the
    /// motion begins after the first press, and when it ends after the release, in ms; `None` if nothing moves.
    fn over_a_line(delay: u64) -> Option<(u64, u64)> {
        const RELEASED: u64 = 2000;
        let mut dead_man = DeadMan::new(TIMES, true);
        let asked = |at: u64| at.is_multiple_of(50);
        let pressed = |at: u64| at == 1000 || (1300..RELEASED).contains(&at) && at % 33 == 13;
        let mut moves = Vec::new();
        for now in 0..4000 {
            if asked(now) {
                assert!(dead_man.ask(ms(now)));
            }
            if now >= 2 * delay && asked(now - 2 * delay) {
                dead_man.answer();
            }
            if now >= delay && pressed(now - delay) {
                dead_man.press(ms(now), RIGHT);
            }
            if dead_man.held(ms(now)).is_some() {
                moves.push(now);
            }
        }
        Some((moves.first()? - 1000, moves.last()?.saturating_sub(RELEASED)))
    }

    /// docs/SAFETY.md: keys that may be older than 200 ms move nothing. So a line with a constant delay prolongs no
    /// motion by more than this time.
    #[test]
    fn keys_of_a_late_line_do_not_count() {
        for delay in [0, 20, 70] {
            let (begins, ends) = over_a_line(delay).expect("it moves");
            assert!(begins <= delay && ends <= 150 + delay, "{delay}: {begins} {ends}");
        }
        for delay in [110, 200, 500] {
            assert_eq!(over_a_line(delay), None, "{delay}");
        }
    }

    /// If a line no longer answers, the next key ends the motion, and after two seconds no more queries are sent.
    #[test]
    fn a_line_that_answers_no_more_ends_the_motion() {
        let mut dead_man = DeadMan::new(TIMES, true);
        dead_man.press(ms(0), RIGHT);
        assert_eq!(dead_man.held(ms(1)), None, "it has not answered yet");
        assert!(dead_man.ask(ms(0)));
        dead_man.answer();
        dead_man.press(ms(20), RIGHT);
        assert_eq!(dead_man.held(ms(20)), Some(RIGHT));
        dead_man.press(ms(201), RIGHT);
        assert_eq!((dead_man.held(ms(201)), dead_man.is_line_late(ms(201))), (None, true));
        let questions = (0..100).filter(|n| dead_man.ask(ms(300 + 50 * n))).count();
        assert_eq!(questions, 40);
    }

    /// Keys that were typed before the beginning and arrive just after it do not count. A key that is still held does.
    #[test]
    fn keys_from_before_the_beginning_do_not_count() {
        let mut dead_man = DeadMan::new(TIMES, false);
        for at in [0, 33, 66, 99] {
            dead_man.press(Duration::from_millis(at), RIGHT);
            assert_eq!(dead_man.held(Duration::from_millis(at)), None);
        }
        dead_man.press(Duration::from_millis(132), RIGHT);
        assert_eq!(dead_man.held(Duration::from_millis(132)), Some(RIGHT));
    }

    /// Another key, a release and a stall end the motion. Keys that were typed during a stall do not count.
    #[test]
    fn another_key_a_release_and_a_stall_end_the_motion() {
        let mut dead_man = DeadMan::new(TIMES, false);
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
        /// Whatever arrives, and however late: no axis runs longer than the newest key allows.
        #[test]
        fn nothing_runs_longer_than_the_newest_key_allows(steps in prop::collection::vec((0_u64..700, any::<bool>(), 0..8), 1..60)) {
            let mut dead_man = DeadMan::new(TIMES, false);
            let mut now = 1000;
            for (wait, is_positive, what) in steps {
                now += wait / if what == 0 { 100 } else { 1 };
                match what {
                    1 => dead_man.stop(ms(now)),
                    2 => dead_man.stalled(ms(now)),
                    _ => dead_man.press(ms(now), JogMotion { axis: 0, is_positive }),
                }
                prop_assert_eq!(dead_man.held(ms(now + 400)), None);
                let is_running = dead_man.held(ms(now + 150)).is_some();
                prop_assert!(!is_running || dead_man.held.is_some_and(|held| !held.is_repeated));
            }
        }
    }
}
