//! Finds the slot size of a frame from the frame alone, since the wire does not show the board's CONFIG2.
//!
//! If the CRC is right in only one of the two sizes, that is the frame's size. If the board fills in no CRC, the slots
//! show the size: read in the wrong size, most slots begin in the middle of other slots, and their first byte is rarely
//! a command that belongs there. Both tests can succeed by chance, so the caller decides how many frames have to agree.

use super::{
    CommandId, CrcPolicy, FIFO_ENTRIES, Frame, MASTER_CYCLIC, MasterResponse, MasterState, RawSlot, SlotKind, SlotSize,
};

impl SlotSize {
    /// The other of the two slot sizes.
    pub const fn other(self) -> Self {
        match self {
            Self::Bytes12 => Self::Bytes16,
            Self::Bytes16 => Self::Bytes12,
        }
    }

    /// The one size for which `fits` holds; `None` if it holds for both or for neither.
    pub fn only(fits: impl Fn(Self) -> bool) -> Option<Self> {
        match Self::ALL.map(fits) {
            [true, false] => Some(Self::Bytes12),
            [false, true] => Some(Self::Bytes16),
            _ => None,
        }
    }
}

impl Frame {
    /// The size in which byte 3 is the frame's CRC; `None` if that holds for both or for neither. If byte 3 is 0 the
    /// result is not reliable, because a board that fills in no CRC sends 0 there.
    pub fn size_by_crc(&self) -> Option<SlotSize> {
        SlotSize::only(|size| self.check_crc(size, CrcPolicy::Strict).is_ok())
    }

    /// The only size in which the slots match this pattern; `None` if both sizes match, or neither.
    pub fn size_by_slots(&self, form: SlotForm) -> Option<SlotSize> {
        SlotSize::only(|size| form.fits(self, size))
    }
}

/// A pattern that the slots of a frame match when they are read in the right size. Which pattern applies depends on
/// what is known about the frame. \[OURS]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotForm {
    /// The frame is a report. Each slave's slot and the SDO slot begin with a command that belongs there, GET_STATUS included
    /// (SK-3, SK-6), and bytes 12..15 of slot 0 are 0 (SK-1).
    Report,
    /// The frame is a report, and the host refuses it if it does not match. So the pattern checks only what is certain
    /// for every report: slot 0 begins with a command that belongs there or, in OP and in a state that is not known,
    /// with the id of the cyclic response; in OP its free count is at most the FIFO's depth. The SDO slot begins as for
    /// [`SlotForm::Report`], and a slave's slot begins with any known command. The state may have any value (SK-2.9).
    /// Outside OP bytes 8..11 of slot 0 may have any value, too, since no source says what they mean (SK-2.21).
    StrictReport,
    /// The frame is a command frame or a report. Each slave's slot and the SDO slot are all zero, or hold a command
    /// that belongs there (SK-4) and is not GET_STATUS, or the answer to such a command. A report with slots that
    /// answer GET_STATUS does not fit, since such slots hold data without an id.
    CommandOrReport,
}

impl SlotForm {
    /// Whether the frame's slots, read in this size, match the pattern.
    pub fn fits(self, frame: &Frame, size: SlotSize) -> bool {
        let slots = frame.slots(size);
        let board = slots.get(0);
        let board_fits = match self {
            Self::Report => board.data3 == 0,
            Self::StrictReport => is_answer_of_board(&board),
            Self::CommandOrReport => board.id == MASTER_CYCLIC || is_known(&board),
        };
        board_fits
            && (1..size.slots()).all(|number| {
                let (slot, kind) = (slots.get(number), size.kind_of(number));
                match (self, kind) {
                    (Self::StrictReport, SlotKind::Slave) => is_known(&slot),
                    (Self::Report | Self::StrictReport, _) => belongs(&slot, kind),
                    (Self::CommandOrReport, _) => slot.is_zero() || asks(&slot, kind, size),
                }
            })
    }
}

/// Whether a board may send such a slot 0 ([`SlotForm::StrictReport`]).
fn is_answer_of_board(slot: &RawSlot) -> bool {
    let master = MasterResponse::decode(slot);
    let (is_known, is_cyclic) = (belongs(slot, SlotKind::Master), master.id == MASTER_CYCLIC);
    match master.state.state() {
        Some(MasterState::Op) => (is_known || is_cyclic) && master.fifo_free <= FIFO_ENTRIES,
        Some(_) => is_known,
        None => is_known || is_cyclic,
    }
}

/// Whether the slot begins with one of the 22 commands.
const fn is_known(slot: &RawSlot) -> bool {
    !matches!(CommandId::from_code(slot.id), CommandId::Unknown(_))
}

/// Whether the slot begins with a command that belongs in slots of this kind.
const fn belongs(slot: &RawSlot, kind: SlotKind) -> bool {
    CommandId::from_code(slot.id).belongs_in(kind)
}

/// Whether the slot has a command other than GET_STATUS that belongs in a slot of this kind, or the answer to such a
/// command; both begin with the id of the command. An SDO transfer must also have the number of a possible slave.
fn asks(slot: &RawSlot, kind: SlotKind, size: SlotSize) -> bool {
    let names_slave = kind != SlotKind::Sdo || (1..=size.max_slaves()).contains(&usize::from(slot.parm & 0xFF));
    slot.id != CommandId::GetStatus.code() && belongs(slot, kind) && names_slave
}
