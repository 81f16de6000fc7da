//! Registers of distributed clocks, and what a controller can do.

use crate::ethercat::bits;

bits! {
    /// What a controller can do, 0x0008.
    Features(u16) {
        /// Bit 0: FMMUs map whole bytes only.
        BYTEWISE_FMMUS = 1 << 0;
        /// Bit 1: registers that are not used can be accessed.
        UNUSED_REGISTERS = 1 << 1;
        /// Bit 2: distributed clocks.
        CLOCK = 1 << 2;
        /// Bit 3: with 64 bits.
        CLOCK_64_BITS = 1 << 3;
        /// Bit 4: low jitter of EBUS.
        LOW_JITTER = 1 << 4;
        /// Bit 5: enhanced link detection of EBUS.
        ENHANCED_LINK_EBUS = 1 << 5;
        /// Bit 6: enhanced link detection of MII.
        ENHANCED_LINK_MII = 1 << 6;
        /// Bit 7: errors of the check sequence are counted apart.
        SEPARATE_CHECK_ERRORS = 1 << 7;
        /// Bit 8: bits 3 to 7 of the SYNC activation have a meaning.
        ENHANCED_SYNC = 1 << 8;
        /// Bit 9: no LRW.
        NO_LRW = 1 << 9;
        /// Bit 10: no BRW, APRW and FPRW.
        NO_READ_WRITE = 1 << 10;
        /// Bit 11: FMMUs and sync managers are fixed.
        FIXED = 1 << 11;
    }

    /// SYNC activation, 0x0981.
    SyncActivation(u8) {
        /// Bit 0: the unit runs.
        ACTIVATE = 1 << 0;
        /// Bit 1: it gives SYNC0.
        SYNC0 = 1 << 1;
        /// Bit 2: it gives SYNC1.
        SYNC1 = 1 << 2;
        /// Bit 3: a write of the start time activates.
        AUTO = 1 << 3;
        /// Bit 4: a start time of 32 bits is extended to 64.
        EXTEND_START = 1 << 4;
        /// Bit 5: the start time is checked.
        CHECK_START = 1 << 5;
        /// Bit 6: a start time in the near future only.
        NEAR_FUTURE = 1 << 6;
        /// Bit 7: a pulse at once, for debugging.
        DEBUG_PULSE = 1 << 7;
    }

    /// Status of a latch input, 0x09AE and 0x09AF.
    LatchStatus(u8) {
        /// Bit 0: a positive edge was kept in the single mode, and its time was not read yet.
        POSITIVE = 1 << 0;
        /// Bit 1: the same of a negative edge.
        NEGATIVE = 1 << 1;
        /// Bit 2: the level of the input.
        PIN = 1 << 2;
    }
}

/// How many latch inputs a controller has.
pub const LATCHES: usize = 2;

/// An edge of a latch input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LatchEdge {
    /// The input goes on.
    Positive,
    /// The input goes off.
    Negative,
}

impl LatchEdge {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Positive, Self::Negative];

    /// Its bit in the control of an input, 0x09A8 and 0x09A9, where it selects the single mode, and in [`LatchStatus`].
    pub const fn bit(self) -> u8 {
        match self {
            Self::Positive => LatchStatus::POSITIVE.0,
            Self::Negative => LatchStatus::NEGATIVE.0,
        }
    }
}

/// System time difference, 0x092C: how far a clock is from the one that is distributed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SystemTimeDifference(pub u32);

impl SystemTimeDifference {
    /// Bit 31: the slave's own time is the smaller one.
    pub const BEHIND: u32 = 1 << 31;

    /// The difference of `ahead_ns`, by which the slave's own time is greater than the received one. What needs more than
    /// 31 bits is shown as the greatest value.
    pub const fn of(ahead_ns: i64) -> Self {
        let magnitude = ahead_ns.unsigned_abs();
        let magnitude = if magnitude < Self::BEHIND as u64 { magnitude as u32 } else { Self::BEHIND - 1 };
        Self(if ahead_ns < 0 { magnitude | Self::BEHIND } else { magnitude })
    }

    /// By how much the slave's own time is greater than the received one, ns.
    pub const fn ahead_ns(self) -> i64 {
        let magnitude = (self.0 & !Self::BEHIND) as i64;
        if self.0 & Self::BEHIND != 0 { -magnitude } else { magnitude }
    }
}
