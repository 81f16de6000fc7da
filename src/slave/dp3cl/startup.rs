//! The checks of the drive before a change of its AL state, in their order \[OURS], and the alarm of each check.
//!
//! A network without slave controllers has no registers to check. There the drive checks only the mapping, the lengths of the
//! sync managers and the SYNC0 cycle time.

use super::alarms::Dp3clAlarm;
use super::config::Dp3clVariants;
use crate::ethercat::Ns;
use crate::slave::communication::{Communication, SyncManagerSettings};

/// The supported SYNC0 cycle times, ns.
pub(super) const SYNC0_CYCLES_NS: [Ns; 4] = [500_000, 1_000_000, 2_000_000, 4_000_000];
/// The two values that the drive accepts in bits 0 to 2 of register 0x0981 (SYNC unit, SYNC0, SYNC1): the SYNC unit generates
/// SYNC0 only, or it is off.
const SYNC0_ON: u8 = 0b011;
const SYNC_OFF: u8 = 0b000;
/// The bits of a sync manager's control byte that are checked \[OURS]. Bit 6, which enables the watchdog, is not among
/// them.
const CONTROL_MASK: u8 = 0x3F;
const WATCHDOG_BIT: u8 = 1 << 6;
/// The expected control bits of sync managers 0 to 3. \[OURS] The manual gives 100110b for all; these are the values of the
/// manufacturer's ESI file.
const CONTROLS: [u8; 4] = [0x26, 0x22, 0x24, 0x20];
/// The allowed start addresses of sync managers 0 and 1. \[OURS] For sync manager 1 the manual gives 0x1200 to 0x12FF, and
/// the manufacturer's ESI file has 0x1080.
const MAILBOX_OUT_STARTS: std::ops::RangeInclusive<u16> = 0x1000..=0x10FF;
const MAILBOX_IN_STARTS: std::ops::RangeInclusive<u16> = 0x1080..=0x12FF;
const MAILBOX_IN_STARTS_STRICT: std::ops::RangeInclusive<u16> = 0x1200..=0x12FF;
/// The allowed lengths of sync managers 0 and 1, bytes.
const MAILBOX_OUT_LENGTHS: std::ops::RangeInclusive<u16> = 32..=256;
const MAILBOX_IN_LENGTHS: std::ops::RangeInclusive<u16> = 40..=256;
/// The allowed addresses of sync managers 2 and 3: the process data RAM of the slave controller.
const PROCESS_DATA_AREA: std::ops::RangeInclusive<u16> = 0x1000..=0x1FFF;

/// A synchronization type, 0x1C32:1 or 0x1C33:1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SyncType {
    FreeRun,
    SyncManager,
    Sync0,
}

impl SyncType {
    fn of(value: u16) -> Option<Self> {
        match value {
            0x00 => Some(Self::FreeRun),
            // [OURS] 0x22, the sync manager 2 event, is the value of 0x1C33:1 in the manufacturer's ESI file.
            0x01 | 0x22 => Some(Self::SyncManager),
            0x02 => Some(Self::Sync0),
            _ => None,
        }
    }
}

/// Checks the mailbox sync managers on the change from Init to PreOP.
///
/// # Errors
/// [`Dp3clAlarm::MailboxSyncManager`] if one of them is off, has an invalid address, length or control byte, or overlaps
/// another sync manager.
pub(super) fn to_preop(communication: &Communication, variants: Dp3clVariants) -> Result<(), Dp3clAlarm> {
    let [out, input, data_out, data_in] = &communication.sync_managers;
    let in_starts = if variants.strict_sync_managers { MAILBOX_IN_STARTS_STRICT } else { MAILBOX_IN_STARTS };
    let fits = |sm: &SyncManagerSettings, starts: std::ops::RangeInclusive<u16>, lengths, control| {
        let lengths: std::ops::RangeInclusive<u16> = lengths;
        let even = sm.start.is_multiple_of(2);
        sm.enabled && even && starts.contains(&sm.start) && lengths.contains(&sm.length) && has_control(sm, control)
    };
    let good = fits(out, MAILBOX_OUT_STARTS, MAILBOX_OUT_LENGTHS, CONTROLS[0])
        && fits(input, in_starts, MAILBOX_IN_LENGTHS, CONTROLS[1])
        && !out.overlaps(input)
        && ![out, input].iter().any(|mailbox| mailbox.overlaps(data_out) || mailbox.overlaps(data_in));
    if good { Ok(()) } else { Err(Dp3clAlarm::MailboxSyncManager) }
}

