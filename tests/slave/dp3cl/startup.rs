//! The checks of a DP3CL on its controller's registers before a change of its AL state.

use ecmsk::ethercat::AlState;
use ecmsk::slave::dp3cl::{Dp3cl, Dp3clAlarm, Dp3clConfig, Dp3clVariants};
use ecmsk::slave::{AlStatus, Communication, Slave, SyncManagerSettings};

use super::bench::{in_preop, list, read, usual, write};

const MS: u64 = 1_000_000;

/// The registers as a master sets them, with SYNC0 of 1 ms.
fn good() -> Communication {
    let sm = |start, length, control| SyncManagerSettings { start, length, control, enabled: true };
    Communication {
        sync_managers: [sm(0x1000, 128, 0x26), sm(0x1080, 128, 0x22), sm(0x1100, 8, 0x64), sm(0x1400, 19, 0x20)],
        watchdog_ns: Some(100 * MS),
        dc_activation: 0x03,
        sync0_cycle_ns: 1_000_000,
    }
}

fn changed(change: impl Fn(&mut Communication)) -> Communication {
    let mut communication = good();
    change(&mut communication);
    communication
}

/// Requests PreOP from Init, with these registers.
fn to_preop(config: Dp3clConfig, communication: &Communication) -> Result<(), AlStatus> {
    let mut drive = Dp3cl::new(config);
    drive.set_communication(communication);
    let answer = drive.enter(AlState::PreOp);
    assert_eq!(answer.is_err(), drive.alarm() == Some(Dp3clAlarm::MailboxSyncManager));
    assert_eq!(drive.state() == AlState::Init, answer.is_err());
    answer
}

/// DP3CL-5.9 E-811, each mistake in turn.
#[test]
fn mailbox_sync_managers() {
    let refused = Err(AlStatus(0x0016));
    assert_eq!(to_preop(Dp3clConfig::default(), &good()), Ok(()));
    let mistakes: [fn(&mut Communication); 14] = [
        |c| c.sync_managers[0].start = 0x1001,
        |c| c.sync_managers[0].start = 0x0F00,
        |c| c.sync_managers[0].start = 0x1100,
        |c| c.sync_managers[0].length = 31,
        |c| c.sync_managers[0].length = 257,
        |c| c.sync_managers[0].length = 129,
        |c| c.sync_managers[0].control = 0x22,
        |c| c.sync_managers[0].enabled = false,
        |c| c.sync_managers[1].start = 0x1301,
        |c| c.sync_managers[1].start = 0x1300,
        |c| c.sync_managers[1].length = 39,
        |c| c.sync_managers[1].length = 257,
        |c| c.sync_managers[1].control = 0x26,
        |c| c.sync_managers[2].start = 0x10F0,
    ];
    for (number, mistake) in mistakes.into_iter().enumerate() {
        assert_eq!(to_preop(Dp3clConfig::default(), &changed(mistake)), refused, "{number}");
    }
    let allowed: [fn(&mut Communication); 5] = [
        |c| c.sync_managers[0].length = 32,
        |c| c.sync_managers[1].length = 40,
        |c| c.sync_managers[0].control = 0x66,
        |c| c.sync_managers[1].start = 0x1200,
        |c| c.sync_managers[2].enabled = false,
    ];
    for (number, change) in allowed.into_iter().enumerate() {
        assert_eq!(to_preop(Dp3clConfig::default(), &changed(change)), Ok(()), "{number}");
    }
    let variants = Dp3clVariants { strict_sync_managers: true, ..Dp3clVariants::default() };
    let strict = Dp3clConfig { variants, ..Dp3clConfig::default() };
    assert_eq!(to_preop(strict.clone(), &good()), refused);
    assert_eq!(to_preop(strict, &changed(|c| c.sync_managers[1].start = 0x1200)), Ok(()));
}

/// Requests SafeOP from PreOP with these registers and synchronization types; the alarm must be that of the code.
fn to_safeop(communication: &Communication, types: (i64, i64)) -> Result<(), AlStatus> {
    let mut drive = usual();
    write(&mut drive, 0x1C32, 1, types.0).unwrap();
    write(&mut drive, 0x1C33, 1, types.1).unwrap();
    drive.set_communication(communication);
    let answer = drive.enter(AlState::SafeOp);
    assert_eq!(drive.state(), if answer.is_ok() { AlState::SafeOp } else { AlState::PreOp });
    assert_eq!(drive.alarm().map(Dp3clAlarm::al_status), answer.err());
    answer
}

