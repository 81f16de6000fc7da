//! The simulated servo drive as a slave: AL states, configuration, objects, process data, faults.

use crate::rig::{MS, Rig, enter, read, write};
use crate::wired::{config, configure, exchange as exchange_words};
use ecmsk::cia402::{Controlword, DriveState, Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, MAX_AXES, Refusal, Role, SlaveConfig};
use ecmsk::sk::DriveSync;
use ecmsk::slave::dictionary::{Device, PdoDirection};
use ecmsk::slave::{AlStatus, DeviceFault, Drive, DriveConfig, Fault, Slave};

use AlState::*;

const TURN: i64 = 1 << 17;

fn drive_in(state: AlState, role: Role) -> Drive {
    let mut drive = Drive::new(DriveConfig { serial: 0x1234, ..DriveConfig::default() });
    for next in [PreOp, SafeOp, Op] {
        if next > state {
            break;
        }
        enter(&mut drive, next);
        if next == PreOp {
            configure(&mut drive, &config(role)).expect("the drive has the role");
        }
    }
    drive
}

const CSP: Role = Role::Drive(Mode::Csp);

/// From every AL state to every other: one step up, any way down, no state left out.
#[test]
fn al_states() {
    let all = [Init, PreOp, SafeOp, Op];
    for (n, from) in all.into_iter().enumerate() {
        for (m, to) in all.into_iter().enumerate() {
            let mut drive = drive_in(from, CSP);
            let expected = if m <= n + 1 { Ok(()) } else { Err(AlStatus(0x0011)) };
            assert_eq!(drive.enter(to), expected, "{from:?} to {to:?}");
            assert_eq!(drive.state(), if expected.is_ok() { to } else { from });
        }
    }
}

/// Without process data there is no SafeOP; Init forgets them, PreOP does not.
#[test]
fn safeop_needs_a_configuration() {
    let mut drive = Drive::new(DriveConfig::default());
    enter(&mut drive, PreOp);
    assert_eq!(drive.enter(SafeOp), Err(AlStatus(0x001D)));
    configure(&mut drive, &config(CSP)).unwrap();
    enter(&mut drive, SafeOp);
    enter(&mut drive, PreOp);
    enter(&mut drive, SafeOp);
    enter(&mut drive, Init);
    enter(&mut drive, PreOp);
    assert_eq!(drive.enter(SafeOp), Err(AlStatus(0x001D)));
    configure(&mut drive, &config(CSP)).unwrap();
    configure(&mut drive, &config(Role::Unused)).unwrap();
    assert_eq!(drive.enter(SafeOp), Err(AlStatus(0x001D)), "not used");
}

/// SK-4.58 The drive refuses a configuration for another kind of slave, and takes one in PreOP alone.
#[test]
fn roles() {
    for mode in [Mode::Csp, Mode::Csv, Mode::Cst] {
        let mut drive = drive_in(PreOp, Role::Drive(mode));
        assert_eq!(read(&mut drive, 0x6061, 0), Ok(mode.code().into()));
    }
    let mut drive = drive_in(PreOp, CSP);
    let refused = |al_status, abort| Err(Refusal { slave: 0, al_status, abort });
    assert_eq!(configure(&mut drive, &config(Role::Io)), refused(0x001D, None));
    // It has digital inputs and outputs like a pulse module, and the module's modes.
    for role in [Role::Hsp(Mode::Csp), Role::Hsp(Mode::Csv)] {
        assert_eq!(configure(&mut drive, &config(role)), Ok(()), "{role:?}");
    }
    let no_homing = Some((ObjectAddress::new(0x6060, 0), AbortCode::VALUE_RANGE));
    assert_eq!(configure(&mut drive, &config(Role::Drive(Mode::Homing))), refused(0, no_homing));
    for state in [Init, SafeOp, Op] {
        assert_eq!(configure(&mut drive_in(state, CSP), &config(CSP)), refused(0x0011, None), "{state:?}");
    }
}