fn has_control(sm: &SyncManagerSettings, control: u8) -> bool {
    sm.control & CONTROL_MASK == control
}

/// The settings that the change from PreOP to SafeOP depends on, besides the mapping.
#[derive(Clone, Copy, Debug)]
pub(super) struct SafeOpSettings {
    /// The registers of the slave controller; `None`: the network has no slave controllers.
    pub(super) communication: Option<Communication>,
    /// Bits 0 to 2 of register 0x0981 and the SYNC0 cycle time, ns; `None`: unknown.
    pub(super) dc: Option<(u8, Ns)>,
    /// The synchronization types 0x1C32:1 and 0x1C33:1.
    pub(super) sync_types: (u16, u16),
}

/// Checks the change from PreOP to SafeOP, after the checks of the mapping and the sync manager lengths. Returns whether
/// the drive runs by SYNC0.
///
/// # Errors
/// The alarm of the first setting that the drive refuses: a process data sync manager, a watchdog time of less than two
/// cycles, a synchronization type, the DC activation or the SYNC0 cycle time.
pub(super) fn to_safeop(settings: &SafeOpSettings) -> Result<bool, Dp3clAlarm> {
    let SafeOpSettings { communication, dc, sync_types } = settings;
    if let Some(communication) = communication {
        let [mail_out, mail_in, outputs, inputs] = &communication.sync_managers;
        check_process_data(outputs, [inputs, mail_out, mail_in], CONTROLS[2], Dp3clAlarm::OutputSyncManager)?;
        check_process_data(inputs, [outputs, mail_out, mail_in], CONTROLS[3], Dp3clAlarm::InputSyncManager)?;
        let period_ns = dc.map_or(0, |(activation, cycle_ns)| if activation == SYNC0_ON { cycle_ns } else { 0 });
        let triggers = outputs.enabled && outputs.control & WATCHDOG_BIT != 0;
        if triggers && communication.watchdog_ns.is_some_and(|ns| ns < 2 * period_ns) {
            return Err(Dp3clAlarm::WatchdogTime);
        }
    }
    let types = (SyncType::of(sync_types.0), SyncType::of(sync_types.1));
    let (Some(outputs), Some(inputs)) = types else { return Err(Dp3clAlarm::SyncType) };
    match *dc {
        None => Ok(outputs == SyncType::Sync0),
        Some((SYNC_OFF, _)) => {
            let fits = outputs == inputs && outputs != SyncType::Sync0;
            if fits { Ok(false) } else { Err(Dp3clAlarm::SyncType) }
        }
        Some((SYNC0_ON, cycle_ns)) if SYNC0_CYCLES_NS.contains(&cycle_ns) => Ok(true),
        Some((SYNC0_ON, _)) => Err(Dp3clAlarm::SyncCycle),
        Some(_) => Err(Dp3clAlarm::DcActivation),
    }
}

/// Checks sync manager 2 or 3. A sync manager that is off or has a length of 0 passes, because its length was compared
/// with the mapped process data before. \[OURS] The area of an active one must not overlap the area of any other sync
/// manager, including the mailboxes.
fn check_process_data(
    sm: &SyncManagerSettings,
    others: [&SyncManagerSettings; 3],
    control: u8,
    alarm: Dp3clAlarm,
) -> Result<(), Dp3clAlarm> {
    if !sm.enabled || sm.length == 0 {
        return Ok(());
    }
    let last = sm.start.checked_add(sm.length - 1);
    let inside = PROCESS_DATA_AREA.contains(&sm.start) && last.is_some_and(|last| PROCESS_DATA_AREA.contains(&last));
    let is_alone = !others.iter().any(|other| sm.overlaps(other));
    let good = inside && sm.start.is_multiple_of(2) && is_alone && has_control(sm, control);
    if good { Ok(()) } else { Err(alarm) }
}

/// For a network without slave controllers, which gives only the SYNC0 cycle time, ns (`None`: SYNC0 is off). Returns
/// the value that bits 0 to 2 of register 0x0981 would have, and the cycle time.
pub(super) const fn activation_of(cycle_ns: Option<Ns>) -> (u8, Ns) {
    match cycle_ns {
        Some(cycle_ns) => (SYNC0_ON, cycle_ns),
        None => (SYNC_OFF, 0),
    }
}
