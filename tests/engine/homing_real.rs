//! Homing through the board with the simulated drives: SDOs, GO_HOME, bits 10 and 12, back to CSP, and on without a jump
//! of the shaft.

use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, EventKind, Firmware, HomingEnd, HomingPhase};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{Frame, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind};
use ecmsk::slave::plant::Motor;
use ecmsk::slave::{Drive, DriveConfig, Fault, HomeSwitch, Input, Slave, Travel};

use crate::homer::{BIT_10, BIT_12, BIT_13};
use crate::host::Host;
use support::homing_tables::{METHODS, Places};

const PROFILES: [Firmware; 2] = [Firmware::V17, Firmware::V15];
const DONE: u16 = BIT_10 | BIT_12;
/// 0x607C of the tests.
const OFFSET: i32 = -4321;

/// The kind of axis.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Servo,
    Stepper,
}

impl Kind {
    fn config(self) -> DriveConfig {
        match self {
            Self::Servo => DriveConfig::default(),
            Self::Stepper => DriveConfig::stepper(),
        }
    }

    const fn declared(self) -> SlaveKind {
        match self {
            Self::Servo => SlaveKind::Drive,
            Self::Stepper => SlaveKind::Step,
        }
    }
}

/// A travel of four turns, whose switches are at the same parts of a turn for every motor.
fn places(motor: &Motor) -> Places {
    let turn = i64::from(motor.counts_per_turn);
    Places { limits: (-turn * 3 / 2, turn * 23 / 10), cam: (-turn * 3 / 10, turn * 4 / 10), index: turn / 10, turn }
}

fn travel(places: &Places) -> Travel {
    Travel {
        negative_limit: Some(places.limits.0),
        positive_limit: Some(places.limits.1),
        home: Some(HomeSwitch::Cam { first: places.cam.0, last: places.cam.1 }),
        index: Some(places.index as u32),
        limits_stop_motion: false,
        stops: None,
        search_limit: 20 * places.turn.unsigned_abs(),
    }
}

/// A start position from which the method finds home.
fn start_of(method: i8, places: &Places) -> i64 {
    let right = places.cam.1 + places.turn / 2;
    if places.home(method, right).is_some() { right } else { places.cam.0 - places.turn / 2 }
}

/// A board with such drives, in OP and on.
struct Axes {
    host: Host,
    network: SimHandle,
    shafts: Vec<i64>,
    /// Greatest distance of a shaft in a cycle so far, counts.
    way: i64,
}

impl Axes {
    fn on(firmware: Firmware, kind: Kind, configs: Vec<DriveConfig>) -> Self {
        let n = configs.len();
        let bus =
            SimBus::new(configs.into_iter().map(|config| Box::new(Drive::new(config)) as Box<dyn Slave>).collect());
        let network = bus.handle();
        let mut host = Host::new(EngineConfig { firmware, ..EngineConfig::default() }, bus);
        let kinds = std::array::from_fn(|k| if k < n { kind.declared() } else { SlaveKind::None });
        host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).drained();
        (1..=n).for_each(|slave| {
            host.servo_on(slave);
        });
        let mut axes = Self { host, network, shafts: vec![0; n], way: 0 };
        axes.look();
        axes.way = 0;
        axes
    }

    fn look(&mut self) {
        for (slave, shaft) in (1..).zip(&mut self.shafts) {
            let now = self.network.shaft(slave, 0).expect("a drive has a shaft");
            self.way = self.way.max((now - *shaft).abs());
            *shaft = now;
        }
    }

    fn cycle(&mut self) {
        self.host.cycle();
        self.look();
    }

    fn cycles(&mut self, n: usize) {
        (0..n).for_each(|_| self.cycle());
    }

    fn until(&mut self, what: &str, done: impl Fn(&Host) -> bool) {
        for _ in 0..60_000 {
            if done(&self.host) {
                return;
            }
            self.cycle();
        }
        panic!("never: {what}");
    }

    fn write(&mut self, slave: usize, index: u16, sub: u8, size: SdoSize, value: i64) {
        let written = self.host.write_object(slave as u8, index, sub, size, value as u32);
        assert!(written.is_ok(), "{index:04X}:{sub} {written:?}");
    }

    /// Writes what an application writes before GO_HOME (SK-7.19): 4 turns/s, 1 turn/s, 200 turns/s².
    fn prepare(&mut self, slave: usize, method: i8, turn: i64) {
        self.write(slave, 0x6060, 0, SdoSize::One, 6);
        self.write(slave, 0x6098, 0, SdoSize::One, method.into());
        self.write(slave, 0x607C, 0, SdoSize::Four, OFFSET.into());
        self.write(slave, 0x6099, 1, SdoSize::Four, 4 * turn);
        self.write(slave, 0x6099, 2, SdoSize::Four, turn);
        self.write(slave, 0x609A, 0, SdoSize::Four, 200 * turn);
    }

    /// Brings the drive back to CSP after homing, by the firmware or by the program.
    fn back_to_csp(&mut self, slave: usize, firmware: Firmware) {
        if firmware == Firmware::V15 {
            self.write(slave, 0x6060, 0, SdoSize::One, 8);
        }
        self.until("no homing", |host| host.board.engine().homing_phase(slave as u8) == HomingPhase::Idle);
        self.cycles(20);
        assert_eq!(self.host.read_object(slave as u8, 0x6061, 0), Ok(8));
    }

    /// Moves on from the present position by 50 counts a cycle; the shaft moves exactly so far, and only a little in
    /// each cycle.
    fn move_on(&mut self, slaves: &[usize]) {
        self.cycles(100);
        let from: Vec<i64> = self.shafts.clone();
        let targets: Vec<i32> = slaves.iter().map(|slave| self.host.drive(*slave).position).collect();
        self.way = 0;
        for step in 1..=100 {
            self.host.build(|frame, size| {
                for (slave, target) in slaves.iter().zip(&targets) {
                    frame.put_slave(size, *slave, &SlaveCommand::Csp(Motion::to(target + 50 * step)).into());
                }
            });
            self.cycle();
        }
        self.host.drained();
        self.cycles(300);
        for slave in slaves {
            let way = self.shafts[slave - 1] - from[slave - 1];
            assert!((4995..=5005).contains(&way), "slave {slave} went {way} counts, not 5000");
        }
        assert!(self.way <= 300, "{} counts in a cycle", self.way);
    }

    fn ends(&self, mark: u64) -> Vec<(u8, HomingEnd)> {
        let events = self.host.board.engine().events_since(mark).filter_map(|event| match event.kind {
            EventKind::HomingEnded { slave, end, .. } => Some((slave, end)),
            _ => None,
        });
        events.collect()
    }
}