/// DP3CL-5.8 E-810: the valid cycles of SYNC0. DP3CL-5.11 E-815: values of 0x0981.
#[test]
fn distributed_clocks() {
    for (cycle_us, answer) in
        [(500, Ok(())), (1000, Ok(())), (2000, Ok(())), (4000, Ok(())), (250, Err(())), (3000, Err(())), (0, Err(()))]
    {
        let communication = changed(|c| c.sync0_cycle_ns = cycle_us * 1000);
        assert_eq!(to_safeop(&communication, (2, 2)), answer.map_err(|()| AlStatus(0x0035)), "{cycle_us}");
        let mut drive = usual();
        drive.set_sync_managers(8, 19);
        drive.set_sync_cycle(Some(u64::from(cycle_us) * 1000));
        assert_eq!(drive.enter(AlState::SafeOp), answer.map_err(|()| AlStatus(0x0035)), "without a controller");
    }
    for activation in 0..8 {
        let answer = if matches!(activation, 0 | 3) { Ok(()) } else { Err(AlStatus(0x0030)) };
        assert_eq!(to_safeop(&changed(|c| c.dc_activation = activation), (1, 1)), answer, "{activation}");
    }
}

/// DP3CL-5.10 E-814: the watchdog against the cycle.
#[test]
fn watchdog_time() {
    for (watchdog_ns, control, answer) in [
        (Some(2 * MS), 0x64, Ok(())),
        (Some(2 * MS - 1), 0x64, Err(AlStatus(0x001F))),
        (Some(0), 0x64, Err(AlStatus(0x001F))),
        (Some(0), 0x24, Ok(())),
        (None, 0x64, Ok(())),
    ] {
        let communication = changed(|c| {
            c.watchdog_ns = watchdog_ns;
            c.sync_managers[2].control = control;
        });
        assert_eq!(to_safeop(&communication, (2, 2)), answer, "{watchdog_ns:?} {control:02X}");
    }
}

/// DP3CL-5.12 E-816, and the types that are read with SYNC0. DP3CL-5.18 The types of power-on.
#[test]
fn synchronization_types() {
    let mut drive = usual();
    for (index, usual) in [(0x1C32, 0x01), (0x1C33, 0x22)] {
        let subs = [
            (0, 32),
            (1, usual),
            (2, 0),
            (4, 0x8007),
            (5, 0),
            (6, 0),
            (8, 0),
            (9, 0),
            (10, 0),
            (11, 0),
            (12, 0),
            (32, 0),
        ];
        for (sub, value) in subs {
            assert_eq!(read(&mut drive, index, sub), Ok(value), "{index:04X}:{sub}");
        }
    }
    for (sub, is_writable) in [
        (1, true),
        (2, false),
        (4, false),
        (5, false),
        (6, false),
        (8, true),
        (9, false),
        (10, true),
        (11, false),
        (12, false),
        (32, false),
    ] {
        for index in [0x1C32, 0x1C33] {
            let value = read(&mut drive, index, sub).unwrap();
            assert_eq!(write(&mut drive, index, sub, value).is_ok(), is_writable, "{index:04X}:{sub}");
        }
    }
    let refused = Err(AlStatus(0x0028));
    let free = changed(|c| c.dc_activation = 0);
    for (types, with_sync0, without) in [
        ((1, 0x22), Ok(()), Ok(())),
        ((0, 0), Ok(()), Ok(())),
        ((1, 1), Ok(()), Ok(())),
        ((0, 1), Ok(()), refused),
        ((2, 2), Ok(()), refused),
        ((1, 2), Ok(()), refused),
        ((3, 3), refused, refused),
        ((1, 0x23), refused, refused),
    ] {
        assert_eq!(to_safeop(&good(), types), with_sync0, "{types:?}");
        assert_eq!(to_safeop(&free, types), without, "{types:?}");
    }
    drive.set_communication(&good());
    drive.enter(AlState::SafeOp).unwrap();
    assert_eq!((read(&mut drive, 0x1C32, 1), read(&mut drive, 0x1C33, 1)), (Ok(2), Ok(2)));
}

