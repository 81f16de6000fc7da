//! The check word behind the data segment: a fixed word, or a CRC-32 of the header and the data.
//!
//! The CRC-32 is zlib's (XF EN 741). `crc32fast` computes it with the carry-less multiplication of the processor where
//! there is one, which matters because every packet of every cycle is checked on both sides; it is small, needs no
//! `std`, and is the one that zlib's users in Rust have.

pub use super::check_type::CheckType;
use super::header::CommandHeader;
use super::{DataSize, FIXED_CHECK, HEADER_LEN, NOT_READY, Status};

/// Which bytes a CRC-32 covers. Nothing on the wire says it. Which firmware has which is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Coverage {
    /// The header and all n bytes of the data segment, as the manuals say.
    #[default]
    All,
    /// The header and as many bytes of the data segment as the header says are valid (OBS: the vendor's driver 1.60, built for a
    /// certain firmware).
    Valid,
    /// The same, up to the next multiple of 4 bytes (OBS: the vendor's driver 0.1).
    Valid4,
}

impl Coverage {
    /// Every coverage that is known, in the order in which a host tries them.
    pub const EVERY: [Self; 3] = [Self::All, Self::Valid, Self::Valid4];

    /// How many bytes of a packet's header and data segment count if `len` bytes of data are valid.
    ///
    /// `[OURS]` A length beyond the data segment, as a damaged header may have, covers all of it.
    pub fn bytes(self, size: DataSize, len: u16) -> usize {
        self.end(HEADER_LEN + size.bytes(), len)
    }

    /// As [`Self::bytes`], of header and data segment with `covered` bytes.
    fn end(self, covered: usize, len: u16) -> usize {
        let valid = HEADER_LEN + usize::from(len);
        match self {
            Self::All => covered,
            Self::Valid => covered.min(valid),
            Self::Valid4 => covered.min(valid.next_multiple_of(4)),
        }
    }
}

/// What a CRC-32 covers in each direction; one client covers more in its commands than it checks in answers (OBS).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Coverages {
    /// In commands.
    pub commands: Coverage,
    /// In answers.
    pub answers: Coverage,
}

impl From<Coverage> for Coverages {
    /// The same in both directions.
    fn from(coverage: Coverage) -> Self {
        Self { commands: coverage, answers: coverage }
    }
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
fn crc32(covered: &[u8], len: u16, coverage: Coverage) -> u32 {
    crc32fast::hash(&covered[..coverage.end(covered.len(), len)])
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
