//! Finds the differences between two answers to the same command.

use super::difference::Deviation;
use super::report::BoardReport;
use super::steps::Step;
use super::{AT_REST_REPORTS, CompareOptions, Side};
use crate::ethercat::cia402::Statusword;
use crate::sk::dump::SlaveData;
use crate::sk::{HspAxis, SdoCommand, SdoResponse};

/// All differences between the answers to a command, given as its step in each run: those of slot 0 first, then by slave.
/// If the command has no answer in one run, only lost commands and faults are compared.
pub fn differences(a: &Step, b: &Step, options: &CompareOptions) -> Vec<Deviation> {
    let mut found = Vec::new();
    if a.lost != b.lost {
        found.push(Deviation::Lost { side: if a.lost { Side::A } else { Side::B } });
    }
    if let (Some(answer_a), Some(answer_b)) = (&a.answer, &b.answer) {
        answer_differences(a.size.max_slaves() as u8, answer_a, answer_b, options, &mut found);
        rest_differences(a, b, options, &mut found);
    }
    // A fault may have been reset before the last report of the step, so the faults of all its reports are compared.
    for (side, faults, faults_of_other) in [(Side::A, &a.faults, &b.faults), (Side::B, &b.faults, &a.faults)] {
        for (slave, error_code) in faults.iter().copied() {
            if !faults_of_other.contains(&(slave, error_code)) {
                found.push(Deviation::Fault { slave, side, error_code });
            }
        }
    }
    found
}

fn answer_differences(
    slaves: u8,
    a: &BoardReport,
    b: &BoardReport,
    options: &CompareOptions,
    found: &mut Vec<Deviation>,
) {
    let boards = [a.board(), b.board()];
    if boards[0].state != boards[1].state {
        // The meaning of the slaves' slots depends on the state, so slots of different states are not compared.
        found.push(Deviation::State { states: boards.map(|board| board.state) });
        return;
    }
    if boards[0].result != boards[1].result {
        found.push(Deviation::Result { results: boards.map(|board| board.result) });
    }
    if a.is_op() {
        for slave in 1..=slaves {
            slave_differences(slave, a, b, options, found);
        }
    }
}

/// If the command made the network leave OP in both runs, compares the positions of axes at rest in the last reports of
/// OP, and adds the differences.
fn rest_differences(a: &Step, b: &Step, options: &CompareOptions, found: &mut Vec<Deviation>) {
    let has_left = |step: &Step| step.answer.as_ref().is_some_and(|answer| !answer.is_op());
    if !(has_left(a) && has_left(b)) {
        return;
    }
    let [Some(a), Some(b)] = [a, b].map(|step| step.kept.iter().rev().find(|report| report.is_op())) else { return };
    for slave in 1..=a.size.max_slaves() as u8 {
        let stands = [a, b].iter().all(|report| report.unchanged_reports(slave) >= AT_REST_REPORTS);
        let mut differs = Vec::new();
        slave_differences(slave, a, b, options, &mut differs);
        found.extend(differs.into_iter().filter(|what| stands && matches!(what, Deviation::Position { .. })));
    }
}

/// Whether two reports show the same for a slave, in the values that `options` compares.
pub fn is_same(slave: u8, a: &BoardReport, b: &BoardReport, options: &CompareOptions) -> bool {
    let mut found = Vec::new();
    slave_differences(slave, a, b, options, &mut found);
    found.is_empty()
}

