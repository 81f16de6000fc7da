//! The alarms of the drive: E-800 to E-882 of the EtherCAT side, and the alarms that the red LED flashes.

use crate::ethercat::AlStatus;
use crate::slave::state_machine::DeviceFault;

/// The number of earlier alarms in the history U1-10 to U1-14.
const HISTORY: usize = 5;
/// \[OURS] The error code of an alarm, 0x603F, is this value plus the main number of the alarm, which is its number
/// without the last digit. The manual reserves the codes from 0xFF00 for the manufacturer and says that 0x603F shows
/// only the main number.
const MAKER_CODES: u16 = 0xFF00;

/// An alarm of the drive. The value of a variant is the number of the alarm; for an alarm without a number, it is the
/// number of LED flashes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Dp3clAlarm {
    /// E-800: an invalid change of the AL state was requested.
    InvalidChange = 800,
    /// E-801: an unknown AL state was requested.
    UnknownState = 801,
    /// E-802: bootstrap was requested.
    Bootstrap = 802,
    /// E-803: the PLL did not lock within 1 s.
    NotSynchronized = 803,
    /// E-804: no outputs came within the watchdog time.
    Watchdog = 804,
    /// E-806: the PLL has lost its lock.
    PhaseLost = 806,
    /// E-807: SYNC0 came too late or too early in too many consecutive cycles.
    SyncDeviation = 807,
    /// E-810: the SYNC0 cycle time is not 500 us, 1 ms, 2 ms or 4 ms.
    SyncCycle = 810,
    /// E-811: a mailbox sync manager has invalid settings.
    MailboxSyncManager = 811,
    /// E-814: the watchdog time is less than two cycles.
    WatchdogTime = 814,
    /// E-815: bits 0 to 2 of register 0x0981 have an unsupported value: neither SYNC0 alone nor everything off.
    DcActivation = 815,
    /// E-816: the synchronization types 0x1C32:1 and 0x1C33:1 are not supported, or they do not fit each other or register
    /// 0x0981.
    SyncType = 816,
    /// E-817: sync manager 2 has invalid settings, or its length is not that of the mapped outputs.
    OutputSyncManager = 817,
    /// Also E-817: sync manager 3 has invalid settings, or its length is not that of the mapped inputs. Bit 15 only
    /// distinguishes the two variants; [`Dp3clAlarm::number`] removes it.
    InputSyncManager = 0x8000 | 817,
    /// E-850: the assigned TxPDOs are longer than 24 bytes, or cannot be mapped.
    InputsTooLong = 850,
    /// E-851: the assigned RxPDOs are longer than 24 bytes, or cannot be mapped.
    OutputsTooLong = 851,
    /// E-881: the drive was enabled without a mode of operation, or in an unsupported one.
    Mode = 881,
    /// E-882: a change of the AL state was requested while the drive was enabled.
    ChangeWhileEnabled = 882,
    /// One flash of the red LED: overcurrent or short circuit.
    OverCurrent = 1,
    /// Two flashes of the red LED: overvoltage.
    OverVoltage = 2,
    /// Three flashes of the red LED: undervoltage.
    UnderVoltage = 3,
    /// Four flashes of the red LED: no motor is connected.
    OpenMotor = 4,
}

impl Dp3clAlarm {
    /// Every alarm of the drive, in the order of this enum.
    pub const ALL: [Self; 22] = [
        Self::InvalidChange,
        Self::UnknownState,
        Self::Bootstrap,
        Self::NotSynchronized,
        Self::Watchdog,
        Self::PhaseLost,
        Self::SyncDeviation,
        Self::SyncCycle,
        Self::MailboxSyncManager,
        Self::WatchdogTime,
        Self::DcActivation,
        Self::SyncType,
        Self::OutputSyncManager,
        Self::InputSyncManager,
        Self::InputsTooLong,
        Self::OutputsTooLong,
        Self::Mode,
        Self::ChangeWhileEnabled,
        Self::OverCurrent,
        Self::OverVoltage,
        Self::UnderVoltage,
        Self::OpenMotor,
    ];

