//! Random writes and outputs of a master, in any order, with random faults.

use ecmsk::cia402::DriveState;
use ecmsk::coe::ObjectListType;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::slave::dp3cl::{Dp3cl, Dp3clConfig, Dp3clMode, Dp3clVariants, Rating};
use ecmsk::slave::{DeviceFault, Fault, Input, InputPattern, Slave, SyncEvent};
use proptest::prelude::*;

use super::bench::{MS, read};
use crate::wired::jam;

#[derive(Clone, Debug)]
enum Action {
    /// An SDO to the object with this index in the list.
    Write(usize, u8, Vec<u8>),
    Mode(i8),
    Word(u16),
    Target(i32),
    Step(u64),
    Enter(u8),
    Fault(Fault),
    Supply(u32),
    Sync(SyncEvent),
    Watchdog,
    Restart,
}

fn faults() -> impl Strategy<Value = Fault> {
    let code = prop_oneof![Just(0x2310), Just(0x3220), Just(0xFF50), Just(0x7305), any::<u16>()];
    let input = proptest::sample::select(&Input::ALL[..]);
    prop_oneof![
        (code, any::<bool>())
            .prop_map(|(code, resettable)| Fault::Alarm { axis: 0, fault: DeviceFault { code, resettable } }),
        (proptest::option::of(input), proptest::option::of(any::<bool>())).prop_map(|(input, value)| Fault::Stick {
            axis: 0,
            input,
            value
        }),
        any::<bool>().prop_map(jam),
        proptest::option::of(any::<u16>())
            .prop_map(|bits| Fault::ForceInputs { channel: 0, pattern: bits.map(InputPattern::Bits) }),
    ]
}

fn actions() -> impl Strategy<Value = Action> {
    let usual = proptest::sample::select(&[0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x1F, 0x3F, 0x7F, 0x10F, 0x80][..]);
    let word = prop_oneof![4 => usual, 1 => any::<u16>()];
    let time = prop_oneof![4 => proptest::sample::select(&[MS, MS, MS / 2, 4 * MS, 50 * MS][..]), 1 => 1_u64..3 * MS];
    let state = prop_oneof![4 => proptest::sample::select(&[1, 2, 4, 4, 8, 8, 8][..]), 1 => 0_u8..16];
    let sync = prop_oneof![
        Just(SyncEvent::InTime),
        Just(SyncEvent::Deviation),
        Just(SyncEvent::NotLocked),
        Just(SyncEvent::LockLost)
    ];
    prop_oneof![
        6 => (any::<usize>(), 0_u8..4, proptest::collection::vec(any::<u8>(), 0..6)).prop_map(|(n, sub, value)| Action::Write(n, sub, value)),
        3 => prop_oneof![Just(0), Just(1), Just(3), Just(6), Just(8), any::<i8>()].prop_map(Action::Mode),
        10 => word.prop_map(Action::Word),
        8 => prop_oneof![-100_000_i32..100_000, any::<i32>()].prop_map(Action::Target),
        20 => time.prop_map(Action::Step),
        3 => state.prop_map(Action::Enter),
        2 => faults().prop_map(Action::Fault),
        1 => (0_u32..90_000).prop_map(Action::Supply),
        1 => sync.prop_map(Action::Sync),
        1 => Just(Action::Watchdog),
        1 => Just(Action::Restart),
    ]
}

fn configs() -> impl Strategy<Value = Dp3clConfig> {
    let rating = proptest::sample::select(&[Rating::A3, Rating::A7, Rating::A8][..]);
    (rating, any::<u8>(), proptest::array::uniform5(any::<bool>()), -50_000_i64..50_000).prop_map(
        |(
            rating,
            dial,
            [strict_sync_managers, ten_entries, one_deep_buffer, speeds_in_units, without_index],
            position,
        )| {
            let variants =
                Dp3clVariants { strict_sync_managers, ten_entries, one_deep_buffer, speeds_in_units, without_index };
            let dial = ecmsk::slave::dp3cl::Dial(dial);
            Dp3clConfig { rating, dial, variants, position, ..Dp3clConfig::default() }
        },
    )
}

