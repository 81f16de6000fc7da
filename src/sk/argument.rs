//! The arguments of commands as types that hold valid values only, and [`InvalidArgument`], the error for an argument that
//! the guides do not allow.

use core::fmt;

use crate::ethercat::coe::ObjectAddress;

/// The value of one argument of a command, for formats that show a command's arguments by name, such as JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Argument {
    /// A number, in the unit that the argument's name contains, such as `cycle_us`.
    Number(i64),
    /// On or off, for an argument that is a switch.
    Flag(bool),
    /// One word of a fixed set, such as a state or a kind of slave.
    Word(&'static str),
    /// The kinds of the eight slaves of one SET_AXIS command.
    Kinds([SlaveKind; 8]),
    /// The index and sub-index of an object.
    Object(ObjectAddress),
    /// The target and the outputs of an axis.
    Axis(AxisTarget),
}

/// The target of one axis and, for a pulse module (HSP), its digital outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AxisTarget {
    /// CSP: the absolute target position in counts. CSV: the target velocity, object 0x60FF, in the velocity unit of
    /// the drive: counts/s unless the drive scales it.
    pub target: i32,
    /// Digital outputs of an HSP, bit k is output k; a drive ignores them.
    pub outputs: u16,
}

/// The actions of SET_FIFO on the command FIFO (UG17 2.1.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FifoAction {
    /// 1: drop all entries and cancel a threshold.
    Clear,
    /// 2: set a threshold of 1 or more. The board executes no entry until fewer than this many entries are free, so
    /// that the FIFO is filled before motion begins.
    Threshold(u32),
}

/// The kind of slave that a slot belongs to. The host declares it with SET_AXIS, one nibble per slave (UG17 2.1.3), and
/// the board chooses the slave's process data by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum SlaveKind {
    /// Servo drive.
    Drive = 0,
    /// 16 digital inputs and 16 digital outputs. A slave counts as this kind until SET_AXIS declares it.
    #[default]
    Io = 1,
    /// NEXTW high-speed pulse module, one or two channels.
    Hsp = 2,
    /// Stepper drive (OBS: seen in programs that work with real boards).
    Step = 3,
    /// No slave: the slot is not used.
    None = 0xF,
}

impl SlaveKind {
    /// The kind that a nibble of SET_AXIS declares, `None` for 4..=14.
    pub const fn from_nibble(nibble: u8) -> Option<Self> {
        match nibble {
            0 => Some(Self::Drive),
            1 => Some(Self::Io),
            2 => Some(Self::Hsp),
            3 => Some(Self::Step),
            0xF => Some(Self::None),
            _ => None,
        }
    }

    /// The nibble of SET_AXIS: 0..=3 or 0xF.
    pub const fn nibble(self) -> u8 {
        self as u8
    }

    /// The name in NEXTW's guides, such as `DRIVE`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "DRIVE",
            Self::Io => "IO",
            Self::Hsp => "HSP",
            Self::Step => "STEP",
            Self::None => "None",
        }
    }

    /// The name in a readable dump of a frame: as in the guides, but `none` in lower case.
    pub(super) const fn dump_name(self) -> &'static str {
        match self {
            Self::None => "none",
            named => named.name(),
        }
    }
}

/// An EtherCAT cycle time that SET_DC accepts: 250 us * 2^n with n in 0..=11, so 250 us to 512 ms (UG17 2.1.4; the
/// upper limit is \[OURS\]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CycleTime(u32);

impl CycleTime {
    /// 1000 us, the board's cycle time until SET_DC changes it.
    pub const DEFAULT: Self = Self(1000);
    /// The upper limit of a cycle time, in microseconds. SK-4 `[OURS]`: no cycle is longer than a second.
    const MAX_US: u32 = 1_000_000;

    /// The cycle time of `us` microseconds; `None` unless that is 250 * 2^n and at most 1 s.
    pub const fn from_us(us: u32) -> Option<Self> {
        if us <= Self::MAX_US && us.is_multiple_of(250) && (us / 250).is_power_of_two() { Some(Self(us)) } else { None }
    }

    /// The cycle time in microseconds.
    pub const fn us(self) -> u32 {
        self.0
    }

    /// The cycle time in nanoseconds.
    pub const fn ns(self) -> u64 {
        self.0 as u64 * 1000
    }
}