/// In Init there is no mailbox: nothing answers.
#[test]
fn no_mailbox_in_init() {
    let mut drive = drive_in(Init, CSP);
    assert_eq!(read(&mut drive, 0x1000, 0), Err(AbortCode::TIMEOUT));
    assert_eq!(write(&mut drive, 0x6040, 0, SdoSize::Two, 6), Err(AbortCode::TIMEOUT));
    enter(&mut drive, PreOp);
    assert_eq!(read(&mut drive, 0x1000, 0), Ok(0x0002_0192));
}

/// SK-6.12 The power-on values of objects that programs read; the sizes of its objects are in `maps.rs`.
#[test]
fn objects() {
    let mut drive = drive_in(PreOp, CSP);
    for (index, sub, expected) in [
        (0x1000, 0, 0x0002_0192),
        (0x1008, 0, u32::from_le_bytes(*b"SRVO")),
        (0x1018, 4, 0x1234),
        (0x6502, 0, 0x0000_03A0), // homing, CSP, CSV, CST
        (0x6060, 0, 8),
        (0x6065, 0, 3 << 17),
        (0x6066, 0, 10),
        (0x6072, 0, 3000),
        (0x607D, 0, 2),
        (0x607F, 0, 100 << 17),
        (0x6099, 0, 2),
        (0x60C2, 0, 2),
        (0x60C2, 1, 1),
        (0x60C2, 2, 0xFD),
        (0x60FE, 0, 2),
    ] {
        assert_eq!(read(&mut drive, index, sub), Ok(expected), "{index:04X}:{sub}");
    }
}

/// SK-6.12 Writes that the drive's own objects refuse.
#[test]
fn refused_downloads() {
    let mut drive = drive_in(PreOp, CSP);
    for (index, size, value, code) in [
        (0x6041, SdoSize::Two, 0, AbortCode::READ_ONLY),
        (0x6064, SdoSize::Four, 0, AbortCode::READ_ONLY),
        (0x6040, SdoSize::One, 6, AbortCode::TOO_SHORT),
        (0x6040, SdoSize::Four, 6, AbortCode::TOO_LONG),
        (0x605A, SdoSize::Two, 9, AbortCode::VALUE_HIGH),
        (0x605A, SdoSize::Two, -1, AbortCode::VALUE_LOW),
        (0x6084, SdoSize::Four, 0, AbortCode::VALUE_LOW),
        (0x6098, SdoSize::Two, 15, AbortCode::TOO_LONG),
        (0x6099, SdoSize::One, 1, AbortCode::READ_ONLY),
        (0x6060, SdoSize::Four, 8, AbortCode::TOO_LONG),
        (0x7000, SdoSize::One, 0, AbortCode::NO_OBJECT),
    ] {
        assert_eq!(write(&mut drive, index, 0, size, value), Err(code), "{index:04X} = {value}");
    }
    for mode in [-1, 0, 1, 3, 4, 7, 11] {
        assert_eq!(write(&mut drive, 0x6060, 0, SdoSize::One, mode), Err(AbortCode::VALUE_RANGE), "mode {mode}");
        assert_eq!(read(&mut drive, 0x6061, 0), Ok(8));
    }
    assert_eq!(write(&mut drive, 0x60C2, 1, SdoSize::One, 2), Ok(()));
    enter(&mut drive, SafeOp);
    assert_eq!(write(&mut drive, 0x60C2, 1, SdoSize::One, 4), Err(AbortCode::DEVICE_STATE));
    assert_eq!(read(&mut drive, 0x60C2, 1), Ok(2));
}

