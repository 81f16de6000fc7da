//! Every alarm of a DP3CL: its number, its AL status code, its bit of 0x1001, its error code.

use ecmsk::slave::AlStatus;
use ecmsk::slave::dp3cl::Dp3clAlarm;

/// The alarm, its number, its AL status code, its bit of the error register, its error code, whether it needs a restart.
const TABLE: [(Dp3clAlarm, u16, u16, u8, u16, bool); 22] = [
    (Dp3clAlarm::InvalidChange, 800, 0x0011, 4, 0xFF50, false),
    (Dp3clAlarm::UnknownState, 801, 0x0012, 4, 0xFF50, false),
    (Dp3clAlarm::Bootstrap, 802, 0x0013, 4, 0xFF50, false),
    (Dp3clAlarm::NotSynchronized, 803, 0x002D, 4, 0xFF50, false),
    (Dp3clAlarm::Watchdog, 804, 0x001B, 4, 0xFF50, false),
    (Dp3clAlarm::PhaseLost, 806, 0x0032, 4, 0xFF50, false),
    (Dp3clAlarm::SyncDeviation, 807, 0x002C, 4, 0xFF50, false),
    (Dp3clAlarm::SyncCycle, 810, 0x0035, 4, 0xFF51, false),
    (Dp3clAlarm::MailboxSyncManager, 811, 0x0016, 4, 0xFF51, false),
    (Dp3clAlarm::WatchdogTime, 814, 0x001F, 4, 0xFF51, false),
    (Dp3clAlarm::DcActivation, 815, 0x0030, 4, 0xFF51, false),
    (Dp3clAlarm::SyncType, 816, 0x0028, 4, 0xFF51, false),
    (Dp3clAlarm::OutputSyncManager, 817, 0x001D, 4, 0xFF51, false),
    (Dp3clAlarm::InputSyncManager, 817, 0x001E, 4, 0xFF51, false),
    (Dp3clAlarm::InputsTooLong, 850, 0x0024, 4, 0xFF55, false),
    (Dp3clAlarm::OutputsTooLong, 851, 0x0025, 4, 0xFF55, false),
    (Dp3clAlarm::Mode, 881, 0, 7, 0xFF58, false),
    (Dp3clAlarm::ChangeWhileEnabled, 882, 0, 7, 0xFF58, false),
    (Dp3clAlarm::OverCurrent, 1, 0, 7, 0x2310, true),
    (Dp3clAlarm::OverVoltage, 2, 0, 7, 0x3210, true),
    (Dp3clAlarm::UnderVoltage, 3, 0, 7, 0x3220, false),
    (Dp3clAlarm::OpenMotor, 4, 0, 7, 0x7120, true),
];

/// DP3CL-5.1 DP3CL-5.19 All codes of an alarm.
#[test]
fn codes() {
    for (alarm, number, al_status, bit, error_code, needs_restart) in TABLE {
        assert_eq!(alarm.number(), number, "{alarm:?}");
        assert_eq!(alarm.al_status(), AlStatus(al_status), "{alarm:?}");
        assert_eq!(alarm.error_register(), 1 << bit, "{alarm:?}");
        assert_eq!((alarm.error_code(), alarm.needs_restart()), (error_code, needs_restart), "{alarm:?}");
        if al_status != 0 {
            assert_eq!(Dp3clAlarm::of_al_status(alarm.al_status()), Some(alarm));
        }
    }
    assert_eq!(Dp3clAlarm::ALL, TABLE.map(|(alarm, ..)| alarm), "there are no others");
    assert_eq!(Dp3clAlarm::of_al_status(AlStatus::NONE), None);
}