    /// The number of the alarm, as U1-00 shows it: 801 for E-801. An alarm without a number is shown as its number of LED
    /// flashes \[OURS].
    pub const fn number(self) -> u16 {
        self as u16 & 0x7FFF
    }

    /// The meaning of the alarm with its number, as text.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::InvalidChange => "an AL state was requested that cannot follow the present one, E-800",
            Self::UnknownState => "an AL state was requested that does not exist, E-801",
            Self::Bootstrap => "bootstrap was requested, E-802",
            Self::NotSynchronized => "not synchronised with SYNC0 within 1 s, E-803",
            Self::Watchdog => "no outputs came within the time of the watchdog, E-804",
            Self::PhaseLost => "the synchronisation with SYNC0 was lost, E-806",
            Self::SyncDeviation => "SYNC0 came too early or too late in several cycles, E-807",
            Self::SyncCycle => "the cycle of SYNC0 is none of 0.5, 1, 2 and 4 ms, E-810",
            Self::MailboxSyncManager => "a sync manager of the mailbox is set wrongly, E-811",
            Self::WatchdogTime => "the time of the watchdog is less than two cycles, E-814",
            Self::DcActivation => "register 0x0981 has neither SYNC0 alone nor nothing on, E-815",
            Self::SyncType => "the synchronisation types 0x1C32:1 and 0x1C33:1 do not fit, E-816",
            Self::OutputSyncManager => "sync manager 2 is not set as the outputs are mapped, E-817",
            Self::InputSyncManager => "sync manager 3 is not set as the inputs are mapped, E-817",
            Self::InputsTooLong => "the inputs that are mapped are too long, E-850",
            Self::OutputsTooLong => "the outputs that are mapped are too long, E-851",
            Self::Mode => "enabled without a mode in 0x6060 that the drive has, E-881",
            Self::ChangeWhileEnabled => "a change of the AL state while enabled, E-882",
            Self::OverCurrent => "over current or short circuit",
            Self::OverVoltage => "over voltage",
            Self::UnderVoltage => "under voltage",
            Self::OpenMotor => "no motor",
        }
    }

    /// The AL status code that the drive shows when this alarm makes it refuse an AL state or leave one; 0 if the alarm
    /// does not concern the AL state.
    pub const fn al_status(self) -> AlStatus {
        match self {
            Self::InvalidChange => AlStatus::INVALID_CHANGE,
            Self::UnknownState => AlStatus::UNKNOWN_STATE,
            Self::Bootstrap => AlStatus::BOOT_UNSUPPORTED,
            Self::NotSynchronized => AlStatus::NO_SYNC,
            Self::Watchdog => AlStatus::WATCHDOG,
            Self::PhaseLost => AlStatus::PLL,
            Self::SyncDeviation => AlStatus::FATAL_SYNC,
            Self::SyncCycle => AlStatus::INVALID_DC_CYCLE,
            Self::MailboxSyncManager => AlStatus::INVALID_MAILBOX,
            Self::WatchdogTime => AlStatus::INVALID_WATCHDOG,
            Self::DcActivation => AlStatus::INVALID_DC_SYNC,
            Self::SyncType => AlStatus::SYNC_MODE_UNSUPPORTED,
            Self::OutputSyncManager => AlStatus::INVALID_OUTPUTS,
            Self::InputSyncManager => AlStatus::INVALID_INPUTS,
            Self::InputsTooLong => AlStatus::INVALID_INPUT_MAPPING,
            Self::OutputsTooLong => AlStatus::INVALID_OUTPUT_MAPPING,
            _ => AlStatus::NONE,
        }
    }

    /// The alarm that has this AL status code; `None`: no alarm has this code, or the code is 0.
    pub fn of_al_status(status: AlStatus) -> Option<Self> {
        Self::ALL.into_iter().find(|alarm| status.0 != 0 && alarm.al_status() == status)
    }

    /// The error code, 0x603F. \[OURS] Alarms that the LED flashes have the codes of IEC 61800-7-201.
    pub const fn error_code(self) -> u16 {
        match self {
            Self::OverCurrent => 0x2310,
            Self::OverVoltage => 0x3210,
            Self::UnderVoltage => 0x3220,
            Self::OpenMotor => 0x7120,
            numbered => MAKER_CODES + numbered.number() / 10,
        }
    }

    /// The bits of the error register, 0x1001: bit 4 for an alarm with an AL status code, otherwise bit 7.
    pub const fn error_register(self) -> u8 {
        if self.al_status().0 != 0 { 1 << 4 } else { 1 << 7 }
    }

    /// Whether the alarm lasts until the drive is switched off and on. \[OURS] A fault reset by the controlword does
    /// not clear such an alarm.
    pub const fn needs_restart(self) -> bool {
        matches!(self, Self::OverCurrent | Self::OverVoltage | Self::OpenMotor)
    }

    /// The fault that the alarm raises in the CiA 402 state machine.
    pub(super) const fn fault(self) -> DeviceFault {
        DeviceFault { code: self.error_code(), resettable: !self.needs_restart() }
    }

    /// The first alarm with this error code. An error code of an alarm that the LED flashes belongs to this alarm only.
    /// `None`: no alarm has this code.
    pub(super) fn of_error_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|alarm| alarm.error_code() == code)
    }
}