/// SK-7.1 SK-7.2 SK-7.3 SK-7.4 The process data of each role, as 0x1C12, 0x1C13 and the mapping objects show them;
/// every entry is an object of the drive that may be mapped there, with its length.
#[test]
fn mapped_process_data() {
    const RX: [(Mode, [u32; 2]); 3] = [
        (Mode::Csp, [0x6040_0010, 0x607A_0020]),
        (Mode::Csv, [0x6040_0010, 0x60FF_0020]),
        (Mode::Cst, [0x6040_0010, 0x6071_0010]),
    ];
    const TX: [u32; 4] = [0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010];
    for (mode, rx) in RX {
        let mut drive = drive_in(PreOp, Role::Drive(mode));
        for (assign, entries, direction) in [(0x1C12, &rx[..], PdoDirection::Rx), (0x1C13, &TX[..], PdoDirection::Tx)] {
            assert_eq!(read(&mut drive, assign, 0), Ok(1));
            let pdo = read(&mut drive, assign, 1).unwrap() as u16;
            assert_eq!(read(&mut drive, pdo, 0), Ok(entries.len() as u32));
            for (sub, entry) in (1..).zip(entries) {
                assert_eq!(read(&mut drive, pdo, sub), Ok(*entry), "{mode}, {pdo:04X}:{sub}");
                let (index, bits) = ((entry >> 16) as u16, (entry & 0xFF) as u8);
                let row = Drive::objects().iter().find(|row| row.address() == ObjectAddress::new(index, 0)).unwrap();
                assert_eq!((row.pdo(), row.data_type().bytes() * 8), (Some(direction), bits), "{index:04X}");
            }
        }
    }
    let mut unused = drive_in(Init, CSP);
    enter(&mut unused, PreOp);
    assert_eq!((read(&mut unused, 0x1C12, 0), read(&mut unused, 0x1C13, 0)), (Ok(1), Ok(1)), "of CSP at power-on");
}

/// 0x1C32:1 shows whether the drive runs free or with SYNC0.
#[test]
fn synchronization_type() {
    for (sync, shown) in [(DriveSync::FreeRun, 0), (DriveSync::DcSync, 2)] {
        let mut drive = drive_in(PreOp, CSP);
        configure(&mut drive, &SlaveConfig { role: CSP, sync }).unwrap();
        assert_eq!((read(&mut drive, 0x1C32, 1), read(&mut drive, 0x1C33, 1)), (Ok(shown), Ok(shown)));
    }
}

/// Outputs go to the object that the role maps, in OP alone; inputs are the values at the end of the last step.
#[test]
fn exchange() {
    let out = [AxisOut { controlword: Controlword(0x06), outputs: 0xFFFF, target: -70_003 }, AxisOut::default()];
    for (mode, expected) in
        [(Mode::Csp, [-70_003, 0, 0]), (Mode::Csv, [0, -70_003, 0]), (Mode::Cst, [0, 0, i32::from(-70_003_i32 as i16)])]
    {
        let targets = |drive: &mut Drive| {
            [0x607A, 0x60FF, 0x6071].map(|index| match read(drive, index, 0).unwrap() {
                torque if index == 0x6071 => i32::from(torque as i16),
                value => value as i32,
            })
        };
        let data = ProcessData::of(Role::Drive(mode), false).expect("a drive has the mode");
        let mut drive = drive_in(SafeOp, Role::Drive(mode));
        let mut inputs = [AxisIn::default(); MAX_AXES];
        drive.step(200 * MS);
        exchange_words(&mut drive, &data, None, &mut inputs);
        assert_eq!(inputs[0], AxisIn { statusword: Statusword(0x0250), ..AxisIn::default() });
        exchange_words(&mut drive, &data, Some(&out), &mut inputs);
        assert_eq!((targets(&mut drive), read(&mut drive, 0x6040, 0)), ([0; 3], Ok(0)), "{mode}: in SafeOP");
        enter(&mut drive, Op);
        exchange_words(&mut drive, &data, Some(&out), &mut inputs);
        assert_eq!((targets(&mut drive), read(&mut drive, 0x6040, 0)), (expected, Ok(6)), "{mode}: in OP");
        assert_eq!(inputs[0].statusword.0, 0x0250, "measured before");
        drive.step(MS);
        exchange_words(&mut drive, &data, Some(&out), &mut inputs);
        assert_eq!(inputs[0].statusword.0, 0x0231);
        assert_eq!(inputs[1], AxisIn::default(), "there is no second axis");
    }
}

