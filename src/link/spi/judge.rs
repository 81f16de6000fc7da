//! Whether what came in on MISO is an answer of the board, and if not, which wire lies.

use std::collections::VecDeque;

use crate::sk::{CommandId, CrcPolicy, Frame, MASTER_CYCLIC, MasterResponse, SlotForm, SlotSize};

/// How far answers are looked for that have slipped, bits. \[OURS]
const SLIPS: std::ops::RangeInclusive<usize> = 1..=32;

/// Why an answer is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lie {
    /// Nothing drives MISO, or it is tied high.
    #[error(
        "MISO is high all the time (all ones): look at MISO (J3/J2 pin 9), at ground and at the chip select (pin 7), and \
         whether the board has power"
    )]
    Ones,
    /// MISO is tied low, or the board starts up.
    #[error(
        "MISO is low all the time (all zeros): the board starts up, finds no slave or has CONFIG0 set to USB; if not, look \
         at MISO (J3/J2 pin 9), SCLK (pin 8) and the chip select (pin 7)"
    )]
    Zeros,
    /// MISO is MOSI.
    #[error(
        "MISO repeats what MOSI says: the two are connected to one another; connect each to its own pin (J3/J2 9, 10)"
    )]
    Echo,
    /// The other slot size.
    #[error("the answers have slots of {fits} bytes, not of {set} (CONFIG2): set slot={fits} in the link")]
    SlotSize {
        /// What the link says, bytes.
        set: usize,
        /// What fits, bytes.
        fits: usize,
    },
    /// Bits too late or too early.
    #[error(
        "the answers come {bits} bit(s) too {}: the SPI mode is another (mode=1), or the clock is too fast for the wires \
         (speed=, jumper wires less than 10M)",
        if *late { "late" } else { "early" }
    )]
    Bits {
        /// How many.
        bits: usize,
        /// Whether too late.
        late: bool,
    },
    /// Bytes too late or too early.
    #[error(
        "the answers come {bytes} byte(s) too {}: the board and this machine are out of step; look at the chip select \
         (J3/J2 pin 7), then reset the board or switch it off and on",
        if *late { "late" } else { "early" }
    )]
    Bytes {
        /// How many.
        bytes: usize,
        /// Whether too late.
        late: bool,
    },
    /// None of these.
    #[error(
        "the answers have neither a right CRC nor the form of a frame: set a slower speed= (jumper wires less than 10M), \
         look at the wires and at slot= and mode="
    )]
    Garbled,
}

/// Answers kept that were none: a lie has to explain them all. \[OURS]
const KEPT: usize = 4;

/// Answers with CRCs that are right, each another one than the one before, after which the board counts as one that fills it:
/// what is none has a right one once in 256 times. \[OURS]
const FILLED: u8 = 2;

/// What is known of the board's answers.
#[derive(Clone, Debug)]
pub struct Judge {
    size: SlotSize,
    /// Answers with CRCs that are right, each another one, since one without; at most [`FILLED`], from where on it stays.
    filled: u8,
    /// The newest of these CRCs.
    crc: u8,
    /// The newest that were none, since one that was, no two the same in a row.
    bad: VecDeque<Frame>,
}

impl Judge {
    /// Of a board of that slot size.
    pub fn new(size: SlotSize) -> Self {
        Self { size, filled: 0, crc: 0, bad: VecDeque::with_capacity(KEPT) }
    }

    /// Whether the answer carries a CRC, as far as is known.
    pub const fn fills_crc(&self) -> bool {
        self.filled >= FILLED
    }

    /// Looks at what came in.
    ///
    /// # Errors
    /// It is no answer; why not is [`Self::explain`]'s to tell.
    pub fn look(&mut self, answer: &Frame) -> Result<MasterResponse, NoAnswer> {
        if !self.fits(answer) {
            if self.bad.back() != Some(answer) {
                if self.bad.len() == KEPT {
                    self.bad.pop_front();
                }
                self.bad.push_back(answer.clone());
            }
            return Err(NoAnswer);
        }
        self.bad.clear();
        self.note_crc(answer.crc_byte());
        Ok(MasterResponse::decode(&answer.slot(self.size, 0)))
    }

