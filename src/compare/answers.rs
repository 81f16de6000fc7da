//! What of two answers to the same command is not equal.

use super::difference::What;
use super::steps::{Answer, Step};
use super::{Options, Side};
use crate::cia402::Statusword;
use crate::sk::dump::SlaveData;
use crate::sk::{HspAxis, SdoCommand, SdoResponse};

/// All that differs in the answers of two steps, the board's own first, then by slave; nothing where one has no answer.
/// Whether commands were lost is known without.
pub fn differences(a: &Step, b: &Step, options: &Options) -> Vec<What> {
    let mut found = Vec::new();
    if a.lost != b.lost {
        found.push(What::Lost { side: if a.lost { Side::A } else { Side::B } });
    }
    let (Some(answer_a), Some(answer_b)) = (&a.answer, &b.answer) else { return found };
    let boards = [answer_a.board(), answer_b.board()];
    if boards[0].state != boards[1].state {
        // What slaves say is of a state.
        found.push(What::State { states: boards.map(|board| board.state) });
        return found;
    }
    if boards[0].result != boards[1].result {
        found.push(What::Result { results: boards.map(|board| board.result) });
    }
    if !answer_a.is_op() {
        return found;
    }
    for slave in 1..=a.size.max_slaves() as u8 {
        slaves(slave, answer_a, answer_b, options, &mut found);
    }
    // A fault that is gone again; one that still shows was told.
    for (side, mine, others) in [(Side::A, &a.faults, &b.faults), (Side::B, &b.faults, &a.faults)] {
        for (slave, error_code) in mine.iter().copied() {
            let told = found.iter().any(|what| what.slave() == Some(slave));
            if !told && !others.contains(&(slave, error_code)) {
                found.push(What::Fault { slave, side, error_code });
            }
        }
    }
    found
}

fn slaves(slave: u8, a: &Answer, b: &Answer, options: &Options, found: &mut Vec<What>) {
    let statuswords = |words: [Statusword; 2]| {
        let differ = (words[0].0 ^ words[1].0) & options.statusword_mask != 0;
        differ.then_some(What::Statusword { slave, words })
    };
    let positions = |axis: u8, counts: [i32; 2]| {
        let far = counts[0].abs_diff(counts[1]) > options.tolerance_counts;
        far.then_some(What::Position { slave, axis, counts })
    };
    let inputs = |bits: [u16; 2]| (bits[0] != bits[1]).then_some(What::Inputs { slave, bits });
    match (a.slave(slave), b.slave(slave)) {
        (SlaveData::Drive(a), SlaveData::Drive(b)) => {
            let codes = [a.error_code, b.error_code];
            found.extend(statuswords([a.statusword, b.statusword]));
            found.extend((codes[0] != codes[1]).then_some(What::ErrorCode { slave, codes }));
            found.extend(positions(1, [a.position, b.position]));
        }
        (SlaveData::Hsp(a), SlaveData::Hsp(b)) => {
            let axes = |of: fn(&HspAxis) -> i32| [[of(&a.first), of(&b.first)], [of(&a.second), of(&b.second)]];
            found.extend(statuswords([a.statusword, b.statusword]));
            found.extend((1..).zip(axes(|axis| axis.position)).filter_map(|(n, counts)| positions(n, counts)));
            found.extend(axes(|axis| axis.inputs.into()).into_iter().filter_map(|bits| inputs(bits.map(|n| n as u16))));
        }
        // What the bits are, inputs or outputs, goes by the command answered, and that by how often was polled.
        (SlaveData::Io(io_a), SlaveData::Io(io_b)) if io_a.head.id == io_b.head.id => {
            found.extend(inputs([io_a.bits, io_b.bits]));
        }
        (SlaveData::Io(_), SlaveData::Io(_)) => {}
        (data_a, data_b) => {
            let differ = std::mem::discriminant(&data_a) != std::mem::discriminant(&data_b);
            found.extend(differ.then_some(What::Kind { slave }));
        }
    }
}

/// The transfer that both programs wait for, and whether its answers have been compared: they come when they come, at
/// one of the steps before the next transfer.
#[derive(Debug, Default)]
pub struct Transfer {
    request: Option<SdoCommand>,
    seen: [Option<SdoResponse>; 2],
}

impl Transfer {
    /// Two equal steps: what is different in answers, each told once, and whether one answer never came.
    pub fn steps(&mut self, a: &Step, b: &Step) -> Vec<What> {
        let mut found = Vec::new();
        if let Some(request) = a.sdo() {
            found.extend(self.end());
            *self = Self { request: Some(request), seen: [None; 2] };
        }
        let Some(request) = self.request else { return found };
        let both = self.seen.iter().all(Option::is_some);
        for (seen, step) in self.seen.iter_mut().zip([a, b]) {
            let answer = step.answer.as_ref().map(Answer::sdo).filter(|answer| is_answer(&request, answer));
            *seen = seen.or(answer);
        }
        if let [Some(a), Some(b)] = self.seen
            && !both
            && a != b
        {
            found.push(What::Sdo { answers: [a, b] });
        }
        found
    }

    /// There is no more: an answer that came in one run alone.
    pub fn end(&mut self) -> Option<What> {
        let request = self.request.take()?;
        let side = match self.seen {
            [Some(_), None] => Side::B,
            [None, Some(_)] => Side::A,
            _ => return None,
        };
        Some(What::NoSdoAnswer { side, request })
    }
}

fn is_answer(request: &SdoCommand, answer: &SdoResponse) -> bool {
    let (SdoResponse::Done { id, slave, object, .. } | SdoResponse::Aborted { id, slave, object, .. }) = *answer else {
        return false;
    };
    match *request {
        SdoCommand::Read { slave: asked, object: of } | SdoCommand::Write { slave: asked, object: of, .. } => {
            request.id() == id && asked == slave && of == object
        }
        SdoCommand::GetStatus | SdoCommand::Other(_) => false,
    }
}
