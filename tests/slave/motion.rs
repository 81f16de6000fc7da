//! Motion of a simulated axis: the effects of its loops, its limits and its friction on the shaft.

use crate::rig::{MS, Rig};
use ecmsk::cia402::{Controlword, DriveState, Mode, Statusword};
use ecmsk::coe::SdoSize;
use ecmsk::slave::plant::Motor;
use ecmsk::slave::{DriveConfig, Slave, Travel};

const TURN: i64 = 1 << 17;
/// Acceleration and speed of the test moves: 50 turns/s² up to 10 turns/s.
const ACCELERATION: i64 = 50 * TURN;
const SPEED: i64 = 10 * TURN;

fn csp() -> Rig {
    Rig::enabled(DriveConfig::default(), Mode::Csp, MS)
}

/// A target that speeds up evenly to `SPEED`, runs on and slows down again, as a master computes it every cycle.
/// Calls `each` after every cycle.
fn move_trapezoid(rig: &mut Rig, constant_cycles: u32, mut each: impl FnMut(&Rig)) {
    let seconds = rig.cycle_ns as f64 / 1e9;
    let ramp_cycles = (SPEED as f64 / (ACCELERATION as f64 * seconds)) as u32;
    let step = ACCELERATION as f64 * seconds;
    let mut speed = 0.0;
    let mut position = f64::from(rig.out.target);
    for cycle in 0..2 * ramp_cycles + constant_cycles {
        speed += match cycle {
            c if c < ramp_cycles => step,
            c if c < ramp_cycles + constant_cycles => 0.0,
            _ => -step,
        };
        position += speed * seconds;
        rig.out.target = position as i32;
        rig.cycle();
        each(rig);
    }
}

fn following_error(rig: &Rig) -> i64 {
    rig.drive.axis().following_error()
}

/// At constant speed the feed-forward leaves next to no following error. During constant acceleration the following
/// error is what makes the loops command that acceleration, with gains of 100/s and 800/s and a torque that acts for
/// 250 us at a time: 50 * 2^17 * (1 / 800 - 250e-6) / 100 = 65.5 counts.
#[test]
fn it_follows_a_ramp() {
    let mut rig = csp();
    let mut errors = Vec::new();
    move_trapezoid(&mut rig, 300, |rig| {
        errors.push(following_error(rig));
        let status = rig.status().0;
        assert!(errors.len() > 690 || status & Statusword::TARGET_REACHED == 0, "{status:04X} on the way");
    });
    for (cycles, expected) in [(100..190, 63..=68), (320..480, -2..=2), (600..690, -68..=-63)] {
        for cycle in cycles {
            assert!(expected.contains(&errors[cycle]), "cycle {cycle}: {} counts", errors[cycle]);
        }
    }
}

/// At its target it settles to the count, stays there, and shows that by bit 10; friction carries the remaining torque.
#[test]
fn it_settles() {
    let mut rig = csp();
    move_trapezoid(&mut rig, 100, |_| {});
    rig.run_for(200 * MS);
    assert_eq!(rig.position(), i64::from(rig.out.target));
    assert_eq!(rig.velocity(), 0.0);
    for _ in 0..1000 {
        rig.cycle();
        assert_eq!(rig.position(), i64::from(rig.out.target));
        assert!(rig.torque().abs() <= 30, "{}", rig.torque());
        assert_eq!(rig.status().0, 0x1637);
    }
}

/// Torque has the sign of the acceleration it makes and stays in 0x6072; the shaft accelerates no more than that
/// torque, less friction, allows.
#[test]
fn torque_sign_and_limit() {
    for limit in [3000_i16, 700] {
        for direction in [1, -1] {
            let mut rig = csp();
            rig.write(0x6072, 0, SdoSize::Two, limit.into());
            rig.write(0x6065, 0, SdoSize::Four, -1);
            rig.out.target = direction * 40 * TURN as i32;
            rig.cycle();
            rig.cycle();
            let speed = rig.velocity();
            rig.run_for(3 * MS);
            assert_eq!(i32::from(rig.torque()), direction * i32::from(limit));
            assert!(rig.status().0 & Statusword::INTERNAL_LIMIT != 0);
            let gained = (rig.velocity() - speed) * f64::from(direction);
            let expected = f64::from(limit - 30) / 1000.0 * 165e6 * 3e-3;
            assert!((gained / expected - 1.0).abs() < 0.02, "{gained} of {expected}");
            // Braking: torque points the other way.
            rig.out.target = 0;
            rig.run_for(2 * MS);
            assert_eq!(i32::from(rig.torque()), -direction * i32::from(limit));
        }
    }
}

