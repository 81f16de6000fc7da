//! Runs whose host was late, and the resulting `ahead=`.

use super::*;

/// A pause between writes that is longer than usual is a stall if the motion was not over.
#[test]
fn late_writes() {
    let stall = |run: &Run| run.found().timing.stall(MS);
    let mut run = Run::in_op(1, 1000);
    run.moves(0..100, 20, MS);
    assert_eq!(stall(&run), None);
    // Reports continue for 12 ms more than usual, while targets still wait in the FIFO.
    for waiting in (8..20).rev() {
        run.pass(MS).op(waiting);
    }
    run.moves(100..200, 20, MS);
    assert!(run.found().timing.longest_pause.is_some_and(|(ns, _)| ns == 13 * MS));
    let found = stall(&run).expect("a stall");
    assert_eq!((found.ns, found.seen_by), (12 * MS, SeenBy::LateWrite));
    assert_eq!(run.found().plan.expect("a plan").ahead.stall_cycles, 12);
    assert!(!found.is_limited());
    // 20 frames waited at the newest report, and one was written after it.
    assert_eq!((found.whole_ns, found.usual_ns, found.sets), (13 * MS, MS, 21));
    // If no axis moves, a pause is the program's intention: the program polls the state of drives that are off, or
    // repeats a target.
    let mut run = Run::in_op(1, 1000);
    for n in 0..50 {
        run.take(Dir::Write, Frame::new()).pass(if n == 30 { 20 * MS } else { MS }).op(8);
    }
    assert_eq!(
        (stall(&run).map(|stall| stall.seen_by), run.found().timing.longest_pause),
        (Some(SeenBy::Silence), None)
    );
    let mut run = Run::in_op(1, 1000);
    for n in 0..50 {
        run.csp(100).pass(MS / 2);
        for _ in 0..if n == 30 { 20 } else { 1 } {
            run.op(8).pass(MS / 2);
        }
    }
    assert_eq!((stall(&run), run.found().timing.longest_pause), (None, None));
    // The pause after a motion is no stall: the FIFO has run empty, and the next target begins another motion.
    let mut run = Run::in_op(1, 1000);
    run.moves(0..100, 20, MS);
    for waiting in (0..20).rev() {
        run.pass(MS).op(waiting);
    }
    for _ in 0..30 {
        run.pass(MS).op(0);
    }
    run.csp(5000).moves(500..600, 20, MS);
    assert_eq!(stall(&run), None);
    assert_eq!(run.found().timing.gaps, 0);
}

/// Cycles with an empty FIFO during a motion are counted. With no frames in the FIFO there would be no outputs in a
/// chip either, so the stall has no more cycles than frames were waiting.
#[test]
fn repeated_outputs() {
    let mut run = Run::in_op(1, 1000);
    run.moves(0..100, 0, MS);
    for _ in 0..7 {
        run.pass(MS).op(0);
    }
    run.moves(100..200, 0, MS);
    let timing = run.found().timing;
    let (longest_ns, _) = timing.longest_gap.expect("a gap");
    assert_eq!((timing.gaps, timing.repeated_cycles, longest_ns), (1, 7, 6 * MS));
    // One frame was in the FIFO, so a chip could have bridged one cycle of the pause.
    let stall = timing.stall(MS).expect("a stall");
    assert_eq!((timing.longest_pause.expect("a pause").0, stall.ns), (8 * MS, MS));
    assert!(stall.is_limited());
    assert_eq!((stall.whole_ns, stall.sets), (8 * MS, 1));
}

/// Silence in both directions while command frames wait is a stall. One cycle of it is normal and does not count.
#[test]
fn silence() {
    let mut run = Run::in_op(1, 1000);
    run.moves(0..100, 40, MS).pass(15 * MS).moves(100..200, 40, MS);
    let timing = run.found().timing;
    let stall = timing.stall(MS).expect("a stall");
    // The silence lasted 15 ms and half a cycle until the next report; the next write is 15 ms late as well.
    assert_eq!((stall.ns, stall.seen_by), (15 * MS, SeenBy::LateWrite));
    assert_eq!(timing.silences.longest_ns(), Some(15 * MS + MS / 2));
    let mut run = Run::in_op(1, 1000);
    for _ in 0..100 {
        run.pass(MS).op(50);
    }
    run.pass(15 * MS).op(0).pass(500 * MS).op(0);
    let stall = run.found().timing.stall(MS).expect("a stall");
    assert_eq!((stall.ns, stall.seen_by), (14 * MS, SeenBy::Silence));
}

/// `ahead=` covers the stall: at least the default, at most what the chip holds.
#[test]
fn sets_ahead() {
    let stalled = |drives, ms: i64| {
        let mut run = Run::in_op(drives, 1000);
        run.moves(0..100, 100, MS);
        for _ in 0..ms {
            run.pass(MS).op(50);
        }
        run.moves(100..200, 100, MS).found().plan.expect("a plan").ahead
    };
    let ahead = stalled(2, 0);
    assert_eq!((ahead.stall, ahead.is_known, ahead.value, &ahead.verdict), (None, true, 4, &Verdict::Yes));
    let ahead = stalled(2, 20);
    assert_eq!((ahead.stall_cycles, ahead.value), (20, 20));
    assert_eq!(ahead.verdict, Verdict::Differs(Row::Stall));
    let ahead = stalled(2, 90);
    assert_eq!((ahead.stall_cycles, ahead.value), (90, 60));
    assert!(matches!(ahead.verdict, Verdict::No { row: Row::Stall, .. }), "{ahead:?}");
    let ahead = stalled(40, 30);
    assert_eq!((ahead.value, ahead.verdict.word()), (21, "no"));
    // With a virtual clock, or without OP, nothing is known of the host's timing.
    let mut run = Run::in_op(2, 1000);
    run.moves(0..100, 100, MS).pass(50 * MS).moves(100..200, 100, MS);
    let setting = Setting { clock: Clock::Virtual, ..Setting::default() };
    let ahead = Migration::of(&run.survey, &setting).plan.expect("a plan").ahead;
    assert_eq!((ahead.stall, ahead.is_known, ahead.value), (None, false, 4));
}
