//! What a CRC-32 covers, in each direction. Nothing on the wire says it, but a packet's length is known, so that it is found by
//! trying: an answer whose check word is right shows it for answers, a command that the chip runs shows it for commands.

use crate::xf::{Coverage, Coverages, DataSize};

/// Packets of the start that the chip may reject for their check word until CRC-32 is given up. \[OURS] Each coverage has three
/// tries, so that a bit that flips on the wire does not decide.
const REJECTIONS_MAX: u32 = 3 * Coverage::EVERY.len() as u32;
/// Answers one after the other that no coverage fits, before any has fitted, until CRC-32 is given up. \[OURS] Fewer than the
/// damaged answers behind which packets are searched.
const UNFIT_MAX: u32 = 4;

/// The coverages that are possible, in the order of [`Coverage::EVERY`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Candidates([bool; Coverage::EVERY.len()]);

impl Candidates {
    const EVERY: Self = Self([true; Coverage::EVERY.len()]);

    fn one(coverage: Coverage) -> Self {
        Self(Coverage::EVERY.map(|other| other == coverage))
    }

    fn iter(self) -> impl Iterator<Item = Coverage> {
        Coverage::EVERY.into_iter().zip(self.0).filter_map(|(coverage, is_possible)| is_possible.then_some(coverage))
    }

    fn first(self) -> Coverage {
        self.iter().next().unwrap_or_default()
    }

    /// Those stay that cover as much of such a packet as `right` does.
    fn keep_as(&mut self, right: Coverage, size: DataSize, len: u16) {
        let fits = Coverage::EVERY.map(|coverage| coverage.bytes(size, len) == right.bytes(size, len));
        self.0 = core::array::from_fn(|n| self.0[n] && fits[n]);
    }
}

/// What is known of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoverageSearch {
    answers: Candidates,
    commands: Candidates,
    /// An answer with a CRC-32 was right.
    answers_fit: bool,
    /// A command with a CRC-32 was run.
    commands_fit: bool,
    /// What is tried after a rejection.
    trying: Option<Coverage>,
    rejections: u32,
    unfit: u32,
}

impl CoverageSearch {
    /// `given`: nothing is to be found.
    pub(super) fn new(given: Option<Coverages>) -> Self {
        Self {
            answers: given.map_or(Candidates::EVERY, |given| Candidates::one(given.answers)),
            commands: given.map_or(Candidates::EVERY, |given| Candidates::one(given.commands)),
            answers_fit: false,
            commands_fit: false,
            trying: None,
            rejections: 0,
            unfit: 0,
        }
    }

    /// The best guess for commands: what answers have, if that is possible, and another one after each rejection.
    pub(super) fn of_commands(&self) -> Coverage {
        let as_answers = || self.commands.iter().find(|coverage| self.answers.iter().any(|other| other == *coverage));
        self.trying.or_else(as_answers).unwrap_or(self.commands.first())
    }

    /// Those that answers may have, the likeliest first.
    pub(super) fn of_answers(&self) -> impl Iterator<Item = Coverage> + use<> {
        self.answers.iter()
    }

    /// What is taken for it.
    pub(super) fn coverages(&self) -> Coverages {
        Coverages { commands: self.of_commands(), answers: self.answers.first() }
    }

    /// Whether it is open for commands, and a command of another length would show it.
    pub(super) fn is_open(&self) -> bool {
        self.commands.iter().count() > 1
    }

    /// Whether a command with a CRC-32 was run.
    pub(super) const fn commands_fit(&self) -> bool {
        self.commands_fit
    }

    /// Whether answers tell nothing more.
    pub(super) fn answers_are_known(&self) -> bool {
        self.answers_fit && self.answers.iter().count() == 1
    }

    /// The check word of an answer is right with that coverage.
    pub(super) fn answer_fits(&mut self, coverage: Coverage, size: DataSize, len: u16) {
        self.answers.keep_as(coverage, size, len);
        (self.answers_fit, self.unfit) = (true, 0);
    }

    /// An answer's CRC-32 is wrong with every coverage. Whether it is to be given up.
    pub(super) const fn answer_is_unfit(&mut self) -> bool {
        self.unfit += 1;
        !self.answers_fit && self.unfit >= UNFIT_MAX
    }

    /// The chip has run a command whose CRC-32 had that coverage.
    pub(super) fn command_ran(&mut self, used: Coverage, size: DataSize, len: u16) {
        self.commands.keep_as(used, size, len);
        (self.trying, self.commands_fit, self.rejections) = (None, true, 0);
    }

    /// The chip has rejected one with that coverage. Whether CRC-32 is to be given up; otherwise another coverage is the best guess now.
    pub(super) fn command_is_rejected(&mut self, used: Coverage) -> bool {
        let behind = || self.commands.iter().skip_while(move |coverage| *coverage != used).skip(1);
        self.trying = behind().chain(self.commands.iter()).next();
        self.rejections += 1;
        self.rejections >= REJECTIONS_MAX
    }
}