    /// An answer has that CRC; 0: none, as far as is known.
    const fn note_crc(&mut self, crc: u8) {
        if self.fills_crc() || crc == self.crc {
            return;
        }
        self.crc = crc;
        self.filled = if crc == 0 { 0 } else { self.filled + 1 };
    }

    fn fits(&self, answer: &Frame) -> bool {
        let bytes = answer.wire(self.size);
        if same(bytes, 0xFF) {
            return false;
        }
        if answer.crc_byte() != 0 || self.fills_crc() {
            return answer.check_crc(self.size, CrcPolicy::Strict).is_ok();
        }
        !same(bytes, 0) && SlotForm::Answer.fits(answer, self.size)
    }

    /// What is wrong with the answers that were none.
    pub fn explain(&self) -> Lie {
        let newest = self.bad.back().map(|answer| answer.wire(self.size)).unwrap_or_default();
        if same(newest, 0xFF) {
            return Lie::Ones;
        }
        if same(newest, 0) {
            return Lie::Zeros;
        }
        // Where a CRC fits it says more than the form of a frame does, which many have that are nearly all zeros.
        [CrcPolicy::Strict, CrcPolicy::AbsentAllowed]
            .into_iter()
            .find_map(|policy| self.explain_by(policy))
            .unwrap_or(Lie::Garbled)
    }

    fn explain_by(&self, policy: CrcPolicy) -> Option<Lie> {
        let all = |is: &dyn Fn(&[u8]) -> bool| self.bad.iter().all(|answer| is(answer.wire(self.size)));
        let other = self.size.other();
        // Of a longer frame the end is not known: it is the SDO slot's, most often 0.
        if all(&|bytes| is_answer(&Frame::from_prefix(bytes), other, policy)) {
            return Some(Lie::SlotSize { set: self.size.bytes(), fits: other.bytes() });
        }
        // Without a CRC a slip of whole bytes looks like too many other things.
        let most = if policy == CrcPolicy::Strict { *SLIPS.end() } else { 7 };
        let mut slips = SLIPS.take_while(|bits| *bits <= most).flat_map(|bits| [(bits, true), (bits, false)]);
        let (bits, late) = slips.find(|slip| all(&|bytes| self.has_slipped(bytes, *slip, policy)))?;
        Some(match bits % 8 {
            0 => Lie::Bytes { bytes: bits / 8, late },
            _ => Lie::Bits { bits, late },
        })
    }

    fn has_slipped(&self, bytes: &[u8], (bits, late): (usize, bool), policy: CrcPolicy) -> bool {
        let mut moved = Frame::from_prefix(&slip(bytes, bits, late));
        if late {
            return is_answer(&moved, self.size, policy);
        }
        // The first bits are gone: they are those of the id.
        IDS_OF_ANSWERS.into_iter().any(|id| {
            moved.bytes_mut()[0] = if bits < 8 { moved.bytes()[0] & (0xFF >> bits) | id & !(0xFF >> bits) } else { id };
            is_answer(&moved, self.size, policy)
        })
    }
}

/// What came in is not an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAnswer;

/// Ids that the first answers have: those of GET_STATUS, LIO_RD and OP.
const IDS_OF_ANSWERS: [u8; 3] = [CommandId::GetStatus.code(), CommandId::LocalRead.code(), MASTER_CYCLIC];

/// Whether both CRC and form are right: a CRC alone fits by chance once in 256 times.
fn is_answer(frame: &Frame, size: SlotSize, policy: CrcPolicy) -> bool {
    let fits = frame.crc_byte() != 0 || policy == CrcPolicy::AbsentAllowed;
    fits && frame.check_crc(size, policy).is_ok() && SlotForm::Answer.fits(frame, size) && !same(frame.wire(size), 0)
}

fn same(bytes: &[u8], value: u8) -> bool {
    bytes.iter().all(|byte| *byte == value)
}

/// The bytes as they were before they came so many bits too late, or too early; what was lost is 0.
fn slip(bytes: &[u8], bits: usize, late: bool) -> Vec<u8> {
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