/// SK-7.13 SK-7.15 After its controlword the drive takes its own time to switch on, and then shows 1637h.
#[test]
fn the_time_to_turn_on_is_the_drives_own() {
    for (enable_ms, config) in [
        (40, DriveConfig::default()),
        (90, {
            let mut config = DriveConfig::default();
            config.times.enable_ns = 90 * MS;
            config
        }),
    ] {
        let mut rig = Rig::in_op(config, Mode::Csp, MS);
        assert_eq!(rig.status().0, 0x0250);
        rig.enable();
        assert_eq!(rig.seen.statusword.0 & 0xFF, 0x37);
        rig.run_for(2 * MS);
        assert_eq!(rig.seen.statusword.0, 0x1637);
        rig.out.controlword = Controlword::SWITCH_ON;
        rig.run_for(10 * MS);
        rig.out.controlword = Controlword::ENABLE_OPERATION;
        let cycles = (1..1000).find(|_| {
            rig.cycle();
            rig.state() == DriveState::OperationEnabled
        });
        assert_eq!(cycles, Some(enable_ms));
    }
}

/// Object 0x605A has an effect: after a quick stop the drive is off with 2 and stays in Quick stop active with 6.
#[test]
fn the_quick_stop_option_is_an_object() {
    for (option, end) in [(2, DriveState::SwitchOnDisabled), (6, DriveState::QuickStopActive)] {
        let mut rig = moving();
        rig.write(0x605A, 0, SdoSize::Two, option);
        rig.out.controlword = Controlword(2);
        rig.run_for(200 * MS);
        assert_eq!((rig.state(), rig.velocity()), (end, 0.0), "{option}");
    }
}

/// [OURS] Leaving OP in motion is a quick stop: the shaft brakes on 0x6085 and the drive is off, without a fault, and
/// stays off in the next OP until its controlword walks it up.
#[test]
fn leaving_op_in_motion() {
    for target in [SafeOp, PreOp, Init] {
        let mut rig = moving();
        rig.drive.enter(target).unwrap();
        let start = rig.position();
        let mut steps = 0;
        while rig.state() != DriveState::SwitchOnDisabled {
            rig.drive.step(MS);
            steps += 1;
        }
        // 5 turns/s, braked with 1000 turns/s²: 5 ms, and some more until it is at rest.
        assert!((5..30).contains(&steps), "{steps} ms");
        let way = (rig.position() - start) as f64 / TURN as f64;
        assert!((0.0125..0.02).contains(&way), "{way} turns");
        assert_eq!((rig.velocity(), rig.torque(), rig.status().0), (0.0, 0, 0x0250));
    }
    let mut rig = moving();
    rig.drive.enter(SafeOp).unwrap();
    rig.drive.step(100 * MS);
    rig.drive.enter(Op).unwrap();
    rig.run_for(100 * MS);
    assert_eq!(rig.state(), DriveState::SwitchOnDisabled, "0Fh does not lead up from here");
    rig.enable();
}

/// [OURS] Missing outputs for 100 ms end OP; a cycle longer than that does not.
#[test]
fn watchdog_of_the_outputs() {
    let mut rig = moving();
    rig.cycle();
    for _ in 0..99 {
        rig.drive.step(MS);
        assert_eq!((rig.drive.state(), rig.state()), (Op, DriveState::OperationEnabled));
    }
    rig.drive.step(MS);
    assert_eq!(rig.drive.state(), SafeOp);
    rig.drive.step(50 * MS);
    assert_eq!((rig.state(), rig.velocity()), (DriveState::SwitchOnDisabled, 0.0));

    let mut slow = Rig::enabled(DriveConfig::default(), Mode::Csp, 512 * MS);
    slow.run_for(5000 * MS);
    assert_eq!((slow.drive.state(), slow.state()), (Op, DriveState::OperationEnabled));
}