/// Speed stays in the motor's limit and in 0x607F, however far the target is.
#[test]
fn speed_is_limited() {
    let motor_limit = f64::from(Motor::default().max_velocity);
    for limit in [u32::MAX, 5 * TURN as u32] {
        let mut rig = csp();
        rig.write(0x6065, 0, SdoSize::Four, -1);
        rig.write(0x607F, 0, SdoSize::Four, limit.into());
        rig.out.target = i32::MAX;
        let mut greatest = 0.0_f64;
        for _ in 0..2000 {
            rig.cycle();
            greatest = greatest.max(rig.velocity());
        }
        let limit = f64::from(limit).min(motor_limit);
        assert!(greatest <= limit && greatest > 0.99 * limit, "{greatest} of {limit}");
    }
}

/// The same move is followed and settles at every cycle time of the board, 250 us * 2^n up to 512 ms.
#[test]
fn it_is_stable_at_every_cycle_time() {
    for n in 0..=11 {
        let cycle_ns = 250_000 << n;
        let mut rig = Rig::enabled(DriveConfig::default(), Mode::Csp, cycle_ns);
        let (mut worst, mut fastest) = (0, 0.0_f64);
        // Evenly 2 turns a second, started and stopped at once.
        let steps = (4_000 * MS / cycle_ns).max(8);
        for step in 1..=steps {
            rig.out.target = (2 * TURN * (step * cycle_ns / 1000) as i64 / 1_000_000) as i32;
            rig.cycle();
            worst = worst.max(following_error(&rig).abs());
            fastest = fastest.max(rig.velocity().abs());
        }
        rig.run_for(500 * MS);
        assert_eq!(rig.position(), i64::from(rig.out.target), "cycle {cycle_ns} ns");
        assert_eq!(rig.state(), DriveState::OperationEnabled, "cycle {cycle_ns} ns");
        // The greatest error is the jump in speed divided by the gain of the position loop.
        assert!(worst <= 2 * TURN / 100, "cycle {cycle_ns} ns: {worst} counts behind");
        assert!(fastest <= 1.2 * 2.0 * TURN as f64, "cycle {cycle_ns} ns: {fastest} counts/s");
    }
}

/// Switching on moves nothing: the shaft stays where it is, to the count, on every way up and down.
#[test]
fn switching_on_and_off_does_not_move_the_shaft() {
    let config = || DriveConfig { position: -123_456_789, ..DriveConfig::default() };
    for mode in [Mode::Csp, Mode::Csv, Mode::Cst] {
        let mut rig = Rig::in_op(config(), mode, MS);
        for word in [0x06, 0x07, 0x0F, 0x07, 0x0F, 0x06, 0x0F, 0x00, 0x06, 0x0F, 0x02, 0x00] {
            rig.out.controlword = Controlword(word);
            for _ in 0..100 {
                rig.out.target = if mode == Mode::Csp { rig.seen.position } else { 0 };
                rig.cycle();
                assert_eq!(rig.position(), -123_456_789, "{mode}, controlword {word:#04X}");
            }
        }
    }
}

/// While it is off the shaft holds by friction, without torque, whatever the target is.
#[test]
fn off_it_holds_its_position_without_torque() {
    let mut rig = Rig::in_op(DriveConfig { position: 4711, ..DriveConfig::default() }, Mode::Csp, MS);
    rig.out.target = 1_000_000;
    for word in [0x00, 0x06, 0x07] {
        rig.out.controlword = Controlword(word);
        for _ in 0..200 {
            rig.cycle();
            assert_eq!((rig.position(), rig.torque(), following_error(&rig)), (4711, 0, 0));
        }
    }
    assert_eq!(rig.state(), DriveState::SwitchedOn);
}

