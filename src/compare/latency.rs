//! By how many cycles the answers of one run come later than those of the other.

use std::collections::BTreeMap;

use super::steps::Step;

/// A command that was executed within so many cycles did not wait behind others. What waits in both runs is answered later in
/// neither. \[OURS]
const AT_ONCE_CYCLES: u64 = 2;
/// Fewer cycles more or less are no other latency: which cycle a report is of is known to a cycle or two. \[OURS]
const STEADY_CYCLES: u64 = 2;
/// After so many commands in a row with another latency it is one. \[OURS]
const SURE_COMMANDS: usize = 5;
/// How many stretches are kept; where there are more the last one goes on. \[OURS]
const STRETCHES_MAX: usize = 64;

/// By how many cycles of the board run B answers later than run A; negative numbers: sooner. Commands count that did not have to
/// wait behind others in one of the runs, and do not go on with a motion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// How many commands tell.
    pub commands: u64,
    /// That of most commands; of several the one nearest to 0. 0 if no command tells.
    pub usual: i64,
    /// That of the command that B answers soonest, in comparison.
    pub least: i64,
    /// That of the command that B answers latest, in comparison.
    pub most: i64,
    /// Where it changes, for several commands in a row and by more than two cycles: the stretches of the runs with one latency,
    /// at least one if a command tells.
    pub stretches: Vec<LatencyStretch>,
}

/// Commands in a row that are answered so many cycles later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatencyStretch {
    /// The number of the first command, from 1.
    pub from_command: u64,
    /// By how many cycles run B answers later, which most of its commands show.
    pub cycles: i64,
}

/// Finds the latency, while pairs of equal commands go by.
#[derive(Debug, Default)]
pub(super) struct LatencyFinder {
    shown: BTreeMap<i64, u64>,
    in_stretch: BTreeMap<i64, u64>,
    /// Commands in a row with another latency than that of the stretch.
    others: Vec<LatencyStretch>,
    stretches: Vec<LatencyStretch>,
    /// What the newest command has told, until it is asked for.
    newest: Option<LatencyStretch>,
}

impl LatencyFinder {
    /// The next two equal steps.
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

    /// The stretch so far has the latency of most of its commands.
    fn close(&mut self) {
        if let (Some(last), Some(cycles)) = (self.stretches.last_mut(), usual(&self.in_stretch)) {
            last.cycles = cycles;
        }
    }

    /// The latency that the newest pair has shown to be of more cycles than these: that of the stretch that goes on, once it is sure,
    /// or of one command alone, if it is more by so much that no report can be taken for another one.
    pub(super) fn late(&mut self, allowed: u64) -> Option<LatencyStretch> {
        let sure = self.in_stretch.values().sum::<u64>() >= SURE_COMMANDS as u64;
        let cycles = usual(&self.in_stretch).filter(|_| sure);
        let stretch = cycles.and_then(|cycles| self.stretches.last().map(|last| LatencyStretch { cycles, ..*last }));
        let is_late = |told: &LatencyStretch, allowed: u64| told.cycles.unsigned_abs() > allowed;
        let alone = self.newest.take().filter(|newest| is_late(newest, allowed.saturating_add(STEADY_CYCLES)));
        stretch.filter(|stretch| is_late(stretch, allowed)).or(alone)
    }

    /// The first stretch of more cycles than these, when both runs have ended: one of a few commands, which are all that tell.
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

/// What most commands have shown; of several the one nearest to 0, and 0 if there is one on either side.
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