fn shows(host: &Host, slave: usize, bits: u16) -> bool {
    host.drive(slave).statusword.0 & bits == bits
}

/// SK-7.19 SK-7.20 SK-7.22 SK-7.23 SK-7.16 Every method, with the servo drive and the stepper, in both profiles: from SDOs
/// over GO_HOME and bits 10 and 12 back to CSP and on. The home is where the tables have it, its position is 0x607C, and
/// the shaft never jumps.
#[test]
fn every_method_through_the_board() {
    for (kind, firmware) in [Kind::Servo, Kind::Stepper].into_iter().flat_map(|kind| PROFILES.map(|fw| (kind, fw))) {
        for method in METHODS {
            let config = kind.config();
            let places = places(&config.motor);
            let position = start_of(method, &places);
            let config = DriveConfig { position, travel: travel(&places), ..config };
            let mut axes = Axes::on(firmware, kind, vec![config]);
            let what = format!("{kind:?} {firmware:?} method {method}");
            axes.prepare(1, method, places.turn);
            let mark = axes.host.mark();
            axes.host.slave(1, SlaveCommand::GoHome);
            axes.until("bits 10 and 12", |host| shows(host, 1, DONE));
            axes.back_to_csp(1, firmware);
            assert_eq!(axes.ends(mark), [(1, HomingEnd::Attained)], "{what}");
            axes.cycles(200);
            let home = axes.shafts[0] - i64::from(axes.host.drive(1).position - OFFSET);
            let expected = places.home(method, position).expect("a home");
            // Methods that use the present position have the tolerance of the control loops.
            let tolerance = if method >= 35 { 2 } else { 0 };
            assert!((home - expected).abs() <= tolerance, "{what}: home at {home}, not {expected}");
            // 4 turns/s, and the overshoot of the loop.
            assert!(axes.way <= places.turn * 41 / 10_000 + 30, "{what}: {} counts in a cycle", axes.way);
            axes.move_on(&[1]);
            assert_eq!((axes.host.counters().rejected_total(), axes.host.counters().ignored_homing), (0, 0), "{what}");
        }
    }
}

