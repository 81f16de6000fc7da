//! Generated programs, each on both machines.

use std::ops::AddAssign;

use support::schedules;

use crate::judge::{self, Rule};
use crate::machine::Behind;
use crate::plan::Plan;
use crate::play::{Part, play};

/// Programs of the test; `cargo xtask soak` runs more.
const PROGRAMS: u64 = 30;
/// In that many cycles from the first target of a motion, one target may be late if a cycle is shorter than an exchange
/// (the row `cycle`).
const BEGIN: usize = 16;

/// Counts of the programs' events, so that the test fails if one never occurred.
#[derive(Debug, Default)]
struct Done {
    parts: u64,
    cycles: u64,
    refused: u64,
    /// Axes that moved without a stop.
    steady: u64,
}

impl AddAssign for Done {
    fn add_assign(&mut self, other: Self) {
        self.parts += other.parts;
        self.cycles += other.cycles;
        self.refused += other.refused;
        self.steady += other.steady;
    }
}

/// Differences of a part on the two machines beyond the allowed ones.
fn differences(board: &Part, chip: &Part) -> Vec<String> {
    let mut found = Vec::new();
    for (slave, rule) in (1..).zip(&board.rules) {
        found.extend(judge::same(&board.rows, &chip.rows, slave, *rule).err());
    }
    if !board.together.is_empty() {
        found.extend(judge::together(&board.rows, &chip.rows, &board.together).err());
    }
    let (mut a, mut b) = (board.saw.clone(), chip.saw.clone());
    for (n, rule) in board.rules.iter().enumerate() {
        if matches!(rule, Rule::CutBy(_)) {
            (a.slaves[n].2, b.slaves[n].2) = Default::default();
            (a.counted, b.counted) = Default::default();
        }
    }
    if a.counted[2].abs_diff(b.counted[2]) <= board.counts_apart {
        b.counted[2] = a.counted[2];
    }
    if let Some((slave, most)) = board.position_apart
        && a.slaves[slave - 1].2[0].abs_diff(b.slaves[slave - 1].2[0]) <= most
    {
        b.slaves[slave - 1].2 = a.slaves[slave - 1].2;
    }
    if a != b {
        found.push(format!("the program saw\n  {a:?}\n  {b:?}"));
    }
    found
}

/// These cycles without those at the begin, with the others moved forward accordingly.
fn behind(begin: usize, repeats: &[usize]) -> Vec<usize> {
    let early = repeats.iter().take_while(|cycle| **cycle < begin).count();
    repeats.iter().skip(early).map(|cycle| cycle - early).collect()
}

fn program(seed: u64) -> Done {
    let plan = Plan::random(seed);
    let board = play(&plan, Behind::Board);
    let chip = play(&plan, Behind::Chip { ahead: plan.ahead });
    let mut done = Done { refused: chip.refused.into(), ..Done::default() };
    assert!(!board.refused);
    assert!(!chip.refused || plan.cycle_us < 1000, "seed {seed}: {plan}");
    if !chip.refused {
        assert_eq!(board.parts.len(), chip.parts.len());
    }
    for (a, b) in board.parts.iter().zip(&chip.parts) {
        let found = differences(a, b);
        assert!(found.is_empty(), "seed {seed}: {plan}\nin {}\n{}", a.what, found.join("\n"));
        done.parts += 1;
        done.cycles += a.rows.len() as u64;
        for (slave, axis) in a.together.iter().filter(|_| a.is_steady) {
            let begin = if plan.cycle_us < 1000 { BEGIN } else { 0 };
            let repeats = [a, b].map(|part| judge::repeats(&part.rows, *slave, *axis));
            if repeats[0].first().is_some_and(|cycle| *cycle < begin) {
                // An axis that soon goes on at constant speed does not show the delay.
                continue;
            }
            let repeats = repeats.map(|repeats| behind(begin, &repeats));
            assert_eq!(repeats[1], repeats[0], "seed {seed}: {plan}\nslave {slave} stops in {}", a.what);
            done.steady += 1;
        }
    }
    done
}

/// XF-20.1 For any program each slave is sent the same outputs on both machines, and the program sees the same at the
/// end of each part, except for the table's rows.
#[test]
fn generated_programs() {
    let (programs, all) = schedules::run_all("migration", "generated_programs", PROGRAMS, program);
    if programs >= PROGRAMS {
        let run = programs - all.refused;
        assert!(all.parts >= 8 * run && all.cycles >= 1500 * run && all.steady >= run / 2, "{all:?}");
    }
}