/// Switched off in motion it coasts: without torque, slower and slower, to a standstill, and not back.
#[test]
fn switched_off_in_motion_it_coasts() {
    let mut rig = csp();
    for _ in 0..300 {
        rig.out.target += (TURN / 100) as i32;
        rig.cycle();
    }
    rig.out.controlword = Controlword::DISABLE_VOLTAGE;
    rig.cycle();
    let (mut speed, start) = (rig.velocity(), rig.position());
    assert!(speed > 9.0 * TURN as f64);
    let mut cycles = 0;
    while rig.velocity() > 0.0 {
        rig.cycle();
        assert!(rig.velocity() < speed && rig.velocity() >= 0.0);
        assert_eq!((rig.torque(), rig.state()), (0, DriveState::SwitchOnDisabled));
        speed = rig.velocity();
        cycles += 1;
    }
    // Dry friction alone, 3 % of the rated torque, would take 1.31e6 / (0.03 * 165e6) = 265 ms.
    assert!((150..=265).contains(&cycles), "{cycles} ms");
    assert!(rig.position() > start);
}

/// A fault comes when the following error has been outside 0x6065 for longer than 0x6066, with bits 3 and 13 and error
/// code 8611h; before that the drive goes on.
#[test]
fn a_following_error_is_a_fault() {
    for timeout_ms in [0_u16, 10, 50] {
        let mut rig = csp();
        rig.write(0x6065, 0, SdoSize::Four, 1000);
        rig.write(0x6066, 0, SdoSize::Two, timeout_ms.into());
        // No torque: the shaft cannot follow.
        rig.write(0x6072, 0, SdoSize::Two, 0);
        rig.out.target = 1000;
        rig.run_for(200 * MS);
        assert_eq!((rig.read(0x60F4, 0), rig.state()), (1000, DriveState::OperationEnabled), "on its edge");
        rig.out.target = 1001;
        for _ in 0..timeout_ms {
            rig.cycle();
            assert_eq!((rig.state(), rig.seen.error_code), (DriveState::OperationEnabled, 0));
        }
        rig.run_for(5 * MS);
        assert_eq!(rig.seen.error_code, 0x8611);
        assert_eq!(rig.seen.statusword.state(), Some(DriveState::Fault));
        assert!(rig.seen.statusword.0 & Statusword::BIT13 != 0);
        assert_eq!(rig.read(0x603F, 0), 0x8611);
        assert_eq!(rig.read(0x1001, 0), 0x21, "generic and device profile");
        assert_eq!(rig.torque(), 0);
        // Reset: everything is gone with it.
        rig.out.controlword = Controlword(Controlword::FAULT_RESET);
        rig.run_for(2 * MS);
        assert_eq!((rig.seen.statusword.0, rig.seen.error_code), (0x0250, 0));
        assert_eq!(rig.read(0x1001, 0), 0);
    }
}

/// A following error that comes back into its window in time is none; a window of FFFFFFFFh never is.
#[test]
fn following_error_within_its_time() {
    let mut rig = csp();
    rig.write(0x6065, 0, SdoSize::Four, 1000);
    rig.write(0x6066, 0, SdoSize::Two, 10);
    rig.write(0x6072, 0, SdoSize::Two, 0);
    for _ in 0..20 {
        rig.out.target = 5000;
        rig.run_for(9 * MS);
        rig.out.target = 0;
        rig.run_for(2 * MS);
    }
    assert_eq!(rig.state(), DriveState::OperationEnabled);
    rig.write(0x6065, 0, SdoSize::Four, -1);
    rig.out.target = i32::MIN;
    rig.run_for(500 * MS);
    assert_eq!(rig.state(), DriveState::OperationEnabled);
}

