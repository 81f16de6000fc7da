//! A drive in homing mode, a master that sends it its actual position as target, and the invariants of every cycle.

use ecmsk::cia402::{Controlword, Mode, Statusword};
use ecmsk::coe::SdoSize;
use ecmsk::fieldbus::AlState;
use ecmsk::slave::homing::HomingError;
use ecmsk::slave::{DriveConfig, HomeSwitch, Slave, Travel};

use crate::rig::{MS, Rig};

pub const TURN: i64 = 1 << 17;
/// Speeds of the tests, counts/s, and their ramp, counts/s²: 4 turns/s, 1 turn/s and 200 turns/s².
pub const FAST: i64 = 4 * TURN;
pub const SLOW: i64 = TURN;
pub const RAMP: i64 = 200 * TURN;
/// The allowed overshoot of the shaft's speed in a cycle: a 50th.
const SPEED_MARGIN: f64 = 1.02;

pub const NEGATIVE_LIMIT: i64 = -200_000;
pub const POSITIVE_LIMIT: i64 = 300_000;
pub const FIRST: i64 = -40_000;
pub const LAST: i64 = 60_000;
/// Pulses at ..., -249 799, -118 727, 12 345, 143 417, 274 489, ...
pub const INDEX: u32 = 12_345;
pub const CAM: HomeSwitch = HomeSwitch::Cam { first: FIRST, last: LAST };

pub fn travel(home: HomeSwitch) -> Travel {
    Travel {
        negative_limit: Some(NEGATIVE_LIMIT),
        positive_limit: Some(POSITIVE_LIMIT),
        home: Some(home),
        index: Some(INDEX),
        limits_stop_motion: true,
        stops: None,
        search_limit: 2_000_000,
    }
}

/// Statusword bits 13, 12 and 10, by the table of homing mode in CiA 402-2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bits {
    Running,
    NotRunning,
    AttainedMoving,
    Done,
    ErrorMoving,
    Error,
}

impl Bits {
    pub fn of(word: Statusword) -> Self {
        match (word.0 >> 13 & 1, word.0 >> 12 & 1, word.0 >> 10 & 1) {
            (0, 0, 0) => Self::Running,
            (0, 0, 1) => Self::NotRunning,
            (0, 1, 0) => Self::AttainedMoving,
            (0, 1, 1) => Self::Done,
            (1, 0, 0) => Self::ErrorMoving,
            (1, 0, 1) => Self::Error,
            other => panic!("{other:?} is reserved"),
        }
    }
}

pub struct Bench {
    pub rig: Rig,
    /// The position actual value minus the count of the shaft, after its last change.
    pub origin: i32,
    /// How often `origin` has changed.
    pub steps: u32,
    /// The greatest distance of the shaft in a cycle, counts.
    pub way_limit: f64,
}

impl Bench {
    /// A drive in Operation enabled and homing mode, with the speeds of the tests.
    pub fn new(travel: Travel, start: i64) -> Self {
        let mut bench = Self::in_csp(travel, start);
        bench.set_mode(Mode::Homing);
        bench
    }

    pub fn in_csp(travel: Travel, start: i64) -> Self {
        let config = DriveConfig { position: start, travel, ..DriveConfig::default() };
        let mut rig = Rig::enabled(config, Mode::Csp, MS);
        for (sub, speed) in [(1, FAST), (2, SLOW)] {
            rig.write(0x6099, sub, SdoSize::Four, speed);
        }
        rig.write(0x609A, 0, SdoSize::Four, RAMP);
        let way_limit = (FAST as f64 * SPEED_MARGIN + RAMP as f64 * 2e-3) / 1000.0;
        let mut bench = Self { rig, origin: 0, steps: 0, way_limit };
        bench.origin = bench.origin_now();
        bench
    }

    pub fn set_mode(&mut self, mode: Mode) {
        self.rig.write(0x6060, 0, SdoSize::One, mode.code().into());
        assert_eq!(self.rig.read(0x6061, 0), u32::from(mode.code()));
    }

    pub fn set_method(&mut self, method: i8) {
        self.rig.write(0x6098, 0, SdoSize::One, method.into());
    }

    /// One cycle, in which the master sends the actual position of the cycle before. Checks that the shaft does not jump, and that
    /// the origin of its position changes only in the cycle in which homing is attained.
    pub fn cycle(&mut self) -> Bits {
        let (shaft, attained) = (self.shaft(), self.is_attained());
        self.rig.out.target = self.rig.seen.position;
        self.rig.cycle();
        let way = (self.shaft() - shaft).abs();
        assert!(way as f64 <= self.way_limit, "{way} counts in a cycle");
        if self.origin_now() != self.origin {
            assert!(self.is_attained() && !attained, "the position stepped by itself");
            self.origin = self.origin_now();
            self.steps += 1;
        }
        assert_eq!(self.rig.drive.axis().origin(), i64::from(self.origin), "what the axis itself says");
        Bits::of(self.rig.status())
    }

    pub fn run_for_ms(&mut self, ms: u32) {
        for _ in 0..ms {
            self.cycle();
        }
    }

    pub fn controlword(&mut self, bits: u16) {
        self.rig.out.controlword = Controlword(Controlword::ENABLE_OPERATION.0 | bits);
    }

    /// Lets bit 4 of the controlword fall and rise.
    pub fn start(&mut self, method: i8) {
        self.set_method(method);
        self.controlword(0);
        self.cycle();
        self.controlword(Controlword::HOMING_START);
    }

    /// Runs homing to its end. Returns the count of the shaft at home, and the direction in which it moved first.
    pub fn home(&mut self, method: i8) -> Outcome {
        self.start(method);
        let (start, mut first) = (self.shaft(), '.');
        for _ in 0..60_000 {
            let bits = self.cycle();
            if first == '.' {
                first = match self.shaft() - start {
                    ..-20 => '-',
                    -20..=20 => '.',
                    _ => '+',
                };
            }
            match bits {
                Bits::Done => return Outcome { first, end: Ok(self.home_count()) },
                Bits::Error => return Outcome { first, end: Err(self.error()) },
                Bits::NotRunning => panic!("method {method} does not run"),
                Bits::Running | Bits::AttainedMoving | Bits::ErrorMoving => {}
            }
        }
        panic!("method {method} does not end");
    }

    /// The count of the shaft at home, if 0x607C is 0.
    pub fn home_count(&self) -> i64 {
        -i64::from(self.origin)
    }

    pub fn error(&self) -> HomingError {
        self.rig.drive.axis().homing().error().expect("bit 13 has a reason")
    }

    pub fn shaft(&self) -> i64 {
        self.rig.drive.shaft(0).expect("a drive has a shaft")
    }

    pub fn bits(&self) -> Bits {
        Bits::of(self.rig.status())
    }

    pub fn leave_op(&mut self) {
        self.rig.drive.enter(AlState::SafeOp).expect("that is always open");
    }

    fn origin_now(&self) -> i32 {
        self.rig.drive.axis().measured().position.wrapping_sub(self.shaft() as i32)
    }

    fn is_attained(&self) -> bool {
        let homing = self.rig.mode() == Mode::Homing;
        homing && matches!(Bits::of(self.rig.status()), Bits::AttainedMoving | Bits::Done)
    }
}

/// How a homing run began and ended.
#[derive(Debug, PartialEq)]
pub struct Outcome {
    /// The direction in which the shaft moved first, `+` or `-`; `.`: it has not moved.
    pub first: char,
    pub end: Result<i64, HomingError>,
}
