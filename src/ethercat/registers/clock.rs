//! Registers of distributed clocks, and the feature bits of a slave controller.

use crate::ethercat::bits;

bits! {
    /// The features of a slave controller, 0x0008.
    Features(u16) {
        /// Bit 0: FMMUs map only whole bytes.
        BYTEWISE_FMMUS = 1 << 0;
        /// Bit 1: unused register addresses cannot be accessed.
        UNUSED_REGISTERS = 1 << 1;
        /// Bit 2: the controller has distributed clocks.
        CLOCK = 1 << 2;
        /// Bit 3: distributed clocks are 64 bits wide.
        CLOCK_64_BITS = 1 << 3;
        /// Bit 4: EBUS ports have low jitter.
        LOW_JITTER = 1 << 4;
        /// Bit 5: EBUS ports have enhanced link detection: a link with many receive errors counts as lost.
        ENHANCED_LINK_EBUS = 1 << 5;
        /// Bit 6: MII ports have enhanced link detection: a link with many receive errors counts as lost.
        ENHANCED_LINK_MII = 1 << 6;
        /// Bit 7: damaged frames that an earlier slave has counted already are counted separately, as forwarded errors.
        SEPARATE_CHECK_ERRORS = 1 << 7;
        /// Bit 8: bits 3 to 7 of the SYNC activation register are supported.
        ENHANCED_SYNC = 1 << 8;
        /// Bit 9: LRW is not supported.
        NO_LRW = 1 << 9;
        /// Bit 10: BRW, APRW and FPRW are not supported.
        NO_READ_WRITE = 1 << 10;
        /// Bit 11: the controller fixes what each FMMU and sync manager is used for; the master cannot choose.
        FIXED = 1 << 11;
    }

    /// SYNC activation, 0x0981: which SYNC pulses the slave's clock generates, and how their start time is handled.
    SyncActivation(u8) {
        /// Bit 0: the SYNC unit is active.
        ACTIVATE = 1 << 0;
        /// Bit 1: the unit generates SYNC0 pulses.
        SYNC0 = 1 << 1;
        /// Bit 2: the unit generates SYNC1 pulses.
        SYNC1 = 1 << 2;
        /// Bit 3: a write to the start time activates the unit.
        AUTO = 1 << 3;
        /// Bit 4: a start time of 32 bits is extended to 64 bits by the upper half of the system time.
        EXTEND_START = 1 << 4;
        /// Bit 5: the plausibility of the start time is checked.
        CHECK_START = 1 << 5;
        /// Bit 6: the check accepts only a start time that is less than 2^31 ns (2.1 s) ahead.
        NEAR_FUTURE = 1 << 6;
        /// Bit 7: generate a pulse immediately, for debugging.
        DEBUG_PULSE = 1 << 7;
    }

    /// Status of a latch input: 0x09AE for input 0, 0x09AF for input 1.
    LatchStatus(u8) {
        /// Bit 0: in single-event mode, a positive edge was captured and its time has not been read yet.
        POSITIVE = 1 << 0;
        /// Bit 1: in single-event mode, a negative edge was captured and its time has not been read yet.
        NEGATIVE = 1 << 1;
        /// Bit 2: the current level of the input.
        PIN = 1 << 2;
    }
}

/// The number of latch inputs of a controller.
pub const LATCHES: usize = 2;

/// An edge of a latch input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LatchEdge {
    /// The input changes from 0 to 1.
    Positive,
    /// The input changes from 1 to 0.
    Negative,
}

impl LatchEdge {
    /// Both edges.
    pub const ALL: [Self; 2] = [Self::Positive, Self::Negative];

    /// The bit of this edge in [`LatchStatus`], and in the latch control registers 0x09A8 and 0x09A9, where it selects
    /// single-event mode.
    pub const fn bit(self) -> u8 {
        match self {
            Self::Positive => LatchStatus::POSITIVE.0,
            Self::Negative => LatchStatus::NEGATIVE.0,
        }
    }
}

/// System time difference, 0x092C: the offset of the slave's clock to the system time that the slave received last from
/// the reference clock, as sign and magnitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SystemTimeDifference(pub u32);

impl SystemTimeDifference {
    /// Bit 31, the sign: the slave's time is smaller than the received time.
    pub const BEHIND: u32 = 1 << 31;

    /// The register value for a clock that is `ahead_ns` ahead of the received time. A magnitude above 31 bits is limited
    /// to the maximum.
    pub const fn of(ahead_ns: i64) -> Self {
        let magnitude = ahead_ns.unsigned_abs();
        let magnitude = if magnitude < Self::BEHIND as u64 { magnitude as u32 } else { Self::BEHIND - 1 };
        Self(if ahead_ns < 0 { magnitude | Self::BEHIND } else { magnitude })
    }

    /// How far the slave's clock is ahead of the received time, ns; negative if it is behind.
    pub const fn ahead_ns(self) -> i64 {
        let magnitude = (self.0 & !Self::BEHIND) as i64;
        if self.0 & Self::BEHIND != 0 { -magnitude } else { magnitude }
    }
}
