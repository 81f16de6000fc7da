//! Checks whether the bytes received on MISO are a valid answer of the board, and if not, finds the faulty wire.

use std::collections::VecDeque;

use crate::sk::{
    CommandId, CrcPolicy, Frame, MASTER_CYCLIC, MasterResponse, MasterState, SlotForm, SlotSize, StateByte,
};

/// The bit shifts, too early or too late, that [`AnswerCheck::explain`] tries to undo. \[OURS]
const SHIFT_BITS: std::ops::RangeInclusive<usize> = 1..=32;

/// The wiring fault that invalid answers of the board indicate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WiringFault {
    /// MISO is always high: nothing drives it, or it is connected to the supply.
    #[error(
        "MISO is high all the time (all ones): look at MISO (J3/J2 pin 9), at ground and at the chip select (pin 7), and \
         whether the board has power"
    )]
    Ones,
    /// MISO is always low: it is connected to ground, or the board is starting up.
    #[error(
        "MISO is low all the time (all zeros): the board starts up, finds no slave or has CONFIG0 set to USB; if not, look \
         at MISO (J3/J2 pin 9), SCLK (pin 8) and the chip select (pin 7)"
    )]
    Zeros,
    /// MISO is connected to MOSI.
    #[error(
        "MISO repeats what MOSI says: the two are connected to one another; connect each to its own pin (J3/J2 9, 10)"
    )]
    Echo,
    /// The board uses the other slot size.
    #[error("the answers have slots of {fits} bytes, not of {set} (CONFIG2): set slot={fits} in the link")]
    SlotSize {
        /// The slot size that the URI gives (`slot=`), in bytes.
        set: usize,
        /// The slot size that fits the answers, in bytes.
        fits: usize,
    },
    /// The answers are shifted by a number of bits.
    #[error(
        "the answers come {bits} bit(s) too {}: the SPI mode is another (mode=1), or the clock is too fast for the wires \
         (speed=, jumper wires less than 10M)",
        if *late { "late" } else { "early" }
    )]
    Bits {
        /// The number of bits by which the answers are shifted.
        bits: usize,
        /// `true`: the answers are late relative to SCLK; `false`: they are early.
        late: bool,
    },
    /// The answers are shifted by whole bytes.
    #[error(
        "the answers come {bytes} byte(s) too {}: the board and this machine are out of step; look at the chip select \
         (J3/J2 pin 7), then reset the board or switch it off and on",
        if *late { "late" } else { "early" }
    )]
    Bytes {
        /// The number of bytes by which the answers are shifted.
        bytes: usize,
        /// `true`: the answers are late relative to SCLK; `false`: they are early.
        late: bool,
    },
    /// The answers are invalid, but fit none of the other faults.
    #[error(
        "the answers have neither a right CRC nor the form of a frame: set a slower speed= (jumper wires less than 10M), \
         look at the wires and at slot= and mode="
    )]
    Garbled,
}

/// How many invalid answers are kept to find the wiring fault. A fault is reported only if it explains all of them,
/// since a single answer may fit a fault by chance. \[OURS]
const INVALID_KEPT: usize = 4;

/// How many answers with different valid CRCs show that the board sends CRCs. One is not enough, because the CRC of an
/// invalid answer is valid by chance once in 256 times. \[OURS]
const VALID_CRCS_MIN: u8 = 2;

/// Checks the answers of one board.
#[derive(Clone, Debug)]
pub struct AnswerCheck {
    size: SlotSize,
    /// Number of answers with a valid CRC since the latest answer with 0 in place of the CRC. An answer with the same
    /// CRC as the one before does not count: it may be the same bytes again. Once the number has reached
    /// [`VALID_CRCS_MIN`] it does not change any more.
    valid_crcs: u8,
    /// The CRC of the latest answer that `valid_crcs` counts.
    crc: u8,
    /// Whether a valid answer had a command id in slot 0 that a shifted answer rarely has ([`shows_id`]). \[OURS] Until
    /// then the answers may be shifted, and the state byte may be another byte of the answer, so only the usual states
    /// are accepted. After that, any state is accepted.
    has_shown_id: bool,
    /// The invalid answers since the latest valid one, at most the newest [`INVALID_KEPT`]. An answer that repeats the
    /// one before it is not kept, because it shows nothing new about the fault.
    invalid: VecDeque<Frame>,
}