/// Adds the differences of a slave between two reports of OP to `found`.
pub fn slave_differences(
    slave: u8,
    a: &BoardReport,
    b: &BoardReport,
    options: &CompareOptions,
    found: &mut Vec<Deviation>,
) {
    if a.shows_the_same(b, slave) {
        return;
    }
    let statuswords = |words: [Statusword; 2]| {
        let differ = (words[0].0 ^ words[1].0) & options.statusword_mask != 0;
        differ.then_some(Deviation::Statusword { slave, words })
    };
    let positions = |axis: u8, counts: [i32; 2]| {
        let far = counts[0].abs_diff(counts[1]) > options.tolerance_counts;
        far.then_some(Deviation::Position { slave, axis, counts })
    };
    let inputs = |bits: [u16; 2]| (bits[0] != bits[1]).then_some(Deviation::Inputs { slave, bits });
    match (a.slave(slave), b.slave(slave)) {
        (SlaveData::Drive(a), SlaveData::Drive(b)) => {
            let codes = [a.error_code, b.error_code];
            found.extend(statuswords([a.statusword, b.statusword]));
            found.extend((codes[0] != codes[1]).then_some(Deviation::ErrorCode { slave, codes }));
            found.extend(positions(1, [a.position, b.position]));
        }
        (SlaveData::Hsp(a), SlaveData::Hsp(b)) => {
            let axes = |of: fn(&HspAxis) -> i32| [[of(&a.first), of(&b.first)], [of(&a.second), of(&b.second)]];
            found.extend(statuswords([a.statusword, b.statusword]));
            found.extend((1..).zip(axes(|axis| axis.position)).filter_map(|(n, counts)| positions(n, counts)));
            found.extend(axes(|axis| axis.inputs.into()).into_iter().filter_map(|bits| inputs(bits.map(|n| n as u16))));
        }
        // Whether the bits are inputs or outputs depends on the command that the report answers. Which one that is
        // depends on timing, so bits of different commands are not compared.
        (SlaveData::Io(io_a), SlaveData::Io(io_b)) if io_a.head.id == io_b.head.id => {
            found.extend(inputs([io_a.bits, io_b.bits]));
        }
        (SlaveData::Io(_), SlaveData::Io(_)) => {}
        (data_a, data_b) => {
            let differ = std::mem::discriminant(&data_a) != std::mem::discriminant(&data_b);
            found.extend(differ.then_some(Deviation::Kind { slave }));
        }
    }
}

/// The SDO transfer that both programs have requested last, with the answers to it. An answer may come with any step
/// until the next transfer, so the answers are compared once both have come.
#[derive(Debug, Default)]
pub struct SdoComparison {
    request: Option<SdoCommand>,
    answers: [Option<SdoResponse>; 2],
}

impl SdoComparison {
    /// Processes the next two equal steps, one of each run. Returns a difference between the two answers to the present
    /// transfer when both are known. If the steps begin another transfer, also returns a difference if only one run has
    /// answered the transfer before.
    pub fn steps(&mut self, a: &Step, b: &Step) -> Vec<Deviation> {
        let mut found = Vec::new();
        if let Some(request) = a.sdo() {
            found.extend(self.end());
            *self = Self { request: Some(request), answers: [None; 2] };
        }
        let Some(request) = self.request else { return found };
        let were_compared = self.answers.iter().all(Option::is_some);
        for (known, step) in self.answers.iter_mut().zip([a, b]) {
            let answer = step.answer.as_ref().map(BoardReport::sdo).filter(|answer| is_answer(&request, answer));
            *known = known.or(answer);
        }
        if let [Some(a), Some(b)] = self.answers
            && !were_compared
            && a != b
        {
            found.push(Deviation::Sdo { answers: [a, b] });
        }
        found
    }

    /// Ends the transfer. Returns a difference if only one run answered it.
    pub fn end(&mut self) -> Option<Deviation> {
        let request = self.request.take()?;
        let side = match self.answers {
            [Some(_), None] => Side::B,
            [None, Some(_)] => Side::A,
            _ => return None,
        };
        Some(Deviation::NoSdoAnswer { side, request })
    }
}

fn is_answer(request: &SdoCommand, answer: &SdoResponse) -> bool {
    let (SdoResponse::Done { id, slave, object, .. } | SdoResponse::Aborted { id, slave, object, .. }) = *answer else {
        return false;
    };
    request.id() == id && request.target() == Some((slave, object))
}
