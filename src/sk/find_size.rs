//! Which slot size a frame has, told from the frame alone: the wire does not show the board's CONFIG2.
//!
//! A CRC that is right in one size alone tells it. Where a board fills in no CRC the slots do: read in the wrong size they
//! begin in the middle of other slots, and what stands there is no command that belongs there. Either may fit by chance;
//! how many frames have to agree is for the caller to say.

use super::{
    CommandId, CrcPolicy, FIFO_ENTRIES, Frame, MASTER_CYCLIC, MasterResponse, MasterState, RawSlot, SlotKind, SlotSize,
    StateByte,
};

impl SlotSize {
    /// The size that this one is not.
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
    /// The one size in which byte 3 is the frame's CRC. A byte 3 that is 0 is more often no CRC than one.
    pub fn size_by_crc(&self) -> Option<SlotSize> {
        SlotSize::only(|size| self.check_crc(size, CrcPolicy::Strict).is_ok())
    }

    /// The one size in which the slots have that form.
    pub fn size_by_slots(&self, form: SlotForm) -> Option<SlotSize> {
        SlotSize::only(|size| form.fits(self, size))
    }
}

/// What the slots of a frame look like in the right size, by what is known of the frame. \[OURS]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotForm {
    /// Of a report: each slave's slot and the SDO slot begin with a command that belongs there, GET_STATUS among them
    /// (SK-3, SK-6), and bytes 12..15 of slot 0, which read 0, are 0 (SK-1).
    Report,
    /// Of a report that is refused if it does not fit, so that only what no board sends may not fit: slot 0 shows a state
    /// and what belongs to it (SK-2), the SDO slot begins as that of [`SlotForm::Report`] does, a slave's slot begins with
    /// any command.
    Answer,
    /// Of a command frame or a report, whichever it is: each slave's slot and the SDO slot are all zero or hold a command
    /// that belongs there (SK-4) and is not GET_STATUS, or the answer to one. A slot of a report that answers GET_STATUS
    /// holds data without an id: such a frame tells nothing.
    CommandOrReport,
}

impl SlotForm {
    /// Whether the frame's slots have this form in that size.
    pub fn fits(self, frame: &Frame, size: SlotSize) -> bool {
        let slots = frame.slots(size);
        let board = slots.get(0);
        let board_fits = match self {
            Self::Report => board.data3 == 0,
            Self::Answer => is_answer_of_board(&board),
            Self::CommandOrReport => board.id == MASTER_CYCLIC || is_known(&board),
        };
        board_fits
            && (1..size.slots()).all(|number| {
                let (slot, kind) = (slots.get(number), size.kind_of(number));
                match (self, kind) {
                    (Self::Answer, SlotKind::Slave) => is_known(&slot),
                    (Self::Report | Self::Answer, _) => belongs(&slot, kind),
                    (Self::CommandOrReport, _) => slot.is_zero() || asks(&slot, kind, size),
                }
            })
    }
}

/// Whether slot 0 is one that a board answers: in OP with as many free entries as the FIFO may have, outside OP without a
/// FIFO, by the id of a command for the board or, in OP, that of the cyclic response.
fn is_answer_of_board(slot: &RawSlot) -> bool {
    let master = MasterResponse::decode(slot);
    let is_known = belongs(slot, SlotKind::Master);
    let is_quiet = is_known && slot.data2 == 0;
    match master.state.state() {
        Some(MasterState::Op) => (master.id == MASTER_CYCLIC || is_known) && master.fifo_free <= FIFO_ENTRIES,
        Some(_) => is_quiet,
        None => is_quiet && matches!(master.state.0, 0 | StateByte::FAILED),
    }
}

/// Whether the slot begins with one of the 22 commands.
const fn is_known(slot: &RawSlot) -> bool {
    !matches!(CommandId::from_code(slot.id), CommandId::Unknown(_))
}

/// Whether a slot of that kind begins with a command that belongs there.
const fn belongs(slot: &RawSlot, kind: SlotKind) -> bool {
    CommandId::from_code(slot.id).belongs_in(kind)
}

/// Whether a slot of that kind asks for something that belongs there, or answers it; an SDO transfer names its slave.
fn asks(slot: &RawSlot, kind: SlotKind, size: SlotSize) -> bool {
    let names_slave = kind != SlotKind::Sdo || (1..=size.max_slaves()).contains(&usize::from(slot.parm & 0xFF));
    slot.id != CommandId::GetStatus.code() && belongs(slot, kind) && names_slave
}