impl AnswerCheck {
    /// Checks the answers of a board with this slot size.
    pub fn new(size: SlotSize) -> Self {
        Self { size, valid_crcs: 0, crc: 0, has_shown_id: false, invalid: VecDeque::with_capacity(INVALID_KEPT) }
    }

    /// Whether the board sends CRCs, as far as its answers have shown.
    pub const fn fills_crc(&self) -> bool {
        self.valid_crcs >= VALID_CRCS_MIN
    }

    /// Checks an answer and decodes its slot 0.
    ///
    /// # Errors
    /// [`InvalidAnswer`]: the CRC is wrong or, in an answer without a CRC, the bytes do not have the form of a report.
    /// [`Self::explain`] then returns the likely wiring fault.
    pub fn check(&mut self, answer: &Frame) -> Result<MasterResponse, InvalidAnswer> {
        if !self.fits(answer) {
            if self.invalid.back() != Some(answer) {
                if self.invalid.len() == INVALID_KEPT {
                    self.invalid.pop_front();
                }
                self.invalid.push_back(answer.clone());
            }
            return Err(InvalidAnswer);
        }
        self.invalid.clear();
        self.has_shown_id |= shows_id(answer, self.size);
        self.note_crc(answer.crc_byte());
        Ok(MasterResponse::decode(&answer.slot(self.size, 0)))
    }

    /// Notes the CRC of a valid answer. A CRC of 0 does not show that the board sends CRCs, since a board that leaves
    /// them out sends 0.
    const fn note_crc(&mut self, crc: u8) {
        if self.fills_crc() || crc == self.crc {
            return;
        }
        self.crc = crc;
        self.valid_crcs = if crc == 0 { 0 } else { self.valid_crcs + 1 };
    }

    fn fits(&self, answer: &Frame) -> bool {
        let bytes = answer.wire(self.size);
        if same(bytes, 0xFF) {
            return false;
        }
        if answer.crc_byte() != 0 || self.fills_crc() {
            return answer.check_crc(self.size, CrcPolicy::Strict).is_ok();
        }
        !same(bytes, 0)
            && SlotForm::StrictReport.fits(answer, self.size)
            && (self.has_shown_id || shows_id(answer, self.size) || has_usual_state(answer, self.size))
    }

    /// The wiring fault that explains the latest invalid answers.
    pub fn explain(&self) -> WiringFault {
        let newest = self.invalid.back().map(|answer| answer.wire(self.size)).unwrap_or_default();
        if same(newest, 0xFF) {
            return WiringFault::Ones;
        }
        if same(newest, 0) {
            return WiringFault::Zeros;
        }
        // A valid CRC is better evidence than the form of a frame, because frames that are nearly all zeros often have
        // that form.
        [CrcPolicy::Strict, CrcPolicy::AbsentAllowed]
            .into_iter()
            .find_map(|policy| self.explain_by(policy))
            .unwrap_or(WiringFault::Garbled)
    }

    fn explain_by(&self, policy: CrcPolicy) -> Option<WiringFault> {
        let all = |is: &dyn Fn(&[u8]) -> bool| self.invalid.iter().all(|answer| is(answer.wire(self.size)));
        let other = self.size.other();
        // If the other slot size has the longer frame, the end of the frame was not received and is taken as 0. This
        // does not spoil the check, because the end belongs to the SDO slot, which is mostly 0.
        if all(&|bytes| is_answer(&Frame::from_prefix(bytes), other, policy)) {
            return Some(WiringFault::SlotSize { set: self.size.bytes(), fits: other.bytes() });
        }
        // Without a CRC, a shift by whole bytes cannot be distinguished from other faults, so only shifts by up to 7
        // bits are tried.
        let most = if policy == CrcPolicy::Strict { *SHIFT_BITS.end() } else { 7 };
        let mut shifts = SHIFT_BITS.take_while(|bits| *bits <= most).flat_map(|bits| [(bits, true), (bits, false)]);
        let (bits, late) = shifts.find(|shift| all(&|bytes| self.is_shifted(bytes, *shift, policy)))?;
        Some(match bits % 8 {
            0 => WiringFault::Bytes { bytes: bits / 8, late },
            _ => WiringFault::Bits { bits, late },
        })
    }