/// Data2 of SET_DC: the shift of the SYNC0 event relative to the frame. Applications request the automatic shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DcShift {
    /// 0xFFFF, automatic: the value that applications send.
    Auto,
    /// 0xFFFF0000, automatic as well: the value that the guide's text prints.
    AutoHigh,
    /// Any other value: accepted without effect.
    Other(u32),
}

impl DcShift {
    pub(super) const fn from_raw(raw: u32) -> Self {
        match raw {
            0xFFFF => Self::Auto,
            0xFFFF_0000 => Self::AutoHigh,
            other => Self::Other(other),
        }
    }

    pub(super) const fn raw(self) -> u32 {
        match self {
            Self::Auto => 0xFFFF,
            Self::AutoHigh => 0xFFFF_0000,
            Self::Other(raw) => raw,
        }
    }
}

/// How a slave is synchronised: the argument DRIVE_TYPE in Data2 of DRIVE_MODE (UG17 2.1.7). `[OURS]` Any value but 0
/// means DC sync, the default, because programs reuse a slot and leave an earlier command's argument in Data2, such as
/// SET_DC's 0xFFFF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum DriveSync {
    /// 0: each slave runs on its own clock.
    FreeRun = 0,
    /// 1: synchronised by distributed clocks, the default.
    #[default]
    DcSync = 1,
}

/// A torque in 0.1 % of the rated torque, displayed as a percentage.
pub(super) struct TorquePercent(pub i16);

impl fmt::Display for TorquePercent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (sign, tenths) = (if self.0 < 0 { "-" } else { "" }, self.0.unsigned_abs());
        write!(f, "{sign}{}.{} %", tenths / 10, tenths % 10)
    }
}

/// The argument of a command that the guides do not allow. The modelled board rejects such a command with this reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InvalidArgument {
    /// SET_STATE: Data1, the requested state, is not 1 (Init), 2 (PreOP), 4 (SafeOP) or 8 (OP).
    State(u32),
    /// SET_AXIS: byte 2 of the slot, the number of the group of eight slaves, is above 4. The groups 0 to 4 have all 40
    /// slaves.
    Group(u8),
    /// SET_AXIS: the nibble of this slave is 4..=14, which stands for no kind.
    Kind {
        /// The slave's number, 1..=40.
        slave: u8,
        /// The value of the nibble, 4..=14.
        nibble: u8,
    },
    /// SET_DC: Data1, the cycle time in microseconds, is not 250 us * 2^n, or is more than 1 s.
    CycleTime(u32),
    /// SET_FIFO: byte 2 of the slot, the action ([`FifoAction`]), is neither 1 nor 2.
    FifoAction(u8),
    /// SET_FIFO 2 with Data1 = 0: the FIFO starts once fewer entries than Data1 are free, so with 0 it would never
    /// start.
    ZeroThreshold,
    /// DRIVE_MODE: Data1, the mode of operation, is not 8 (CSP), 9 (CSV) or 10 (CST).
    DriveMode(u32),
    /// SDO_RD, SDO_WR: the slave number is 0, or above 40 (30 in 16-byte mode).
    SdoSlave(u16),
    /// SDO_RD, SDO_WR: the sub-index, the low half of Data1, is above 255.
    SubIndex(u16),
    /// SDO_WR: the size in bytes, the high byte of Parm, is not 1, 2 or 4.
    SdoSize(u8),
}

impl fmt::Display for InvalidArgument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::State(state) => write!(f, "state {state} is none of 1 Init, 2 PreOP, 4 SafeOP, 8 OP"),
            Self::Group(group) => write!(f, "group {group} is above 4"),
            Self::Kind { slave, nibble } => {
                write!(f, "slave {slave} has kind 0x{nibble:X}: none of 0 drive, 1 IO, 2 HSP, 3 STEP, F none")
            }
            Self::CycleTime(us) => write!(f, "cycle time {us} us is not 250 us * 2^n up to 1 s"),
            Self::FifoAction(code) => write!(f, "FIFO action {code} is neither 1 clear nor 2 threshold"),
            Self::ZeroThreshold => write!(f, "FIFO threshold 0 could never be reached"),
            Self::DriveMode(mode) => write!(f, "mode {mode} is none of 8 CSP, 9 CSV, 10 CST"),
            Self::SdoSlave(slave) => write!(f, "the board has no slave {slave}"),
            Self::SubIndex(sub) => write!(f, "sub-index {sub} is above 255"),
            Self::SdoSize(bytes) => write!(f, "object size {bytes} is none of 1, 2, 4 bytes"),
        }
    }
}

impl core::error::Error for InvalidArgument {}
