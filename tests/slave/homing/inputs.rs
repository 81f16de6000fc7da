//! 0x60FD, switches and their faults, end stops and a jammed shaft.

use ecmsk::cia402::{DriveState, Mode};
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::plant::Motor;
use ecmsk::slave::switches::Switches;
use ecmsk::slave::{Drive, DriveConfig, Fault, HomeSwitch, Input, Io, Slave, Travel};

use super::bench::{Bench, Bits, CAM, FAST, FIRST, INDEX, LAST, NEGATIVE_LIMIT, POSITIVE_LIMIT, TURN, travel};
use crate::rig::MS;
use crate::wired::{jam, stick};

fn digital_inputs(position: i64, travel: Travel) -> u32 {
    let mut drive = Drive::new(DriveConfig { position, travel, ..DriveConfig::default() });
    drive.enter(ecmsk::fieldbus::AlState::PreOp).unwrap();
    drive.upload(ObjectAddress::new(0x60FD, 0)).unwrap().bits
}

/// 0x60FD: bit 0 negative limit, bit 1 positive limit, bit 2 home, to the count; an input that is not wired reads 0.
#[test]
fn bits_of_0x60fd() {
    for (position, cam, step_up, step_down) in [
        (i64::from(i32::MIN), 0b001, 0b001, 0b101),
        (NEGATIVE_LIMIT, 0b001, 0b001, 0b101),
        (NEGATIVE_LIMIT + 1, 0, 0, 0b100),
        (FIRST - 1, 0, 0, 0b100),
        (FIRST, 0b100, 0b100, 0b100),
        (LAST, 0b100, 0b100, 0b100),
        (LAST + 1, 0, 0b100, 0),
        (POSITIVE_LIMIT - 1, 0, 0b100, 0),
        (POSITIVE_LIMIT, 0b010, 0b110, 0b010),
        (i64::from(i32::MAX), 0b010, 0b110, 0b010),
    ] {
        let read = |home| digital_inputs(position, travel(home));
        let all = [read(CAM), read(HomeSwitch::From(FIRST)), read(HomeSwitch::UpTo(LAST))];
        assert_eq!(all, [cam, step_up, step_down], "at {position}");
        assert_eq!(digital_inputs(position, Travel::NONE), 0);
    }
}

/// Homing moves no switch: they are on the shaft, whatever its position reads.
#[test]
fn switches_stay_where_they_are() {
    let mut bench = Bench::new(travel(CAM), -100_000);
    bench.rig.write(0x607C, 0, SdoSize::Four, 250_000);
    for _ in 0..2 {
        assert_eq!(bench.home(24).end.map(|_| bench.shaft() >= FIRST), Ok(true));
        assert_eq!(bench.rig.read(0x60FD, 0), 0b100);
    }
    assert_eq!(bench.home_count(), FIRST - 250_000);
}

/// The next count where something changes, in both directions, and the pulses between.
#[test]
fn next_on_the_way() {
    let switches = Switches::new(&travel(CAM), TURN as u32);
    let (low, high) = (-600_000, 600_000);
    let mut up = Vec::new();
    let mut at = low;
    while let Some(next) = switches.next(at, high, true) {
        up.push(next);
        at = next;
    }
    let pulses = (low + 1..=high).filter(|count| (count - i64::from(INDEX)).rem_euclid(TURN) == 0);
    let mut expected: Vec<i64> = pulses.clone().chain([NEGATIVE_LIMIT + 1, FIRST, LAST + 1, POSITIVE_LIMIT]).collect();
    expected.sort_unstable();
    assert_eq!(up, expected);
    let mut down = Vec::new();
    let mut at = high;
    while let Some(next) = switches.next(at, low, true) {
        down.push(next);
        at = next;
    }
    let mut expected: Vec<i64> = pulses.clone().chain([NEGATIVE_LIMIT, FIRST - 1, LAST, POSITIVE_LIMIT - 1]).collect();
    expected.sort_unstable_by(|a, b| b.cmp(a));
    assert_eq!(down, expected);
    assert!(pulses.into_iter().all(|count| switches.has_index(count) && !switches.has_index(count + 1)));
    assert_eq!(switches.next(FIRST, FIRST, true), None);
    assert_eq!(switches.next(i64::MIN, i64::MAX, false), Some(NEGATIVE_LIMIT + 1), "at the ends of counting");
}

