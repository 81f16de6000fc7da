//! The part of CiA 402, the drive profile, that the ECM-SK uses: statusword, controlword, drive states, modes of operation
//! and error codes.
//!
//! Source: CiA 402-2 (IEC 61800-7-201), chapters 7 and 8. Section SK-7 of the rules lists what real drives answered.

use core::fmt;

/// Index of the object controlword.
pub const CONTROLWORD: u16 = 0x6040;
/// Index of the object statusword.
pub const STATUSWORD: u16 = 0x6041;
/// Index of the object modes of operation.
pub const MODES_OF_OPERATION: u16 = 0x6060;
/// Index of the object error code.
pub const ERROR_CODE: u16 = 0x603F;
/// The offset between an object of axis 1 and the same object of axis 2 of a two-channel HSP: 0x6060 becomes 0x6860
/// (SK-3).
pub const SECOND_AXIS_OFFSET: u16 = 0x800;

/// The meaning of an error code (object 0x603F) from the table of error codes in CiA 402 (IEC 61800-7-201). A code that the
/// table does not have gets the meaning of its class. Codes from 0xFF00 are manufacturer-specific: the drive's manual
/// explains them.
pub const fn error_name(code: u16) -> &'static str {
    match code {
        0x0000 => "no error",
        0x1000 => "generic error",
        0x2110 | 0x2120 | 0x2130 => "short circuit or earth leakage at the input",
        0x2211..=0x2214 => "overcurrent inside the device",
        0x2220 => "continuous overcurrent inside the device",
        0x2230 | 0x2240 | 0x2250 => "short circuit or earth leakage inside the device",
        0x2310..=0x2313 => "continuous overcurrent at the output",
        0x2320 | 0x2330 | 0x2340 => "short circuit or earth leakage on the motor's side",
        0x2350 => "load too high for too long (I2t)",
        0x3110..=0x3113 => "mains voltage too high",
        0x3120..=0x3123 => "mains voltage too low",
        0x3130..=0x3134 => "mains phase missing",
        0x3210..=0x3212 => "DC link voltage too high",
        0x3220..=0x3222 => "DC link voltage too low",
        0x4110 | 0x4310 | 0x4210 | 0x4410 => "temperature too high",
        0x4120 | 0x4320 | 0x4220 | 0x4420 => "temperature too low",
        0x5530 => "non-volatile memory of the device",
        0x6320 => "a parameter is wrong",
        0x7110..=0x7113 => "brake chopper",
        0x7121 => "motor blocked",
        0x7122 => "motor or its commutation",
        0x7300..=0x73FF => "sensor (encoder, resolver, tacho)",
        0x7500..=0x75FF => "communication",
        0x8311 => "torque too high",
        0x8400 => "velocity controller",
        0x8500 => "position controller",
        0x8611 => "following error",
        0x8612 => "position limit",
        0x2000..=0x2FFF => "current",
        0x3000..=0x3FFF => "voltage",
        0x4000..=0x4FFF => "temperature",
        0x5000..=0x5FFF => "hardware of the device",
        0x6000..=0x6FFF => "software of the device",
        0x7000..=0x7FFF => "additional modules (motor, brake, sensor)",
        0x8000..=0x80FF => "monitoring",
        0x8100..=0x81FF => "communication",
        0x8200..=0x8FFF => "monitoring of the motion",
        0x9000..=0x90FF => "external error",
        0xFF00..=0xFFFF => "of the maker's own, see the drive's manual",
        _ => "see the drive's manual",
    }
}

/// An error code (object 0x603F), displayed with its meaning, such as `0x8611: following error`. Code 0, which a drive in
/// Fault should not report, is displayed as `0x0000: it shows no error code`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ErrorCode(pub u16);

impl fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let meaning = if self.0 == 0 { "it shows no error code" } else { error_name(self.0) };
        write!(f, "0x{:04X}: {meaning}", self.0)
    }
}

/// State of a CiA 402 drive, decoded from its statusword.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DriveState {
    /// The drive initialises itself.
    NotReadyToSwitchOn,
    /// The power stage is off. The controlword Shutdown (0x06) leads to Ready to switch on.
    SwitchOnDisabled,
    /// The power stage may be switched on. The controlword Switch on (0x07) switches it on.
    ReadyToSwitchOn,
    /// The power stage is ready, and the motor has no torque. The controlword Enable operation (0x0F) leads to Operation
    /// enabled.
    SwitchedOn,
    /// The motor follows its targets.
    OperationEnabled,
    /// The drive brakes after a quick stop, or is at standstill after it.
    QuickStopActive,
    /// The drive reacts to a fault, for example by braking.
    FaultReactionActive,
    /// The drive has a fault and gives no torque. Only a fault reset leads out of this state.
    Fault,
}

impl DriveState {
    /// The value of bits 0 to 3, 5 and 6 of the statusword in this state. CiA 402 leaves bit 5 open in Not ready to
    /// switch on, Switch on disabled, Fault reaction active and Fault; it is 0 here.
    pub const fn status_bits(self) -> u8 {
        match self {
            Self::NotReadyToSwitchOn => 0x00,
            Self::SwitchOnDisabled => 0x40,
            Self::ReadyToSwitchOn => 0x21,
            Self::SwitchedOn => 0x23,
            Self::OperationEnabled => 0x27,
            Self::QuickStopActive => 0x07,
            Self::FaultReactionActive => 0x0F,
            Self::Fault => 0x08,
        }
    }

