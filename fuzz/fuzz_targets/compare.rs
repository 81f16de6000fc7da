//! Any two runs, compared: a run is equal to itself, equality has no order, and whatever is found has words. Any times, put
//! in the order of a clock: they end.

#![no_main]

#[path = "support/frames.rs"]
mod frames;

use ecmsk::compare::{CompareOptions, compare};
use ecmsk::recording::Timeline;
use ecmsk::sk::SlotSize;
use libfuzzer_sys::fuzz_target;

/// A day, an hour and one more: what all silences together are at most.
const LONGEST_NS: i64 = 26 * 3_600_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&[choice, cut, low, high], rest)) = bytes.split_first_chunk() else { return };
    let size = if choice & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let options = CompareOptions {
        tolerance_counts: if choice & 2 == 0 { 0 } else { u32::from(low) << 16 },
        statusword_mask: u16::from_le_bytes([low, high]),
        ignore_repeats: choice & 4 != 0,
        latency_cycles: (choice & 16 != 0).then_some(u32::from(choice >> 5)),
        ..CompareOptions::default()
    };
    // The second run is what is left, or the first one's begin.
    let (first, second) = rest.split_at(rest.len() * usize::from(cut) / 255);
    let a = frames::run(first, size);
    let b = if choice & 8 == 0 { frames::run(second, size) } else { a[..a.len() / 2].to_vec() };
    assert!(compare(a.clone(), a.clone(), size, &options).is_equal());
    let found = compare(a.clone(), b.clone(), size, &options);
    assert_eq!(found.is_equal(), compare(b, a, size, &options).is_equal());
    assert_eq!(found.is_equal(), found.to_string().contains("\nequal: "));

    let mut timeline = Timeline::default();
    let times = rest.chunks_exact(8).filter_map(|bytes| bytes.first_chunk()).map(|bytes| u64::from_le_bytes(*bytes));
    let mut count = 0;
    for at_ns in times {
        count += 1;
        if let Some((at_ns, ())) = timeline.push(at_ns, ()) {
            assert!(at_ns < LONGEST_NS + count * 1_000_000_000, "{at_ns}");
        }
    }
    assert!(timeline.pop().is_none_or(|(at_ns, ())| at_ns < LONGEST_NS + (count + 1) * 1_000_000_000));
});