/// 0x607D holds a target back, with bit 11; with its defaults, or out of order, it holds nothing.
#[test]
fn software_position_limits() {
    let mut rig = csp();
    rig.write(0x6065, 0, SdoSize::Four, -1);
    rig.write(0x607D, 1, SdoSize::Four, -500);
    rig.write(0x607D, 2, SdoSize::Four, 800);
    for (target, reached) in [(5000, 800), (700, 700), (-5000, -500)] {
        rig.out.target = target;
        rig.run_for(200 * MS);
        assert_eq!(rig.position(), reached);
        assert_eq!(rig.status().0 & Statusword::INTERNAL_LIMIT != 0, i64::from(target) != reached);
    }
    rig.write(0x607D, 2, SdoSize::Four, -500);
    rig.out.target = -5000;
    rig.run_for(200 * MS);
    assert_eq!(rig.position(), -5000);
}

/// Positions wrap only on the wire: a target means the nearest position with its 32 bits.
#[test]
fn an_axis_turns_for_ever() {
    for (start, step) in [(i64::from(i32::MAX) - 20_000, 100), (i64::from(i32::MIN) + 20_000, -100)] {
        let config = DriveConfig { position: start, ..DriveConfig::default() };
        let mut rig = Rig::enabled(config, Mode::Csp, MS);
        assert_eq!(rig.seen.position, start as i32);
        for _ in 0..400 {
            rig.out.target = rig.out.target.wrapping_add(step);
            rig.cycle();
            assert!(following_error(&rig).abs() < 2000);
        }
        rig.run_for(200 * MS);
        assert_eq!(rig.position(), start + 400 * i64::from(step), "inside it goes on");
        assert_eq!(rig.seen.position, (start + 400 * i64::from(step)) as i32, "on the wire it wraps");
        assert_eq!(rig.drive.shaft(0), Some(start + 400 * i64::from(step)));
    }
}

/// CSV: the target is a speed, reached and held in either direction; the position runs on evenly.
#[test]
fn csv_follows_a_velocity() {
    let mut rig = Rig::enabled(DriveConfig::default(), Mode::Csv, MS);
    for target in [SPEED as i32, -(SPEED as i32), 1000, 0] {
        rig.out.target = target;
        rig.cycle();
        rig.cycle();
        rig.run_for(300 * MS);
        assert_eq!(rig.read(0x606C, 0) as i32, target);
        assert_eq!(rig.status().0, 0x1637, "target reached");
        let before = rig.position();
        rig.run_for(1000 * MS);
        assert!((rig.position() - before - i64::from(target)).abs() <= 1, "a second at {target} counts/s");
        assert_eq!(rig.read(0x60F4, 0), 0);
    }
}

/// CST: the target is a torque; speed grows by the torque less friction, up to the limit of speed, where the torque
/// falls to that of friction.
#[test]
fn cst_gives_a_torque() {
    for direction in [1, -1] {
        let mut rig = Rig::enabled(DriveConfig::default(), Mode::Cst, MS);
        rig.out.target = direction * 200;
        rig.run_for(10 * MS);
        assert_eq!(i32::from(rig.torque()), direction * 200);
        let expected = f64::from(direction) * 0.17 * 165e6 * 10e-3;
        assert!((rig.velocity() / expected - 1.0).abs() < 0.01, "{} of {expected}", rig.velocity());
        rig.out.target = direction * 5000;
        rig.run_for(3 * MS);
        assert_eq!(i32::from(rig.torque()), direction * 3000, "peak torque");
        rig.run_for(1000 * MS);
        let limit = f64::from(Motor::default().max_velocity);
        assert!(rig.velocity().abs() <= limit && rig.velocity().abs() > 0.99 * limit);
        assert!((i32::from(rig.torque()) * direction - 130).abs() <= 1, "{}", rig.torque());
        rig.out.target = direction * 20;
        rig.run_for(3000 * MS);
        assert_eq!(rig.velocity(), 0.0, "less than friction takes does not move it");
    }
}