    /// The state's name in CiA 402.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotReadyToSwitchOn => "Not ready to switch on",
            Self::SwitchOnDisabled => "Switch on disabled",
            Self::ReadyToSwitchOn => "Ready to switch on",
            Self::SwitchedOn => "Switched on",
            Self::OperationEnabled => "Operation enabled",
            Self::QuickStopActive => "Quick stop active",
            Self::FaultReactionActive => "Fault reaction active",
            Self::Fault => "Fault",
        }
    }
}

impl fmt::Display for DriveState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The statusword, object 0x6041: the state of the CiA 402 state machine and flags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Statusword(pub u16);

impl Statusword {
    /// Mask of bits 0 to 3, 5 and 6, which encode the drive state.
    pub const STATE_BITS: u16 = 0x006F;
    /// Bit 3: fault.
    pub const FAULT: u16 = 1 << 3;
    /// Bit 4: voltage enabled.
    pub const VOLTAGE_ENABLED: u16 = 1 << 4;
    /// Bit 5: quick stop; 0 while a quick stop is active.
    pub const QUICK_STOP: u16 = 1 << 5;
    /// Bit 7: warning.
    pub const WARNING: u16 = 1 << 7;
    /// Bit 9: remote, the drive obeys the controlword.
    pub const REMOTE: u16 = 1 << 9;
    /// Bit 10: target reached.
    pub const TARGET_REACHED: u16 = 1 << 10;
    /// Bit 11: internal limit active.
    pub const INTERNAL_LIMIT: u16 = 1 << 11;
    /// Bit 12, whose meaning depends on the mode: in CSP, CSV and CST the drive follows its target, in homing mode homing
    /// is attained.
    pub const BIT12: u16 = 1 << 12;
    /// Bit 13, whose meaning depends on the mode: in CSP a following error, in homing mode a homing error.
    pub const BIT13: u16 = 1 << 13;

    /// The state of the drive; `None` for a pattern of bits that CiA 402 does not define.
    #[inline]
    pub const fn state(self) -> Option<DriveState> {
        STATES[(self.0 & Self::STATE_BITS) as usize]
    }

    /// Whether the drive is in the state Operation enabled.
    pub const fn is_enabled(self) -> bool {
        self.0 & Self::STATE_BITS == 0x27
    }
}

/// Drive state by the value of statusword bits 0 to 3, 5 and 6. A table, because the engine looks up each axis in each
/// cycle.
static STATES: [Option<DriveState>; 0x70] = {
    let mut states = [None; 0x70];
    let mut word = 0;
    while word < states.len() {
        states[word] = match (word & 0x4F, word & 0x6F) {
            (0x00, _) => Some(DriveState::NotReadyToSwitchOn),
            (0x40, _) => Some(DriveState::SwitchOnDisabled),
            (_, 0x21) => Some(DriveState::ReadyToSwitchOn),
            (_, 0x23) => Some(DriveState::SwitchedOn),
            (_, 0x27) => Some(DriveState::OperationEnabled),
            (_, 0x07) => Some(DriveState::QuickStopActive),
            (0x0F, _) => Some(DriveState::FaultReactionActive),
            (0x08, _) => Some(DriveState::Fault),
            _ => None,
        };
        word += 1;
    }
    states
};

/// The controlword, object 0x6040: the commands to the CiA 402 state machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Controlword(pub u16);

impl Controlword {
    /// Disable voltage: leads to Switch on disabled.
    pub const DISABLE_VOLTAGE: Self = Self(0x00);
    /// Quick stop: an enabled drive brakes on its quick-stop ramp and then switches its power stage off, unless 0x605A says
    /// otherwise.
    pub const QUICK_STOP: Self = Self(0x02);
    /// Shutdown: leads to Ready to switch on.
    pub const SHUTDOWN: Self = Self(0x06);
    /// Switch on: leads to Switched on. In Operation enabled the same bits disable operation.
    pub const SWITCH_ON: Self = Self(0x07);
    /// Enable operation: leads to Operation enabled.
    pub const ENABLE_OPERATION: Self = Self(0x0F);
    /// Bit 4: in homing mode, start homing.
    pub const HOMING_START: u16 = 1 << 4;
    /// Bit 7: its rising edge resets a fault.
    pub const FAULT_RESET: u16 = 1 << 7;
    /// Bit 8: halts the motion; in homing mode it interrupts homing.
    pub const HALT: u16 = 1 << 8;
}

/// A mode of operation (object 0x6060) that the ECM-SK uses (UG17 2.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Mode {
    /// Homing.
    Homing = 6,
    /// Cyclic synchronous position.
    Csp = 8,
    /// Cyclic synchronous velocity.
    Csv = 9,
    /// Cyclic synchronous torque.
    Cst = 10,
}

impl Mode {
    /// The mode with this value of 0x6060; `None` for a mode that the ECM-SK does not use.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            6 => Some(Self::Homing),
            8 => Some(Self::Csp),
            9 => Some(Self::Csv),
            10 => Some(Self::Cst),
            _ => None,
        }
    }

    /// The mode's value in 0x6060.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The usual abbreviation: HM, CSP, CSV or CST.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Homing => "HM",
            Self::Csp => "CSP",
            Self::Csv => "CSV",
            Self::Cst => "CST",
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