/// The check whether a switch changes on the way agrees with the search for the first change, from and to every place
/// around an edge and at the ends of counting, also with a stuck switch.
#[test]
fn changes_on_the_way() {
    for home in [CAM, HomeSwitch::Cam { first: FIRST, last: FIRST }, HomeSwitch::From(FIRST), HomeSwitch::UpTo(LAST)] {
        let mut switches = Switches::new(&travel(home), TURN as u32);
        let edges = [NEGATIVE_LIMIT, FIRST, LAST, POSITIVE_LIMIT];
        let places = edges.iter().flat_map(|edge| edge - 2..=edge + 2).chain([i64::MIN, i64::MAX]);
        for stuck in [None, Some(Input::Home), Some(Input::PositiveLimit)] {
            if let Some(input) = stuck {
                switches.stick(input, Some(true));
            }
            let mut changes = 0;
            for (from, to) in places.clone().flat_map(|from| places.clone().map(move |to| (from, to))) {
                let change = switches.change_between(from, to);
                assert_eq!(change, switches.next(from, to, false).is_some(), "{home:?} {stuck:?} {from} {to}");
                changes += usize::from(change);
            }
            assert!(changes > 50, "{home:?} {stuck:?}");
        }
    }
}

/// An input that sticks reads so everywhere, until it works again.
#[test]
fn stuck_inputs_in_0x60fd() {
    let mut bench = Bench::new(travel(CAM), 0);
    for (input, bit) in [(Input::NegativeLimit, 0), (Input::PositiveLimit, 1), (Input::Home, 2)] {
        for (value, shown) in [(Some(true), 1), (Some(false), 0), (None, u32::from(bit == 2))] {
            assert!(bench.rig.drive.apply_fault(stick(input, value)));
            assert_eq!(bench.rig.read(0x60FD, 0) >> bit & 1, shown, "{input:?} {value:?}");
        }
    }
    assert!(
        !bench.rig.drive.apply_fault(Fault::Stick { axis: 1, input: Some(Input::Home), value: None }),
        "there is no second axis"
    );
    assert!(!bench.rig.drive.apply_fault(Fault::Jam { axis: 1, jammed: true }));
    let mut io = Io::default();
    assert!(!io.apply_fault(stick(Input::Home, None)) && !io.apply_fault(jam(true)), "nor any axis of an IO module");
}

/// A jammed shaft does not move whatever the torque is; the following error grows on its own and is a fault, which ends
/// homing.
#[test]
fn jammed() {
    let mut bench = Bench::new(travel(CAM), -190_000);
    bench.start(20);
    bench.run_for_ms(50);
    assert!(bench.rig.drive.apply_fault(jam(true)));
    bench.cycle();
    let stands = bench.shaft();
    let mut torque = 0;
    while bench.rig.state() == DriveState::OperationEnabled {
        bench.cycle();
        assert_eq!((bench.shaft(), bench.rig.velocity()), (stands, 0.0));
        torque = torque.max(bench.rig.torque());
    }
    assert_eq!((torque, bench.rig.read(0x603F, 0)), (3000, 0x8611));
    bench.run_for_ms(500);
    assert_eq!((bench.bits(), bench.error(), bench.shaft()), (Bits::Error, HomingError::PowerLost, stands));
    assert!(bench.rig.drive.apply_fault(jam(false)));
    bench.rig.out.controlword.0 = 0x80;
    bench.cycle();
    bench.rig.enable();
    assert_eq!(bench.home(20).end, Ok(FIRST));
}