/// Quick stop brakes on 0x6085, disable operation on 0x6084, both to a standstill without moving back: the distance is
/// v² / 2a.
#[test]
fn ramps() {
    for (word, index, deceleration) in [(0x02, 0x6085, 40 * TURN), (0x07, 0x6084, 25 * TURN)] {
        let mut rig = csp();
        rig.write(index, 0, SdoSize::Four, deceleration);
        for _ in 0..300 {
            rig.out.target += (SPEED / 1000) as i32;
            rig.cycle();
        }
        let start = rig.position();
        rig.out.controlword = Controlword(word);
        let mut last = start;
        while rig.velocity() > 0.0 {
            rig.cycle();
            assert!(rig.position() >= last);
            last = rig.position();
        }
        let way = (rig.position() - start) as f64;
        let expected = (SPEED as f64) * (SPEED as f64) / (2.0 * deceleration as f64);
        assert!((way / expected - 1.0).abs() < 0.02, "{way} of {expected}");
        rig.run_for(10 * MS);
        let end = if word == 0x02 { DriveState::SwitchOnDisabled } else { DriveState::SwitchedOn };
        assert_eq!(rig.state(), end);
    }
}

/// By option 3 a quick stop brakes with all the torque there is: 3 times the rated one, whose acceleration is 165,000,000
/// counts/s².
#[test]
fn a_quick_stop_with_all_the_torque() {
    let mut rig = csp();
    rig.write(0x605A, 0, SdoSize::Two, 3);
    for _ in 0..300 {
        rig.out.target += (SPEED / 1000) as i32;
        rig.cycle();
    }
    let start = rig.position();
    rig.out.controlword = Controlword(0x02);
    rig.run_for(100 * MS);
    let way = (rig.position() - start) as f64;
    let expected = (SPEED as f64) * (SPEED as f64) / (2.0 * 3.0 * 165e6);
    assert_eq!(rig.velocity(), 0.0);
    // The controlword takes effect a cycle later.
    let most = 1.2 * expected + SPEED as f64 / 1000.0;
    assert!((expected..most).contains(&way), "{way}, ideal is {expected}");
}

/// An end stop holds the shaft and lets it go again: on the way back it is at its target, however slow that is.
#[test]
fn end_stops_let_go() {
    for direction in [-1, 1] {
        let travel = Travel { stops: Some((-1000, 1000)), ..Travel::default() };
        let mut rig = Rig::enabled(DriveConfig { travel, ..DriveConfig::default() }, Mode::Csp, MS);
        for _ in 0..300 {
            rig.out.target += direction * 10;
            rig.cycle();
        }
        assert_eq!(rig.drive.shaft(0), Some(1000 * i64::from(direction)));
        for n in 0..10_100 {
            // One count in five cycles.
            rig.out.target -= if n < 200 { direction * 10 } else { direction * i32::from(n % 5 == 0) };
            rig.cycle();
            let off = rig.drive.shaft(0).expect("a drive has a shaft") - i64::from(rig.out.target.clamp(-1000, 1000));
            assert!(off.abs() <= 1 || n < 260, "{off} counts off after {n} cycles");
        }
    }
}

/// A run through every mode, with faults, gives the same bits on every target: frozen, do not change.
#[test]
fn a_run_is_the_same_to_the_bit() {
    let mut digest = Fnv::default();
    for (mode, scale) in [(Mode::Csp, 900), (Mode::Csv, 400_000), (Mode::Cst, 90)] {
        for cycle_ns in [250_000, MS, 8 * MS] {
            let mut rig = Rig::enabled(DriveConfig { position: -77, ..DriveConfig::default() }, mode, cycle_ns);
            let mut random = 12345_u32;
            for cycle in 0..2000 {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let draw = (random >> 16) as i32 % (2 * scale + 1) - scale;
                rig.out.target = if mode == Mode::Csp { rig.out.target.wrapping_add(draw) } else { draw };
                rig.out.controlword = Controlword(match cycle {
                    700..720 => 0x02,
                    720..760 => 0x06,
                    1500..1510 => 0x07,
                    _ => 0x0F,
                });
                rig.cycle();
                digest.add(rig.seen.position as u32);
                digest.add((rig.seen.torque as u16).into());
                digest.add(rig.seen.statusword.0.into());
                digest.add(rig.read(0x606C, 0));
            }
        }
    }
    assert_eq!(digest.0, 0x3F44_A84B_A2DF_429A);
}

/// FNV-1a, 64 bits.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl Fnv {
    fn add(&mut self, word: u32) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}
