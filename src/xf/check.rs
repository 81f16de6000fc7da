//! The check word after the data segment: a fixed word, or a CRC-32 of the header and the data.
//!
//! The CRC-32 is the one that zlib computes (XF EN 741). Host and chip check every packet of every cycle, so
//! `crc32fast` is used, which computes it with the processor's carry-less multiplication, if available. The crate is
//! small, needs no `std`, and is the usual one for zlib's CRC-32 in Rust.

pub use super::check_type::CheckType;
use super::header::CommandHeader;
use super::{DataSize, FIXED_CHECK, HEADER_LEN, NOT_READY, Status};

/// The bytes that a CRC-32 covers. A packet does not say which coverage its sender used, and it is not known which firmware
/// uses which one, so a host has to try them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum CrcCoverage {
    /// The header and all n bytes of the data segment, as the manuals say.
    #[default]
    All,
    /// The header and the valid bytes of the data segment, as many as the header says (OBS: the vendor's driver 1.60,
    /// built for a certain firmware).
    Valid,
    /// As [`Self::Valid`], rounded up to a multiple of 4 bytes (OBS: the vendor's driver 0.1).
    Valid4,
}

impl CrcCoverage {
    /// All known coverages, in the order in which a host tries them.
    pub const EVERY: [Self; 3] = [Self::All, Self::Valid, Self::Valid4];

    /// The number of bytes covered, from the beginning of the header, if `len` bytes of the data segment are valid.
    ///
    /// `[OURS]` A length beyond the data segment, as in a damaged header, covers the whole segment.
    pub fn bytes(self, size: DataSize, len: u16) -> usize {
        self.end(HEADER_LEN + size.bytes(), len)
    }

    /// Like [`Self::bytes`]; `covered` is the number of bytes of the header and the data segment together.
    fn end(self, covered: usize, len: u16) -> usize {
        let valid = HEADER_LEN + usize::from(len);
        match self {
            Self::All => covered,
            Self::Valid => covered.min(valid),
            Self::Valid4 => covered.min(valid.next_multiple_of(4)),
        }
    }
}

/// The coverage of the CRC-32 in each direction. They can differ: an observed client program covers more bytes in its commands
/// than it checks in answers (OBS).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CrcCoverages {
    /// The coverage in commands.
    pub commands: CrcCoverage,
    /// The coverage in answers.
    pub answers: CrcCoverage,
}

impl From<CrcCoverage> for CrcCoverages {
    /// The same coverage in both directions.
    fn from(coverage: CrcCoverage) -> Self {
        Self { commands: coverage, answers: coverage }
    }
}

/// How the check words of one direction, commands or answers, are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CheckRule {
    /// Whether the check word is the fixed word or a CRC-32.
    pub kind: CheckType,
    /// The coverage of a CRC-32.
    pub coverage: CrcCoverage,
}

impl CheckRule {
    /// The fixed check word.
    pub const FIXED: Self = Self { kind: CheckType::Fixed, coverage: CrcCoverage::All };
    /// A CRC-32 over the header and the whole data segment.
    pub const CRC32: Self = Self { kind: CheckType::Crc32, coverage: CrcCoverage::All };

    /// The check word of a packet. `covered` is its header and data segment, and `len` the number of valid data bytes.
    pub fn word(self, covered: &[u8], len: u16) -> u32 {
        match self.kind {
            CheckType::Fixed => FIXED_CHECK,
            CheckType::Crc32 => crc32(covered, len, self.coverage),
        }
    }

    /// The rule for a command: the check word of SPI_RECONFIG_OP is always the fixed one (XF EN 715).
    pub(super) fn of_command(self, header: &CommandHeader) -> Self {
        match header.code {
            super::CommandCode::SpiReconfig => Self { kind: CheckType::Fixed, ..self },
            _ => self,
        }
    }
}

/// The CRC-32 over `covered`, a header and data segment, with that coverage.
fn crc32(covered: &[u8], len: u16, coverage: CrcCoverage) -> u32 {
    crc32fast::hash(&covered[..coverage.end(covered.len(), len)])
}

/// The result of checking a packet's check word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CheckResult {
    Right,
    NotReady,
    Wrong {
        kind: CheckType,
        expected: u32,
    },
    /// The status bits of the answer name an undefined check type.
    Undefined(u8),
}

/// Checks the check word of an answer by the type in the answer's own status bits. They show how the chip has made the answer,
/// which may differ from the type that the host has set.
///
/// `[OURS]` An answer whose valid CRC equals [`NOT_READY`], the check word of a chip that is not ready, counts as valid.
pub(super) fn check_answer(status: Status, len: u16, covered: &[u8], found: u32, coverage: CrcCoverage) -> CheckResult {
    let kind = status.check_type();
    let expected = kind.map(|kind| CheckRule { kind, coverage }.word(covered, len));
    match (kind, expected) {
        (Ok(_), Ok(expected)) if expected == found => CheckResult::Right,
        _ if found == NOT_READY => CheckResult::NotReady,
        (Ok(kind), Ok(expected)) => CheckResult::Wrong { kind, expected },
        (Err(bits), _) | (_, Err(bits)) => CheckResult::Undefined(bits),
    }
}
