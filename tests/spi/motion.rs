//! The program's view: one report per cycle, a reliable free count, every frame executed once and in order.

use ecmsk::link::spi::ExchangeContent;
use ecmsk::sk::{CommandId, FifoAction, MasterCommand, MasterState};

use super::bench::{Answers, Bench, Setup};
use super::frames::{all, board, state, target};

/// The examples' loop, write two and read until the mark, drives all axes of a full network: each frame is
/// executed once, in order and without a gap, and none is lost.
#[test]
fn two_writes_then_reads_until_the_mark() {
    const COUNT: u32 = 400;
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { slaves: 40, answers, ..Setup::default() });
        let mut written = 0;
        while written < COUNT {
            bench.held.extend([target(40, written), target(40, written + 1)]);
            written += 2;
            bench.exchange(u64::MAX);
            while bench.free < 150 {
                bench.exchange(u64::MAX);
            }
        }
        bench.until(|bench| bench.free == 160);
        assert_eq!(bench.check(COUNT), 0, "{answers:?}");
    }
}

/// The free count is 160 minus the program's own entries, in the board or in the link: the link's entries are not
/// included, and entries shown as free were free.
#[test]
fn the_free_count_is_the_programs() {
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        // Only the link's own exchanges: always 160.
        for _ in 0..50 {
            bench.exchange(u64::MAX);
            assert_eq!(bench.free, 160);
        }
        for n in 0..40 {
            bench.held.push_back(target(1, n));
        }
        let mut executed = 0;
        while executed < 40 {
            bench.exchange(u64::MAX);
            let (indexes, _) = bench.targets();
            executed = indexes.len();
            let ahead = 40 - executed as u16;
            assert!(160 - bench.free >= ahead, "{answers:?}: {} free, {ahead} ahead", bench.free);
            assert!(160 - bench.free <= ahead + 4, "{answers:?}: {} free, {ahead} ahead", bench.free);
        }
        bench.until(|bench| bench.free == 160);
        assert_eq!(bench.targets().0.len(), 40);
    }
}

/// One report a cycle whether the program writes or not, in OP and before it, and one exchange for each.
#[test]
fn there_is_one_report_and_one_exchange_per_cycle() {
    let mut bench = Bench::new(Setup::default());
    let count = |bench: &mut Bench| {
        let (from, end) = (bench.begins.len(), bench.now + 200_000_000);
        while bench.exchange(end) {}
        bench.begins.len() - from
    };
    let before = count(&mut bench);
    assert!((199..=201).contains(&before), "{before}");
    for cycle_us in [250, 500, 2000, 4000] {
        let mut bench = Bench::on(Setup { cycle_us, ..Setup::default() });
        let expected = 200_000 / cycle_us as usize;
        let in_op = count(&mut bench);
        assert!(in_op.abs_diff(expected) <= 2, "{cycle_us}: {in_op}");
        // Back in PreOP the default cycle applies.
        bench.held.push_back(super::frames::to(MasterState::PreOp));
        bench.until(|bench| state(&bench.report) == Some(MasterState::PreOp));
        let after = count(&mut bench);
        assert!((198..=202).contains(&after), "{cycle_us}: {after}");
    }
}

/// With a starving host there is one cycle without a target between two targets each time; nothing is lost or
/// duplicated.
#[test]
fn a_host_that_starves_makes_gaps_and_loses_nothing() {
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        // Far enough ahead first, so that the rest is steady.
        for n in 0..600 {
            bench.held.push_back(target(1, n));
            let _ = bench.exchange(u64::MAX);
            if n % 3 == 0 {
                let status = |bench: &Bench| {
                    bench.begins.iter().filter(|(_, content)| *content == ExchangeContent::Status).count()
                };
                let before = status(&bench);
                bench.until(|bench| status(bench) > before);
            }
        }
        bench.until(|bench| bench.held.is_empty() && bench.free == 160);
        let gaps = bench.check(600);
        assert!((195..=205).contains(&gaps), "{answers:?}: {gaps}");
    }
}

/// SK-5.9 A program that sets a threshold fills the FIFO up to it as fast as the wires go, and keeps that level.
#[test]
fn a_program_that_prefills_by_itself_keeps_its_level() {
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        bench.held.push_back(board(&MasterCommand::SetFifo(FifoAction::Threshold(130))));
        let mut written = 0;
        let begin = bench.now;
        while written < 1000 {
            while bench.held.len() < 20 && written < 1000 {
                bench.held.push_back(target(1, written));
                written += 1;
            }
            bench.exchange(u64::MAX);
            if written == 45 {
                assert!(bench.now - begin < 15_000_000, "it is filled in {} ns", bench.now - begin);
            }
            if (200..980).contains(&written) {
                let level = 160 - bench.board.engine().fifo_free();
                assert!((29..=35).contains(&level), "{answers:?}: {level} at {written}");
            }
        }
        bench.until(|bench| bench.held.is_empty() && bench.free == 160);
        assert_eq!(bench.check(1000), 0, "{answers:?}");
    }
}

/// SK-5.8 SET_FIFO clear drops the board's entries; the pacer restarts.
#[test]
fn after_a_clear_the_level_is_low_again() {
    let mut bench = Bench::on(Setup::default());
    bench.held.push_back(board(&MasterCommand::SetFifo(FifoAction::Threshold(100))));
    (0..50).for_each(|n| bench.held.push_back(target(1, n)));
    bench.until(|bench| bench.held.is_empty());
    bench.held.push_back(board(&MasterCommand::SetFifo(FifoAction::Clear)));
    bench.held.push_back(all(1, CommandId::Csp, 251, 0));
    bench.until(|bench| bench.free == 160);
    assert_eq!(bench.targets().0.last(), Some(&251));
    for _ in 0..100 {
        bench.exchange(u64::MAX);
        let level = 160 - bench.board.engine().fifo_free();
        assert!(level <= 4, "{level}");
    }
}