/// DP3CL-5.13 E-817.
#[test]
fn process_data_sync_managers() {
    type Mistake = (fn(&mut Communication), u16);
    let mistakes: [Mistake; 12] = [
        (|c| c.sync_managers[2].length = 9, 0x001D),
        (|c| c.sync_managers[2].enabled = false, 0x001D),
        (|c| c.sync_managers[2].start = 0x1101, 0x001D),
        (|c| c.sync_managers[2].start = 0x0FF0, 0x001D),
        (|c| c.sync_managers[2].start = 0x1FFA, 0x001D),
        (|c| c.sync_managers[2].control = 0x60, 0x001D),
        (|c| c.sync_managers[2].start = 0x1400, 0x001D),
        (|c| c.sync_managers[3].length = 18, 0x001E),
        (|c| c.sync_managers[3].enabled = false, 0x001E),
        (|c| c.sync_managers[3].start = 0x1403, 0x001E),
        (|c| c.sync_managers[3].start = 0x1FF0, 0x001E),
        (|c| c.sync_managers[3].control = 0x24, 0x001E),
    ];
    assert_eq!(to_safeop(&good(), (1, 0x22)), Ok(()));
    for (number, (mistake, status)) in mistakes.into_iter().enumerate() {
        assert_eq!(to_safeop(&changed(mistake), (1, 0x22)), Err(AlStatus(status)), "{number}");
    }
    let mut drive = usual();
    list(&mut drive, 0x1C12, &[]).unwrap();
    drive.set_communication(&changed(|c| c.sync_managers[2].enabled = false));
    assert_eq!(drive.enter(AlState::SafeOp), Ok(()), "without outputs it is off");
}

/// DP3CL-5.17 With several mistakes, the first one in the order of the checks is reported.
#[test]
fn order() {
    let mut wrong = changed(|c| {
        c.sync_managers[2].length = 9;
        c.sync_managers[3].length = 25;
        c.watchdog_ns = Some(0);
        c.dc_activation = 1;
    });
    let mut drive = in_preop(Dp3clConfig::default());
    write(&mut drive, 0x1C32, 1, 7).unwrap();
    let long = [0x6064_0020; 6];
    list(&mut drive, 0x1A00, &[&long[..], &[0x6061_0008]].concat()).unwrap();
    list(&mut drive, 0x1600, &[&[0x607A_0020; 6][..], &[0x6060_0008]].concat()).unwrap();
    let next = |drive: &mut Dp3cl, wrong: &Communication| {
        drive.set_communication(wrong);
        drive.enter(AlState::SafeOp).map_err(|AlStatus(status)| status)
    };
    assert_eq!(next(&mut drive, &wrong), Err(0x0024));
    list(&mut drive, 0x1A00, &[0x6064_0020]).unwrap();
    assert_eq!(next(&mut drive, &wrong), Err(0x0025));
    list(&mut drive, 0x1600, &[0x607A_0020]).unwrap();
    assert_eq!(next(&mut drive, &wrong), Err(0x001D));
    wrong.sync_managers[2].length = 4;
    assert_eq!(next(&mut drive, &wrong), Err(0x001E));
    wrong.sync_managers[3].length = 4;
    wrong.dc_activation = 3;
    assert_eq!(next(&mut drive, &wrong), Err(0x001F));
    wrong.dc_activation = 1;
    assert_eq!(next(&mut drive, &wrong), Err(0x0028), "the watchdog is compared with a cycle of SYNC0");
    write(&mut drive, 0x1C32, 1, 1).unwrap();
    assert_eq!(next(&mut drive, &wrong), Err(0x0030));
    wrong.dc_activation = 3;
    wrong.watchdog_ns = None;
    wrong.sync0_cycle_ns = 7;
    assert_eq!(next(&mut drive, &wrong), Err(0x0035));
    wrong.sync0_cycle_ns = 1_000_000;
    assert_eq!(next(&mut drive, &wrong), Ok(()));
}