/// SK-7.21 A homing error: bit 13 is in the slot, the mode comes back (SK-7.22), and the drive moves on in the coordinate
/// it had. A switch that sticks, a switch that is not wired, an unknown method.
#[test]
fn a_homing_that_fails() {
    for (firmware, case) in PROFILES.into_iter().flat_map(|firmware| (0..3).map(move |case| (firmware, case))) {
        let places = places(&Motor::default());
        let travel = if case == 1 { Travel::NONE } else { travel(&places) };
        let config = DriveConfig { position: 1000, travel, ..DriveConfig::default() };
        let mut axes = Axes::on(firmware, Kind::Servo, vec![config]);
        axes.prepare(1, if case == 2 { 16 } else { 17 }, places.turn);
        if case == 0 {
            axes.network.apply_fault(1, Fault::Stick { axis: 0, input: Some(Input::PositiveLimit), value: Some(true) });
            axes.network.apply_fault(1, Fault::Stick { axis: 0, input: Some(Input::NegativeLimit), value: Some(true) });
        }
        let mark = axes.host.mark();
        axes.host.slave(1, SlaveCommand::GoHome);
        axes.until("bit 13", |host| shows(host, 1, BIT_13));
        axes.back_to_csp(1, firmware);
        axes.cycles(200);
        assert_eq!(axes.ends(mark), [(1, HomingEnd::Error)], "{firmware:?}, case {case}");
        assert_eq!(i64::from(axes.host.drive(1).position), axes.shafts[0], "no other coordinate");
        assert!(axes.host.drive(1).statusword.is_enabled(), "an error is no fault");
        axes.move_on(&[1]);
    }
}

/// SK-7.21 A shaft that is jammed during homing ends in a fault by its following error (0x8611), and the board's homing
/// with it. After ALM_CLR, SV_ON and another GO_HOME home is found.
#[test]
fn a_jam_ends_homing_by_a_fault() {
    for firmware in PROFILES {
        let places = places(&Motor::default());
        let config = DriveConfig { position: 1000, travel: travel(&places), ..DriveConfig::default() };
        let mut axes = Axes::on(firmware, Kind::Servo, vec![config]);
        axes.prepare(1, 17, places.turn);
        let mark = axes.host.mark();
        axes.host.slave(1, SlaveCommand::GoHome);
        axes.cycles(100);
        axes.network.apply_fault(1, Fault::Jam { axis: 0, jammed: true });
        axes.until("the following error", |host| host.drive(1).error_code == 0x8611);
        axes.network.apply_fault(1, Fault::Jam { axis: 0, jammed: false });
        axes.back_to_csp(1, firmware);
        assert_eq!(axes.ends(mark), [(1, HomingEnd::NotEnabled)]);
        axes.host.slave(1, SlaveCommand::AlarmClear).cycles(50);
        axes.host.servo_on(1);
        axes.prepare(1, 17, places.turn);
        axes.host.slave(1, SlaveCommand::GoHome);
        axes.until("bits 10 and 12", |host| shows(host, 1, DONE));
        axes.back_to_csp(1, firmware);
        axes.cycles(200);
        assert_eq!(axes.shafts[0] - i64::from(axes.host.drive(1).position - OFFSET), places.limits.0 + 1);
        axes.move_on(&[1]);
    }
}

/// SK-7.28 Eight drives home by one frame, each by a method of its own: they start together, each ends where its method
/// does, every mode comes back, and all move on.
#[test]
fn eight_drives_home_by_one_frame() {
    for firmware in PROFILES {
        let methods = [17, 18, 1, 24, 12, 33, 37, 30];
        let places = places(&Motor::default());
        let start = |method| start_of(method, &places);
        let config =
            |method| DriveConfig { position: start(method), travel: travel(&places), ..DriveConfig::default() };
        let mut axes = Axes::on(firmware, Kind::Servo, methods.map(config).into());
        (1..).zip(methods).for_each(|(slave, method)| axes.prepare(slave, method, places.turn));
        let mark = axes.host.mark();
        let mut frame = Frame::new();
        (1..=8).for_each(|slave| frame.put_slave(axes.host.size, slave, &SlaveCommand::GoHome.into()));
        axes.host.send(&frame);
        axes.cycles(10);
        let homing = |slave| axes.host.board.engine().homing_phase(slave) == HomingPhase::Homing;
        let under_way: Vec<u8> = (1..=8).filter(|slave| homing(*slave)).collect();
        assert_eq!(under_way, [1, 2, 3, 4, 5, 6, 8], "by method 37 slave 7 is home at once");
        axes.until("eight times bits 10 and 12", |host| (1..=8).all(|slave| shows(host, slave, DONE)));
        (1..=8).for_each(|slave| axes.back_to_csp(slave, firmware));
        axes.cycles(200);
        let mut ends = axes.ends(mark);
        ends.sort_by_key(|(slave, _)| *slave);
        assert_eq!(ends, (1..=8).map(|slave| (slave, HomingEnd::Attained)).collect::<Vec<_>>());
        for (slave, method) in (1..).zip(methods) {
            let home = axes.shafts[slave - 1] - i64::from(axes.host.drive(slave).position - OFFSET);
            let expected = places.home(method, start(method)).expect("a home");
            assert!((home - expected).abs() <= 2, "{firmware:?} slave {slave}: {home}, not {expected}");
        }
        axes.move_on(&[1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(axes.host.counters().rejected_total(), 0);
    }
}