/// A jammed shaft in the cyclic modes: a position is not reached and that is a fault, a velocity and a torque are just
/// not reached; freed, it follows again.
#[test]
fn jammed_in_cyclic_modes() {
    for mode in [Mode::Csv, Mode::Cst] {
        let mut rig = crate::rig::Rig::enabled(DriveConfig::default(), mode, MS);
        rig.drive.apply_fault(jam(true));
        rig.out.target = 500;
        rig.run_for(100 * MS);
        assert_eq!((rig.position(), rig.velocity(), rig.state()), (0, 0.0, DriveState::OperationEnabled));
        rig.drive.apply_fault(jam(false));
        rig.run_for(100 * MS);
        assert!(rig.position() > 10, "{mode}");
    }
}

/// End stops: the shaft goes no further, its loops push, and the following error is a fault.
#[test]
fn end_stops() {
    let stops = (-250_000, 310_000);
    let mut bench = Bench::new(Travel { stops: Some(stops), ..travel(CAM) }, 150_000);
    bench.rig.drive.apply_fault(stick(Input::PositiveLimit, Some(false)));
    bench.start(2);
    bench.run_for_ms(2_000);
    assert_eq!((bench.shaft(), bench.rig.state(), bench.bits()), (stops.1, DriveState::Fault, Bits::Error));
    let mut bench = Bench::new(Travel { stops: Some(stops), ..travel(CAM) }, 0);
    assert_eq!(bench.home(17).end, Ok(NEGATIVE_LIMIT + 1), "they are beyond the switches");
}

/// The travel of another motor is its turns, not the default motor's counts.
#[test]
fn travel_of_a_motor() {
    let motor = Motor { counts_per_turn: 4_000, max_velocity: 400_000, ..Motor::default() };
    let travel = Travel::for_turn(motor.counts_per_turn);
    assert_eq!((travel.negative_limit, travel.positive_limit), (Some(-40_000), Some(40_000)));
    assert_eq!(Travel::default().positive_limit, Some(10 * TURN));
    assert!(travel.stops.is_none() && FAST > 0);
}

/// The handle of a simulated bus sticks inputs and jams shafts by slave number, from the next cycle on; a missing slave
/// or axis is ignored.
#[test]
fn by_the_handle_of_the_bus() {
    let mut bus = support::fieldbus_rig::Bench::enabled(3);
    let read = |bus: &mut support::fieldbus_rig::Bench| {
        [1, 2, 3].map(|slave| bus.transferred(support::fieldbus_rig::sdo(slave, 0x60FD, None)).expect("it is read"))
    };
    // The axes are on the cam of the default travel.
    let cam = 0b100;
    assert_eq!(read(&mut bus), [cam; 3]);
    for (slave, axis) in [(2, 0), (0, 0), (1, 1), (40, 0)] {
        bus.handle.apply_fault(slave, Fault::Stick { axis, input: Some(Input::PositiveLimit), value: Some(true) });
    }
    assert_eq!(read(&mut bus), [cam, cam | 0b10, cam]);
    bus.handle.apply_fault(2, stick(Input::PositiveLimit, None));
    assert_eq!(read(&mut bus), [cam; 3]);
    for (slave, axis) in [(3, 0), (0, 0), (2, 1), (40, 0)] {
        bus.handle.apply_fault(slave, Fault::Jam { axis, jammed: true });
    }
    let follow = |bus: &mut support::fieldbus_rig::Bench, by: i32| {
        for _ in 0..200 {
            for slave in [2, 3] {
                *bus.target(slave) += by;
            }
            bus.cycle();
        }
        [2, 3].map(|slave| bus.handle.shaft(slave, 0))
    };
    assert_eq!(follow(&mut bus, 100)[1], Some(3_000));
    assert_eq!(follow(&mut bus, 0), [Some(22_000), Some(3_000)]);
    bus.handle.apply_fault(3, jam(false));
    assert_eq!(follow(&mut bus, 0), [Some(22_000), Some(23_000)]);
}
