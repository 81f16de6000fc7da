//! Measures how many cycles later the answers of one run come than those of the other.

use std::collections::BTreeMap;

use super::steps::Step;

/// A command that was executed within this many cycles did not wait in the FIFO. If a command waited in both runs, its
/// time in the FIFO hides how long the boards take, and the command is not measured. \[OURS]
const AT_ONCE_CYCLES: u64 = 2;
/// A latency that differs by at most this many cycles counts as the same: the cycle of a report is known to within one
/// or two cycles. \[OURS]
const STEADY_CYCLES: u64 = 2;
/// How many consecutive commands have to show another latency before a new [`LatencyStretch`] begins. \[OURS]
const SURE_COMMANDS: usize = 5;
/// The maximum number of stretches that are kept. The last one then includes all later commands. \[OURS]
const STRETCHES_MAX: usize = 64;

/// How many cycles of the board run B answers later than run A; negative if earlier. A command is measured only if it did
/// not wait in the FIFO in at least one run. Commands that continue a motion are not measured, since programs send them
/// ahead and they wait in the FIFO.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// The number of commands whose latency was measured.
    pub commands: u64,
    /// The most frequent latency, in cycles. If several are equally frequent, the one nearest to 0. 0 if no command was
    /// measured.
    pub usual: i64,
    /// The smallest latency of a command: by how many cycles run B answers it later than run A; negative if earlier.
    pub least: i64,
    /// The largest latency of a command: by how many cycles run B answers it later than run A; negative if earlier.
    pub most: i64,
    /// The parts of the runs between changes of the latency. A new part begins when several consecutive commands differ
    /// by more than two cycles. At least one part, unless no command was measured.
    pub stretches: Vec<LatencyStretch>,
}

/// Consecutive commands with the same latency.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatencyStretch {
    /// The number of the first command of the stretch, from 1.
    pub from_command: u64,
    /// The most frequent latency in the stretch: how many cycles run B answers later.
    pub cycles: i64,
}

/// Measures the latency while the pairs of equal commands are read.
#[derive(Debug, Default)]
pub(super) struct LatencyFinder {
    shown: BTreeMap<i64, u64>,
    in_stretch: BTreeMap<i64, u64>,
    /// The last consecutive commands whose latency differs from the usual one of the current stretch.
    others: Vec<LatencyStretch>,
    stretches: Vec<LatencyStretch>,
    /// The latency of the newest command, until [`Self::late`] takes it.
    newest: Option<LatencyStretch>,
}

impl LatencyFinder {
    /// Processes the next two equal steps, one of each run.
    pub(super) fn pair(&mut self, a: &Step, b: &Step) {
        let (Some(after_a), Some(after_b)) = (a.answered_after, b.answered_after) else { return };
        if after_a.min(after_b) > AT_ONCE_CYCLES {
            return;
        }
        let cycles = i64::try_from(after_b).unwrap_or(i64::MAX).saturating_sub_unsigned(after_a);
        *self.shown.entry(cycles).or_default() += 1;
        self.newest = Some(LatencyStretch { from_command: a.number, cycles });
        let Some(usual) = usual(&self.in_stretch) else {
            self.begin(&[LatencyStretch { from_command: a.number, cycles }]);
            return;
        };
        if cycles.abs_diff(usual) <= STEADY_CYCLES {
            self.newest = self.stretches.last().map(|last| LatencyStretch { cycles, ..*last });
            for other in std::mem::take(&mut self.others) {
                *self.in_stretch.entry(other.cycles).or_default() += 1;
            }
            *self.in_stretch.entry(cycles).or_default() += 1;
            return;
        }
        if self.stretches.len() == STRETCHES_MAX {
            return;
        }
        self.others.push(LatencyStretch { from_command: a.number, cycles });
        if self.others.len() >= SURE_COMMANDS {
            let others = std::mem::take(&mut self.others);
            self.begin(&others);
        }
    }

    fn begin(&mut self, commands: &[LatencyStretch]) {
        self.close();
        self.in_stretch.clear();
        commands.iter().for_each(|command| *self.in_stretch.entry(command.cycles).or_default() += 1);
        self.stretches.extend(commands.first());
    }

    /// Sets the latency of the last stretch to the most frequent one of its commands.
    fn close(&mut self) {
        if let (Some(last), Some(cycles)) = (self.stretches.last_mut(), usual(&self.in_stretch)) {
            last.cycles = cycles;
        }
    }

    /// Returns the latency at the newest pair if it exceeds `allowed` cycles: the latency of the current stretch if
    /// enough commands have shown it, or else the latency of the newest command alone if it is too long to come from a
    /// report that was assigned to a wrong command.
    pub(super) fn late(&mut self, allowed: u64) -> Option<LatencyStretch> {
        let sure = self.in_stretch.values().sum::<u64>() >= SURE_COMMANDS as u64;
        let cycles = usual(&self.in_stretch).filter(|_| sure);
        let stretch = cycles.and_then(|cycles| self.stretches.last().map(|last| LatencyStretch { cycles, ..*last }));
        let is_late = |told: &LatencyStretch, allowed: u64| told.cycles.unsigned_abs() > allowed;
        let alone = self.newest.take().filter(|newest| is_late(newest, allowed.saturating_add(STEADY_CYCLES)));
        stretch.filter(|stretch| is_late(stretch, allowed)).or(alone)
    }

    /// The first stretch whose latency exceeds `allowed` cycles, once both runs have ended. It may consist of a few
    /// commands.
    pub(super) fn late_at_end(&mut self, allowed: u64) -> Option<LatencyStretch> {
        self.close();
        self.stretches.iter().find(|stretch| stretch.cycles.unsigned_abs() > allowed).copied()
    }

    pub(super) fn end(mut self) -> Latency {
        self.close();
        Latency {
            commands: self.shown.values().sum(),
            usual: usual(&self.shown).unwrap_or_default(),
            least: self.shown.keys().next().copied().unwrap_or_default(),
            most: self.shown.keys().next_back().copied().unwrap_or_default(),
            stretches: self.stretches,
        }
    }
}

/// The most frequent latency in `shown`, which has the number of commands for each latency. If several are equally
/// frequent, it is the one nearest to 0; for `n` and `-n` it is 0.
fn usual(shown: &BTreeMap<i64, u64>) -> Option<i64> {
    let most = shown.values().max()?;
    let mut usual: Option<i64> = None;
    for cycles in shown.iter().filter(|(_, count)| *count == most).map(|(cycles, _)| *cycles) {
        usual = match usual {
            Some(before) if before.abs() < cycles.abs() => Some(before),
            Some(before) if before == -cycles => Some(0),
            _ => Some(cycles),
        };
    }
    usual
}
