//! What a program may have seen in the reports of a board, and may therefore have waited for.

use crate::compare::AT_REST_REPORTS;
use crate::ethercat::cia402::Statusword;
use crate::recording::Kinds;
use crate::sk::dump::{MAX_SLAVES, ResponseDump, SlaveData, SlotMeaning};
use crate::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, MasterState, SdoResponse, SlotSize, StateByte};

/// The bits of a statusword that show the progress of homing.
const HOMING_BITS: u16 = Statusword::BIT12 | Statusword::BIT13;
/// How many more entries the model's FIFO may have than the recorded one. A model over an ECM-XF counts entries that
/// are in flight to the chip as well. \[OURS]
const ON_THE_WAY: u16 = 12;

/// The state of a board as its newest reports show it.
#[derive(Clone, Debug)]
pub struct ObservedBoard {
    size: SlotSize,
    kinds: Kinds,
    state: Option<StateByte>,
    sdo: Option<SdoResponse>,
    fifo_free: u16,
    /// The number of reports since the newest command. From [`AT_REST_REPORTS`] on an empty FIFO counts as at rest, and the
    /// model's FIFO has to be empty, too.
    reports_since_command: u16,
    slaves: [ObservedSlave; MAX_SLAVES],
}

/// The state of a slave as the newest reports show it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct ObservedSlave {
    statusword: Option<Statusword>,
    positions: [i32; 2],
    /// The number of reports in a row that show the same positions. From [`AT_REST_REPORTS`] on the axes count as at rest,
    /// and those of the model have to be at rest, too.
    still: u16,
    /// The inputs of an IO slave, and the command that its slot answers.
    inputs: Option<(CommandId, u16)>,
    is_homing: bool,
}

impl ObservedBoard {
    pub(super) fn new(size: SlotSize) -> Self {
        let (kinds, slaves) = (Kinds::new(None), [ObservedSlave::default(); MAX_SLAVES]);
        Self { size, kinds, state: None, sdo: None, fifo_free: FIFO_ENTRIES, reports_since_command: 0, slaves }
    }

    /// Updates the state from a command frame that the host sends.
    pub(super) fn command(&mut self, frame: &Frame) {
        self.kinds.command(frame, self.size);
        self.reports_since_command = 0;
        for (slave, observed) in (1..=self.size.max_slaves()).zip(&mut self.slaves) {
            match CommandId::from_code(frame.slot(self.size, slave).id) {
                CommandId::GoHome => observed.is_homing = true,
                id if id.is_motion() || id == CommandId::AbortHome => observed.is_homing = false,
                _ => {}
            }
        }
    }

    /// Updates the state from the next report.
    pub(super) fn report(&mut self, frame: &Frame) {
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        self.state = Some(board.state);
        self.sdo = Some(SdoResponse::decode(&frame.slot(self.size, self.size.sdo_slot())));
        self.reports_since_command = self.reports_since_command.saturating_add(1);
        if board.state.state() != Some(MasterState::Op) {
            self.fifo_free = FIFO_ENTRIES;
            self.slaves = [ObservedSlave::default(); MAX_SLAVES];
            return;
        }
        self.fifo_free = board.fifo_free;
        let kinds = std::array::from_fn::<_, MAX_SLAVES, _>(|n| self.kinds.of(n + 1).unwrap_or_default());
        let dump = ResponseDump::new(frame, self.size).kinds(&kinds);
        for (slave, observed) in (1..=self.size.max_slaves()).zip(&mut self.slaves) {
            if frame.slot(self.size, slave).is_zero() {
                continue;
            }
            let Some(SlotMeaning::SlaveResponse(reading)) = dump.line(slave).map(|line| line.meaning) else { continue };
            let (statusword, positions, inputs) = match reading.data {
                SlaveData::Drive(drive) => (Some(drive.statusword), [drive.position, 0], None),
                SlaveData::Hsp(hsp) => (Some(hsp.statusword), [hsp.first.position, hsp.second.position], None),
                SlaveData::Io(io) => (None, [0; 2], Some((CommandId::from_code(io.head.id), io.bits))),
                _ => continue,
            };
            let still = if observed.positions == positions { observed.still.saturating_add(1) } else { 0 };
            *observed = ObservedSlave { statusword, positions, still, inputs, is_homing: observed.is_homing };
        }
    }
}