    fn is_shifted(&self, bytes: &[u8], (bits, late): (usize, bool), policy: CrcPolicy) -> bool {
        let mut moved = Frame::from_prefix(&unshift(bytes, bits, late));
        if late {
            return is_answer(&moved, self.size, policy);
        }
        // An early answer has lost its first bits. They belong to the command id of slot 0, so each id that a first
        // answer may have is tried.
        FIRST_ANSWER_IDS.into_iter().any(|id| {
            moved.bytes_mut()[0] = if bits < 8 { moved.bytes()[0] & (0xFF >> bits) | id & !(0xFF >> bits) } else { id };
            is_answer(&moved, self.size, policy)
        })
    }
}

/// The error that received bytes are not a valid answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InvalidAnswer;

/// The possible command ids in slot 0 of the first answers. The first frames contain GET_STATUS and LIO_RD, and a board
/// in OP sends the cyclic response.
const FIRST_ANSWER_IDS: [u8; 3] = [CommandId::GetStatus.code(), CommandId::LocalRead.code(), MASTER_CYCLIC];

/// Whether a frame has the form of an answer and a valid CRC. If `policy` allows it, the CRC may be absent. The form is
/// checked too, because a CRC is valid by chance once in 256 times.
fn is_answer(frame: &Frame, size: SlotSize, policy: CrcPolicy) -> bool {
    let fits = frame.crc_byte() != 0 || policy == CrcPolicy::AbsentAllowed;
    fits && frame.check_crc(size, policy).is_ok()
        && SlotForm::StrictReport.fits(frame, size)
        && has_usual_state(frame, size)
        && !same(frame.wire(size), 0)
}

/// Whether slot 0 has the command id of LIO_RD or of the cyclic response. A shifted answer rarely has one of these ids
/// there.
fn shows_id(frame: &Frame, size: SlotSize) -> bool {
    let id = frame.slot(size, 0).id;
    id == CommandId::LocalRead.code() || id == MASTER_CYCLIC
}

/// Whether slot 0 has one of the usual states and the fields that belong to it (SK-2). \[OURS] A valid report may have
/// another state. But bytes that are shifted or have the other slot size rarely pass this check.
fn has_usual_state(frame: &Frame, size: SlotSize) -> bool {
    let slot = frame.slot(size, 0);
    let state = MasterResponse::decode(&slot).state;
    match state.state() {
        Some(MasterState::Op) => true,
        Some(_) => slot.data2 == 0,
        None => slot.data2 == 0 && matches!(state.0, 0 | StateByte::FAILED),
    }
}

fn same(bytes: &[u8], value: u8) -> bool {
    bytes.iter().all(|byte| *byte == value)
}

/// Undoes a shift by `bits` bits. The bits that the shift has moved out of the frame are lost and become 0: the last
/// ones if the answer was late, the first ones if it was early.
fn unshift(bytes: &[u8], bits: usize, late: bool) -> Vec<u8> {
    let (whole, part) = (bits / 8, bits % 8);
    let at = |index: isize| usize::try_from(index).ok().and_then(|index| bytes.get(index)).copied().unwrap_or(0);
    let pair = |first: isize| u16::from_be_bytes([at(first), at(first + 1)]);
    (0..bytes.len() as isize)
        .map(|index| {
            if late {
                (pair(index + whole as isize) << part >> 8) as u8
            } else {
                (pair(index - whole as isize - 1) >> part) as u8
            }
        })
        .collect()
}
