//! Any run, judged for an ECM-XF: each thing has a verdict and a place in the run, what differs has its row, `ahead=` is what a
//! chip holds, and packets that are named hold the cycle.

#![no_main]

#[path = "support/frames.rs"]
mod frames;

use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::migrate::{Migration, Setting, Survey, Verdict};
use ecmsk::recording::Clock;
use ecmsk::sk::SlotSize;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((&[choice, speed], rest)) = bytes.split_first_chunk() else { return };
    let size = if choice & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let clock = if choice & 2 == 0 { Clock::Real } else { Clock::Virtual };
    let (clock_hz, is_behind_chip) = (100_000 + u32::from(speed) * 376_000, choice & 128 != 0);
    let setting = Setting { clock_hz, clock, slot: size, is_behind_chip };
    let run = frames::run(rest, size);
    let mut survey = Survey::new(size);
    for observed in &run {
        let seen = survey.frame(observed);
        assert!(seen.level.is_none_or(|level| level <= 160));
        for stretch in [seen.pause, seen.gap].into_iter().flatten() {
            assert!(stretch.from_ns <= stretch.to_ns, "{stretch:?}");
        }
    }
    let found = Migration::of(&survey, &setting);
    assert_eq!(found.commands + found.reports, run.len() as u64);
    for item in &found.items {
        assert!(item.count.times > 0 && item.count.exposed <= item.count.times, "{item:?}");
        assert!(run.iter().any(|observed| observed.number == item.count.first.frame), "{item:?}");
        assert!(!item.count.subject.to_string().is_empty());
    }
    let rows = found.rows();
    assert!(found.verdicts().filter_map(Verdict::row).all(|row| rows.contains(&row)));
    assert!(!found.runs_as_it_is() || rows.is_empty());
    let Some(plan) = found.plan else { return };
    assert!((1..=60).contains(&plan.ahead.value) && plan.ahead.value <= plan.needs.ahead_max, "{:?}", plan.ahead);
    let bridged = XfBusOptions::DEFAULT.ahead.min(plan.needs.ahead_max);
    assert_eq!(plan.ahead.verdict == Verdict::Yes, plan.ahead.stall_cycles <= bridged, "{:?}", plan.ahead);
    if let Ok(packets) = plan.needs.with_int0 {
        assert!(packets.sets > 0 && packets.size.bytes() >= plan.needs.set_bytes(), "{packets:?}");
        assert!(packets.least_clock_hz <= setting.clock_hz, "{packets:?}");
    }
});