/// A fault in motion: the reaction of 0x605E, then Fault with its code, until a reset; one that lasts is not reset.
#[test]
fn injected_faults() {
    for (resettable, after) in [(true, DriveState::SwitchOnDisabled), (false, DriveState::Fault)] {
        let mut rig = moving();
        assert!(rig.drive.apply_fault(Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x3210, resettable } }));
        assert!(
            !rig.drive.apply_fault(Fault::Alarm { axis: 1, fault: DeviceFault { code: 0x3210, resettable } }),
            "there is no second axis"
        );
        rig.cycle();
        assert_eq!((rig.state(), rig.torque() < 0), (DriveState::FaultReactionActive, true), "it brakes");
        rig.run_for(50 * MS);
        assert_eq!((rig.state(), rig.velocity(), rig.torque()), (DriveState::Fault, 0.0, 0));
        assert_eq!((rig.seen.error_code, rig.seen.statusword.0), (0x3210, 0x0218));
        assert_eq!(rig.read(0x1001, 0), 0x05, "generic and voltage");
        rig.out.controlword = Controlword(Controlword::FAULT_RESET);
        rig.run_for(2 * MS);
        assert_eq!(rig.state(), after);
    }
}

/// A mode written to 0x6060 shows in 0x6061, and the axis holds its position until a target of that mode comes.
#[test]
fn a_change_of_mode_does_not_jump() {
    for mode in [Mode::Csv, Mode::Cst] {
        let mut rig = Rig::enabled(DriveConfig { position: 5000, ..DriveConfig::default() }, Mode::Csp, MS);
        rig.write(0x6060, 0, SdoSize::One, mode.code().into());
        assert_eq!((rig.read(0x6060, 0), rig.read(0x6061, 0)), (mode.code().into(), mode.code().into()));
        rig.run_for(100 * MS);
        assert_eq!((rig.position(), rig.state()), (5000, DriveState::OperationEnabled));
    }
    // Mapped for CSV, so that no target position comes: 0x607A is where the shaft was when the mode changed.
    let mut rig = Rig::enabled(DriveConfig { position: 5000, ..DriveConfig::default() }, Mode::Csv, MS);
    rig.out.target = 100_000;
    rig.run_for(100 * MS);
    let position = rig.position();
    assert!(position > 10_000);
    rig.write(0x6060, 0, SdoSize::One, 8);
    rig.run_for(500 * MS);
    assert_eq!(rig.read(0x607A, 0) as i32, position as i32);
    assert_eq!((rig.position(), rig.velocity()), (position, 0.0));
}

/// Without process data the controlword and the targets can be written by SDO.
#[test]
fn driven_by_sdo_in_preop() {
    let mut drive = drive_in(PreOp, CSP);
    drive.step(200 * MS);
    for word in [6, 7, 15] {
        write(&mut drive, 0x6040, 0, SdoSize::Two, word).unwrap();
        drive.step(100 * MS);
    }
    assert_eq!(read(&mut drive, 0x6041, 0), Ok(0x1637));
    write(&mut drive, 0x607A, 0, SdoSize::Four, -4000).unwrap();
    drive.step(100 * MS);
    drive.step(100 * MS);
    assert_eq!(read(&mut drive, 0x6064, 0), Ok(-4000_i32 as u32));
}

/// The default speeds and ramp of homing depend on the motor: 2 turns/s, a fifth of a turn/s, 100 turns/s².
#[test]
fn homing_goes_by_the_motor() {
    let mut drive = drive_in(PreOp, CSP);
    for (index, sub, expected) in [(0x6099, 1, 2 * TURN), (0x6099, 2, TURN / 5), (0x609A, 0, 100 * TURN)] {
        assert_eq!(read(&mut drive, index, sub).map(i64::from), Ok(expected), "{index:04X}:{sub}");
    }
}

/// Five turns a second, in CSP.
fn moving() -> Rig {
    let mut rig = Rig::enabled(DriveConfig::default(), Mode::Csp, MS);
    for _ in 0..200 {
        rig.out.target += (5 * TURN / 1000) as i32;
        rig.cycle();
    }
    assert!((rig.velocity() / (5.0 * TURN as f64) - 1.0).abs() < 0.01);
    rig
}
