//! Finds which bytes a CRC-32 covers, in each direction. No packet says which bytes these are, but the length of a
//! packet is known, so the driver tries the possible coverages. An answer with a valid check word shows the coverage of
//! answers; a command that the chip runs shows the coverage of commands.

use crate::xf::{CrcCoverage, CrcCoverages, DataSize};

/// How many packets the chip may reject for their check word during its start before CRC-32 is given up. \[OURS] Each
/// coverage has three tries, so that a single bit error on the wire does not decide.
const REJECTIONS_MAX: u32 = 3 * CrcCoverage::EVERY.len() as u32;
/// Number of answers in a row with a wrong CRC-32 under every coverage after which CRC-32 is given up, as long as no
/// answer has fitted any coverage. \[OURS] It is less than the 8 damaged answers in a row that start a search for
/// packets by default: such a search would not help, since start words and end words are right.
const UNFIT_MAX: u32 = 4;

/// The coverages that are still possible, as flags in the order of [`CrcCoverage::EVERY`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Candidates([bool; CrcCoverage::EVERY.len()]);

impl Candidates {
    const EVERY: Self = Self([true; CrcCoverage::EVERY.len()]);

    fn one(coverage: CrcCoverage) -> Self {
        Self(CrcCoverage::EVERY.map(|other| other == coverage))
    }

    fn iter(self) -> impl Iterator<Item = CrcCoverage> {
        CrcCoverage::EVERY.into_iter().zip(self.0).filter_map(|(coverage, is_possible)| is_possible.then_some(coverage))
    }

    fn first(self) -> CrcCoverage {
        self.iter().next().unwrap_or_default()
    }

    /// Keeps the coverages that include the same bytes as `right` in a packet of this size and length, and rules out
    /// the others.
    fn keep_as(&mut self, right: CrcCoverage, size: DataSize, len: u16) {
        let fits = CrcCoverage::EVERY.map(|coverage| coverage.bytes(size, len) == right.bytes(size, len));
        self.0 = core::array::from_fn(|n| self.0[n] && fits[n]);
    }
}

/// The coverages that are still possible for answers and for commands.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoverageSearch {
    answers: Candidates,
    commands: Candidates,
    /// Whether an answer with a CRC-32 was valid.
    answers_fit: bool,
    /// Whether the chip has run a command with a CRC-32.
    commands_fit: bool,
    /// The coverage to try next for commands, once the chip has rejected another one.
    trying: Option<CrcCoverage>,
    rejections: u32,
    unfit: u32,
}

impl CoverageSearch {
    /// Starts a search; with `given` the coverages are known and nothing is searched.
    pub(super) fn new(given: Option<CrcCoverages>) -> Self {
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

    /// The best guess for commands: the coverage of answers if that is possible, and another one after each rejection.
    pub(super) fn of_commands(&self) -> CrcCoverage {
        let as_answers = || self.commands.iter().find(|coverage| self.answers.iter().any(|other| other == *coverage));
        self.trying.or_else(as_answers).unwrap_or(self.commands.first())
    }

    /// The possible coverages of answers, the most likely first.
    pub(super) fn of_answers(&self) -> impl Iterator<Item = CrcCoverage> + use<> {
        self.answers.iter()
    }

    /// The coverages to use now, for commands and for answers: those found, otherwise the best guesses.
    pub(super) fn coverages(&self) -> CrcCoverages {
        CrcCoverages { commands: self.of_commands(), answers: self.answers.first() }
    }

    /// Whether several coverages are still possible for commands. A command of another length may then decide, since the
    /// coverages include different bytes of it.
    pub(super) fn is_open(&self) -> bool {
        self.commands.iter().count() > 1
    }

    /// Whether a command with a CRC-32 was run.
    pub(super) const fn commands_fit(&self) -> bool {
        self.commands_fit
    }

    /// Whether the coverage of answers is known, so that further answers show nothing new.
    pub(super) fn answers_are_known(&self) -> bool {
        self.answers_fit && self.answers.iter().count() == 1
    }

    /// Records that the check word of an answer is valid with that coverage.
    pub(super) fn answer_fits(&mut self, coverage: CrcCoverage, size: DataSize, len: u16) {
        self.answers.keep_as(coverage, size, len);
        (self.answers_fit, self.unfit) = (true, 0);
    }

    /// Records that an answer's CRC-32 is wrong with every coverage. Returns whether CRC-32 is to be given up.
    pub(super) const fn answer_is_unfit(&mut self) -> bool {
        self.unfit += 1;
        !self.answers_fit && self.unfit >= UNFIT_MAX
    }

    /// Records that the chip has run a command whose CRC-32 had that coverage.
    pub(super) fn command_ran(&mut self, used: CrcCoverage, size: DataSize, len: u16) {
        self.commands.keep_as(used, size, len);
        (self.trying, self.commands_fit, self.rejections) = (None, true, 0);
    }

    /// Records that the chip has rejected a command with that coverage. Returns whether CRC-32 is to be given up;
    /// otherwise the next coverage is now the best guess.
    pub(super) fn command_is_rejected(&mut self, used: CrcCoverage) -> bool {
        let behind = || self.commands.iter().skip_while(move |coverage| *coverage != used).skip(1);
        self.trying = behind().chain(self.commands.iter()).next();
        self.rejections += 1;
        self.rejections >= REJECTIONS_MAX
    }
}
