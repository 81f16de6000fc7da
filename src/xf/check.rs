//! The check word behind the data segment: a fixed word, or a CRC-32 of the header and the data.
//!
//! The CRC-32 is zlib's (XF EN 741). `crc32fast` computes it with the carry-less multiplication of the processor where
//! there is one, which matters because every packet of every cycle is checked on both sides; it is small, needs no
//! `std`, and is the one that zlib's users in Rust have.

use super::header::CommandHeader;
use super::{FIXED_CHECK, HEADER_LEN, NOT_READY, Status};

/// What the check word is: the parameter of CRC_TYPE_SET, and bits 1 and 0 of byte 0x0A of an answer. 1 and 2 are
/// undefined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum CheckType {
    /// 0: [`FIXED_CHECK`], what the chip starts with (OBS).
    #[default]
    Fixed = 0,
    /// 3: CRC-32.
    Crc32 = 3,
}

impl CheckType {
    /// The type with this code; `None` unless it is 0 or 3.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Fixed),
            3 => Some(Self::Crc32),
            _ => None,
        }
    }

    /// The code on the wire: 0 or 3.
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// Which bytes a CRC-32 covers. Nothing on the wire says it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Coverage {
    /// The header and all n bytes of the data segment, as the manuals say.
    #[default]
    All,
    /// The header and as many bytes of the data segment as the header says are valid: a later firmware (OBS).
    Valid,
}

/// How check words are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CheckRule {
    /// Fixed word or CRC-32.
    pub kind: CheckType,
    /// What a CRC-32 covers.
    pub coverage: Coverage,
}

impl CheckRule {
    /// The fixed word.
    pub const FIXED: Self = Self { kind: CheckType::Fixed, coverage: Coverage::All };
    /// CRC-32 over header and data.
    pub const CRC32: Self = Self { kind: CheckType::Crc32, coverage: Coverage::All };

    /// The check word of a packet whose header and data segment are `covered`, of which `len` bytes of data are valid.
    pub fn word(self, covered: &[u8], len: u16) -> u32 {
        match self.kind {
            CheckType::Fixed => FIXED_CHECK,
            CheckType::Crc32 => crc32(covered, len, self.coverage),
        }
    }

    /// The rule for a command: with SPI_RECONFIG_OP the check word is always the fixed one (XF EN 715).
    pub(super) fn of_command(self, header: &CommandHeader) -> Self {
        match header.code {
            super::CommandCode::SpiReconfig => Self { kind: CheckType::Fixed, ..self },
            _ => self,
        }
    }
}

/// The CRC-32 over header and data segment, `covered`.
///
/// `[OURS]` A length beyond the data segment, as a damaged header may have, covers all of it.
fn crc32(covered: &[u8], len: u16, coverage: Coverage) -> u32 {
    let end = match coverage {
        Coverage::All => covered.len(),
        Coverage::Valid => covered.len().min(HEADER_LEN + usize::from(len)),
    };
    crc32fast::hash(&covered[..end])
}

/// What the check word of a packet says about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Right,
    NotReady,
    Wrong {
        kind: CheckType,
        expected: u32,
    },
    /// The status bits of an answer name no type.
    Undefined(u8),
}

/// The check word of an answer is judged by the answer's own status bits, which a host trusts more than what it has
/// set.
///
/// `[OURS]` A CRC that is by chance the word for "not ready" is a right one.
pub(super) fn judge_answer(status: Status, len: u16, covered: &[u8], found: u32, coverage: Coverage) -> Verdict {
    let kind = status.check_type();
    let expected = kind.map(|kind| CheckRule { kind, coverage }.word(covered, len));
    match (kind, expected) {
        (Ok(_), Ok(expected)) if expected == found => Verdict::Right,
        _ if found == NOT_READY => Verdict::NotReady,
        (Ok(kind), Ok(expected)) => Verdict::Wrong { kind, expected },
        (Err(bits), _) | (_, Err(bits)) => Verdict::Undefined(bits),
    }
}
