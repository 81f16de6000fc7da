//! What the benches share: measuring, and printing a figure as a line of JSON for `cargo xtask bench`.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::time::{Duration, Instant};

use serde_json::json;

/// Blocks of each side.
const BLOCKS: usize = 31;
/// How long a block lasts, about.
const BLOCK_TIME: Duration = Duration::from_millis(10);
/// How long each side runs before it counts.
const WARM_UP: Duration = Duration::from_millis(100);

/// What is demanded of a pair.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// Name of the figure.
    pub name: &'static str,
    /// The most that ours may take, as a multiple of the baseline; `None`: nothing is demanded.
    pub target: Option<f64>,
    /// However large the ratio, ours passes if it takes no more than this above the baseline.
    pub allowance: Option<Duration>,
    /// What the baseline is, where the name of the figure does not say it.
    pub against: Option<&'static str>,
}

/// Measures `ours` against `baseline`, in alternating blocks, and prints the figure: times per call, and the median of the
/// ratios of the blocks. Wrap what they take and give in [`std::hint::black_box`].
pub fn pair(name: &'static str, target: f64, ours: impl FnMut(), baseline: impl FnMut()) {
    pair_of_calls(Demand { name, target: Some(target), allowance: None, against: None }, ours, baseline);
}

/// As [`pair`], with all that is demanded.
pub fn pair_of_calls(demand: Demand, mut ours: impl FnMut(), mut baseline: impl FnMut()) {
    let ours_calls = calls_per_block(&mut ours);
    let baseline_calls = calls_per_block(&mut baseline);
    pair_of_blocks(
        demand,
        BLOCKS,
        || per_call_ns(ours_calls, &mut ours),
        || per_call_ns(baseline_calls, &mut baseline),
    );
}

/// As [`pair`], for what times itself: each call is one block and gives its figure in nanoseconds.
pub fn pair_of_blocks(demand: Demand, blocks: usize, mut ours: impl FnMut() -> f64, mut baseline: impl FnMut() -> f64) {
    let mut ours_ns = Vec::with_capacity(blocks);
    let mut baseline_ns = Vec::with_capacity(blocks);
    for block in 0..blocks {
        // Who goes first changes too: what the machine does meanwhile, growing warm for one, then hits both alike.
        if block % 2 == 0 {
            ours_ns.push(ours());
            baseline_ns.push(baseline());
        } else {
            baseline_ns.push(baseline());
            ours_ns.push(ours());
        }
    }
    let ratios = ours_ns.iter().zip(&baseline_ns).map(|(ours, baseline)| ours / baseline).collect();
    let mut figure = json!({
        "name": demand.name,
        "ours_ns": median(ours_ns),
        "baseline_ns": median(baseline_ns),
        "ratio": median(ratios),
        "target": demand.target,
    });
    if let Some(allowance) = demand.allowance {
        figure["allowance_ns"] = (allowance.as_nanos() as f64).into();
    }
    if let Some(against) = demand.against {
        figure["against"] = against.into();
    }
    println!("{figure}");
}

/// Prints a figure that nothing is compared with.
pub fn fact(name: &str, value: f64, unit: &str) {
    println!(
        "{}",
        json!({
            "name": name, "ours_ns": null, "baseline_ns": null, "ratio": null, "target": null,
            "value": value, "unit": unit,
        })
    );
}

/// Prints a figure that must not be above `most`.
pub fn limited(name: &str, value: f64, unit: &str, most: f64) {
    println!(
        "{}",
        json!({
            "name": name, "ours_ns": null, "baseline_ns": null, "ratio": null, "target": most,
            "value": value, "unit": unit,
        })
    );
}

/// The middle one of `values`; of an even number the upper of the two.
///
/// # Panics
/// If there is none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Warms up, and finds how many calls last as long as a block.
fn calls_per_block(call: &mut impl FnMut()) -> u64 {
    let start = Instant::now();
    let mut calls = 0u64;
    while start.elapsed() < WARM_UP {
        call();
        calls += 1;
    }
    // Looking at the clock took part of that time: once more without.
    let per_call = per_call_ns(calls, call).max(1e-3);
    ((BLOCK_TIME.as_nanos() as f64 / per_call) as u64).max(1)
}

/// The time that `share` of 100 of so many calls do not exceed, nanoseconds.
pub fn percentile(calls: usize, share: usize, mut call: impl FnMut()) -> f64 {
    let mut times: Vec<u64> = (0..calls)
        .map(|_| {
            let begin = Instant::now();
            call();
            begin.elapsed().as_nanos() as u64
        })
        .collect();
    times.sort_unstable();
    times[calls * share / 100] as f64
}

/// Time of a call, mean of so many.
pub fn per_call_ns(calls: u64, call: &mut impl FnMut()) -> f64 {
    let start = Instant::now();
    for _ in 0..calls {
        call();
    }
    start.elapsed().as_nanos() as f64 / calls as f64
}