/// Whether the motor has current.
fn has_power(drive: &Dp3cl) -> bool {
    use DriveState::{FaultReactionActive, OperationEnabled, QuickStopActive};
    matches!(drive.statusword().state(), Some(OperationEnabled | QuickStopActive | FaultReactionActive))
}

/// Invariants after a step of the drive.
fn check(drive: &mut Dp3cl) {
    let state = drive.statusword().state().expect("a state of CiA 402");
    let is_faulty = matches!(state, DriveState::Fault | DriveState::FaultReactionActive);
    assert_eq!(is_faulty, drive.axis().machine().fault().is_some(), "{state}");
    assert!(is_faulty || drive.alarm().is_none(), "{:?} in {state}", drive.alarm());
    assert!(has_power(drive) || drive.motor_ma() == 0, "{state}");
    if drive.state() != AlState::Init {
        assert_eq!(read(drive, 0x603F, 0) == Ok(0), !is_faulty);
        assert_eq!(read(drive, 0x1001, 0) == Ok(0), !is_faulty);
        assert_eq!(read(drive, 0x6041, 0), Ok(drive.statusword().0.into()));
        let mode = read(drive, 0x6061, 0).expect("it can be read");
        assert!(Dp3clMode::from_code(mode as i8).is_some());
    }
}

proptest! {
    // A case takes many cycles.
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// DP3CL-5.1 DP3CL-6.15 Any actions: no state outside the diagrams, an alarm is a fault and a fault shows.
    #[test]
    fn any_actions(config in configs(), actions in proptest::collection::vec(actions(), 1..120)) {
        let mut drive = Dp3cl::new(config);
        let objects = drive.object_list(ObjectListType::All);
        drive.enter(AlState::PreOp).expect("it has a mailbox");
        drive.set_sync_managers(8, 19);
        let (mut word, mut target) = (0_u16, 0_i32);
        for action in actions {
            match action {
                Action::Write(n, sub, value) => {
                    let at = ObjectAddress::new(objects[n % objects.len()], sub);
                    let _ = drive.write(at, SdoScope::Entry, &value);
                }
                Action::Mode(mode) => {
                    let _ = drive.write(ObjectAddress::new(0x6060, 0), SdoScope::Entry, &[mode as u8]);
                }
                Action::Word(bits) => word = bits,
                Action::Target(position) => target = position,
                Action::Step(ns) => {
                    let mut image = [0; 24];
                    image[..2].copy_from_slice(&word.to_le_bytes());
                    image[2..6].copy_from_slice(&target.to_le_bytes());
                    drive.exchange(Some(&image), &mut [0; 24]);
                    let (before, had_power) = (drive.axis().plant().position(), has_power(&drive));
                    drive.step(ns);
                    let moves = drive.axis().plant().position() != before;
                    prop_assert!(!moves || had_power || has_power(&drive), "without power nothing moves");
                    check(&mut drive);
                }
                Action::Enter(code) => {
                    drive.set_sync_managers(8, 19);
                    let was = drive.state();
                    let answer = drive.request_state(RequestedState::from_code(code));
                    prop_assert!(answer.is_err() || drive.state() as u8 == code);
                    prop_assert!(answer.is_ok() || drive.state() <= was);
                }
                Action::Fault(fault) => {
                    drive.apply_fault(fault);
                }
                Action::Supply(mv) => drive.set_supply(mv),
                Action::Sync(event) => drive.report_sync(event),
                Action::Watchdog => drive.expire_watchdog(),
                Action::Restart => {
                    drive.restart();
                    prop_assert_eq!(drive.state(), AlState::Init);
                }
            }
        }
    }
}