/// The values that the drive stores when an alarm occurs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AlarmRecord {
    pub(super) phase_a_ma: i16,
    pub(super) phase_b_ma: i16,
    pub(super) current_ma: i16,
    pub(super) voltage_v: i16,
    pub(super) position_offset: i16,
    pub(super) speed_rpm: i16,
    /// Time of the alarm, seconds since power-on.
    pub(super) seconds: u32,
}

/// The present alarm and the alarm history.
#[derive(Clone, Debug, Default)]
pub(super) struct Alarms {
    present: Option<Dp3clAlarm>,
    record: AlarmRecord,
    /// The numbers of the alarms, newest first: the last one, which may still be present, and five earlier ones; 0: no
    /// alarm.
    numbers: [u16; HISTORY + 1],
    /// The number of alarms since power-on.
    count: u16,
}

impl Alarms {
    /// Records a new alarm.
    pub(super) fn note(&mut self, alarm: Dp3clAlarm, record: AlarmRecord) {
        (self.present, self.record) = (Some(alarm), record);
        self.numbers.rotate_right(1);
        self.numbers[0] = alarm.number();
        self.count = self.count.saturating_add(1);
    }

    /// Ends the present alarm. It stays in the history.
    pub(super) const fn clear(&mut self) {
        self.present = None;
    }

    /// Resets what a power cycle resets: there is no present alarm, and the count begins at 0. The history and the
    /// values of the last alarm are kept.
    pub(super) const fn restart(&mut self) {
        (self.present, self.count) = (None, 0);
    }

    /// The present alarm. `None`: there is no alarm.
    pub(super) const fn present(&self) -> Option<Dp3clAlarm> {
        self.present
    }

    /// U1-00: the number of the present alarm, or 0.
    pub(super) fn current(&self) -> u16 {
        self.present.map_or(0, Dp3clAlarm::number)
    }

    /// U1-01 to U1-08: the values stored at the last alarm.
    pub(super) const fn record(&self) -> &AlarmRecord {
        &self.record
    }

    /// U1-09: the number of alarms since power-on.
    pub(super) const fn count(&self) -> u16 {
        self.count
    }

    /// U1-10 to U1-14: the number of an earlier alarm; `place` 0 is the alarm before the last one.
    pub(super) fn earlier(&self, place: usize) -> u16 {
        self.numbers.get(place + 1).copied().unwrap_or(0)
    }
}