/// Something that the recorded board has shown and the model has not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Missing {
    State,
    Sdo,
    Fifo,
    /// A slave, by its index from 0.
    Slave(usize),
}

impl Missing {
    pub(super) const fn is_state(self) -> bool {
        matches!(self, Self::State)
    }
}

/// Checks whether the model shows everything that the recorded board has shown. The caller can give up a difference
/// that stays for too long. That difference is then ignored until recorded board and model agree again.
#[derive(Clone, Debug, Default)]
pub(super) struct Agreement {
    given_up: Vec<Missing>,
}

impl Agreement {
    /// The first thing that the model does not show yet; differences that were given up are left out. `None`: there is
    /// nothing to wait for.
    pub(super) fn missing(&mut self, recorded: &ObservedBoard, model: &ObservedBoard) -> Option<Missing> {
        // As long as the recorded program had not read a report, it could not wait for anything.
        recorded.state?;
        let board = [(Missing::State, agree_on_state(recorded, model)), (Missing::Sdo, agree_on_sdo(recorded, model))];
        let fifo = (Missing::Fifo, agree_on_fifo(recorded, model));
        let slaves = recorded.slaves.iter().zip(&model.slaves).enumerate();
        let slaves = slaves.map(|(place, (recorded, model))| (Missing::Slave(place), agree_on_slave(recorded, model)));
        let mut first = None;
        for (what, agrees) in board.into_iter().chain([fifo]).chain(slaves) {
            if agrees {
                self.given_up.retain(|given_up| *given_up != what);
            } else if first.is_none() && !self.given_up.contains(&what) {
                first = Some(what);
            }
        }
        first
    }

    pub(super) fn give_up(&mut self, what: Missing) {
        self.given_up.push(what);
    }
}

fn agree_on_state(recorded: &ObservedBoard, model: &ObservedBoard) -> bool {
    recorded.state == model.state
}

/// Whether the model shows the answer to the same SDO request as the recorded board.
fn agree_on_sdo(recorded: &ObservedBoard, model: &ObservedBoard) -> bool {
    let asked = |sdo: &Option<SdoResponse>| match *sdo {
        Some(SdoResponse::Done { id, slave, object, .. } | SdoResponse::Aborted { id, slave, object, .. }) => {
            Some((id, slave, object))
        }
        _ => None,
    };
    asked(&recorded.sdo).is_none_or(|wanted| asked(&model.sdo) == Some(wanted))
}

/// Whether the model's FIFO has at most as many entries as the recorded one, plus those in flight to a chip. If the
/// recorded FIFO was empty and the program had not written for a while, the model's FIFO has to be empty, too.
fn agree_on_fifo(recorded: &ObservedBoard, model: &ObservedBoard) -> bool {
    let is_at_rest = recorded.fifo_free >= FIFO_ENTRIES && recorded.reports_since_command >= AT_REST_REPORTS;
    let allowed = if is_at_rest { 0 } else { ON_THE_WAY };
    model.fifo_free.saturating_add(allowed) >= recorded.fifo_free
}

fn agree_on_slave(recorded: &ObservedSlave, model: &ObservedSlave) -> bool {
    let word = |observed: &ObservedSlave| {
        let bits = if observed.is_homing { Statusword::STATE_BITS | HOMING_BITS } else { Statusword::STATE_BITS };
        observed.statusword.map(|word| word.0 & bits)
    };
    let stands = recorded.still < AT_REST_REPORTS || model.still >= AT_REST_REPORTS;
    word(recorded) == word(model) && stands && agree_on_inputs(recorded, model)
}

/// Whether an IO slave shows the same inputs, if both slots answer the same command.
fn agree_on_inputs(recorded: &ObservedSlave, model: &ObservedSlave) -> bool {
    match (recorded.inputs, model.inputs) {
        (Some((of, recorded)), Some((other, model))) => of != other || recorded == model,
        _ => true,
    }
}
