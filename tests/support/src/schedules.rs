//! Runs random schedules by their seeds: the test's usual number, or the number that `cargo xtask soak` sets in the
//! environment.

use std::env;
use std::fmt::Debug;
use std::ops::AddAssign;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// A number from the environment.
///
/// # Panics
/// If the variable is no number.
pub fn asked(name: &str) -> Option<u64> {
    env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name} is a number, not `{text}`")))
}

/// Runs as many schedules of a test of a group as are asked for, or `usual`, and returns their number and the sum of
/// what they did. The seed of a failing one is printed.
///
/// # Panics
/// If a schedule does.
pub fn run_all<D: AddAssign + Debug + Default>(
    group: &str,
    test: &str,
    usual: u64,
    schedule: impl Fn(u64) -> D,
) -> (u64, D) {
    let first = asked("ECMSK_SOAK_FIRST").unwrap_or(0);
    let wanted = asked("ECMSK_SOAK_SCHEDULES");
    let schedules = wanted.unwrap_or(usual);
    let mut all = D::default();
    let mut told = Instant::now();
    for seed in first..first + schedules {
        match catch_unwind(AssertUnwindSafe(|| schedule(seed))) {
            Ok(done) => all += done,
            Err(_) => panic!(
                "schedule {seed} breaks what must hold (above); again: ECMSK_SOAK_FIRST={seed} ECMSK_SOAK_SCHEDULES=1 \
                 cargo test --test {group} {test}"
            ),
        }
        if wanted.is_some() && told.elapsed() > Duration::from_secs(5) {
            told = Instant::now();
            println!("{} of {schedules} schedules of {test}", seed + 1 - first);
        }
    }
    println!("{schedules} schedules of {test}: {all:?}");
    (schedules, all)
}
