//! A report of the board, together with the kinds of the slaves that SET_AXIS has declared: the report itself does not
//! show them.

use crate::sk::dump::{MAX_SLAVES, ResponseDump, SlaveData, SlotMeaning};
use crate::sk::{CommandId, Frame, MasterResponse, MasterState, SdoResponse, SlaveKind, SlotSize};

/// A report, with the kinds of the slaves when it was received.
#[derive(Clone, Debug)]
pub struct BoardReport {
    /// The number of the report in the run.
    pub frame_number: u64,
    /// The time at which the report was received, in nanoseconds.
    pub at_ns: i64,
    pub(super) frame: Frame,
    pub(super) size: SlotSize,
    pub(super) kinds: [Option<SlaveKind>; MAX_SLAVES],
    /// For each slave: how many consecutive reports, up to this one, show the same positions of its axes as the report
    /// before them.
    pub(super) unchanged_reports: [u16; MAX_SLAVES],
}

impl BoardReport {
    /// Slot 0, decoded.
    pub fn board(&self) -> MasterResponse {
        MasterResponse::decode(&self.frame.slot(self.size, 0))
    }

    /// The SDO slot, decoded.
    pub fn sdo(&self) -> SdoResponse {
        SdoResponse::decode(&self.frame.slot(self.size, self.size.sdo_slot()))
    }

    /// The slot of `slave`, from 1, decoded for the kind that SET_AXIS has declared. Without SET_AXIS it is decoded for
    /// the kind that its fields show.
    pub fn slave(&self, slave: u8) -> SlaveData {
        reading(&self.frame, self.size, &self.kinds, slave.into())
    }

    /// The command that the slot of `slave` answers.
    pub fn answers(&self, slave: u8) -> CommandId {
        CommandId::from_code(self.frame.slot(self.size, slave.into()).id)
    }

    /// The actual position of the first axis of `slave` in counts; `None` if it has no axis or the network is not in OP.
    pub fn position(&self, slave: u8) -> Option<i32> {
        match self.slave(slave) {
            SlaveData::Drive(drive) if self.is_op() => Some(drive.position),
            SlaveData::Hsp(hsp) if self.is_op() => Some(hsp.first.position),
            _ => None,
        }
    }

    /// The actual positions of both axes of `slave` in counts; `None` for an axis that it does not have, if its slot is
    /// empty, or if the network is not in OP.
    pub(super) fn positions(&self, slave: u8) -> [Option<i32>; 2] {
        if !self.is_op() || self.frame.slot(self.size, slave.into()).is_zero() {
            return [None; 2];
        }
        match self.slave(slave) {
            SlaveData::Drive(drive) => [Some(drive.position), None],
            SlaveData::Hsp(hsp) => [Some(hsp.first.position), Some(hsp.second.position)],
            _ => [None; 2],
        }
    }

    /// Whether both reports have the same bytes in the slot of `slave`, and the slave has the same kind in both.
    pub(super) fn shows_the_same(&self, other: &Self, slave: u8) -> bool {
        let kind = |answer: &Self| usize::from(slave).checked_sub(1).and_then(|n| answer.kinds.get(n)).copied();
        let slot = |answer: &Self| answer.frame.slot(answer.size, slave.into());
        slot(self) == slot(other) && kind(self) == kind(other)
    }

    /// For how many reports up to this one the positions of `slave` have not changed.
    pub(super) fn unchanged_reports(&self, slave: u8) -> u16 {
        usize::from(slave).checked_sub(1).and_then(|n| self.unchanged_reports.get(n)).copied().unwrap_or_default()
    }

    /// Whether the network is in OP, so that the slaves' slots hold process data.
    pub fn is_op(&self) -> bool {
        self.board().state.state() == Some(MasterState::Op)
    }
}

fn reading(frame: &Frame, size: SlotSize, kinds: &[Option<SlaveKind>; MAX_SLAVES], slave: usize) -> SlaveData {
    let given = kinds.map(Option::unwrap_or_default);
    let dump = match kinds.get(slave.wrapping_sub(1)) {
        Some(Some(_)) => ResponseDump::new(frame, size).kinds(&given),
        _ => ResponseDump::new(frame, size),
    };
    match dump.line(slave).map(|line| line.meaning) {
        Some(SlotMeaning::SlaveResponse(reading)) => reading.data,
        _ => SlaveData::Nothing,
    }
}
