//! A random machine and a random program for it, both fixed by a seed before anything runs.

use ecmsk::cia402::Mode;
use ecmsk::sk::{MasterState, SlaveKind, SlotSize};
use ecmsk::slave::{Channels, Drive, DriveConfig, HomeSwitch, Hsp, HspConfig, Io, Slave, Travel};
use support::dice::Dice;

/// A slave of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    pub kind: SlaveKind,
    /// `None`: it has no axes.
    pub mode: Option<Mode>,
    /// Axes whose targets are on the wire.
    pub axes: usize,
    channels: Channels,
    position: i64,
}

impl Unit {
    fn random(size: SlotSize, dice: &mut Dice) -> Self {
        let near = dice.below(60_000) as i64 - 30_000;
        let unit = |kind, mode| Self { kind, mode: Some(mode), axes: 1, channels: Channels::One, position: near };
        match dice.below(8) {
            0 => Self { mode: None, axes: 0, ..unit(SlaveKind::Io, Mode::Csp) },
            1 => unit(SlaveKind::Step, Mode::Csp),
            2 => unit(SlaveKind::Hsp, dice.pick(&[Mode::Csp, Mode::Csv])),
            3 => {
                let axes = if size == SlotSize::Bytes16 { 2 } else { 1 };
                Self { axes, channels: Channels::Two, ..unit(SlaveKind::Hsp, dice.pick(&[Mode::Csp, Mode::Csv])) }
            }
            4 => unit(SlaveKind::Drive, dice.pick(&[Mode::Csv, Mode::Cst])),
            _ => unit(SlaveKind::Drive, Mode::Csp),
        }
    }

    pub fn model(&self) -> Box<dyn Slave> {
        let turn = DriveConfig::default().motor.counts_per_turn;
        // Short, so that homing ends soon.
        let travel = Travel {
            negative_limit: Some(-100_000),
            positive_limit: Some(100_000),
            home: Some(HomeSwitch::Cam { first: -2000, last: 2000 }),
            ..Travel::for_turn(turn)
        };
        match self.kind {
            SlaveKind::Io | SlaveKind::None => Box::new(Io::default()),
            SlaveKind::Hsp => Box::new(Hsp::new(HspConfig::with(self.channels))),
            SlaveKind::Step => Box::new(Drive::new(DriveConfig { position: self.position, ..DriveConfig::stepper() })),
            SlaveKind::Drive => {
                Box::new(Drive::new(DriveConfig { position: self.position, travel, ..DriveConfig::default() }))
            }
        }
    }

    /// It is moved by positions.
    pub fn is_csp(&self) -> bool {
        self.mode == Some(Mode::Csp)
    }

    fn homes(&self) -> bool {
        self.kind == SlaveKind::Drive && self.is_csp()
    }

    fn has_alarms(&self) -> bool {
        matches!(self.kind, SlaveKind::Drive | SlaveKind::Step)
    }
}

/// How a program paces its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Keeps that many in the board's FIFO.
    Ahead(u16),
    /// One for each report.
    EachReport,
    /// As [`Self::Ahead`] 140; now and then the program pauses for that many milliseconds.
    WithStalls(u64),
    /// The FIFO's threshold: it begins when fewer than that many places are free.
    Threshold(u32),
}

/// An event in the middle of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meanwhile {
    Nothing,
    /// SDOs are read, by the frames of the motion.
    Sdos(usize),
    /// A slave that takes no part is switched on, or off.
    On(usize),
    Off(usize),
    /// A slave of the motion has an alarm.
    Alarm(usize),
    /// A slave outside the motion loses its power, and returns when the motion has ended.
    Lost(usize),
    /// The same, and it returns while the others go on.
    LostAndBack(usize),
    /// SET_FIFO clear.
    Clear,
}

/// A motion of some slaves together, there and back or on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Motion {
    pub slaves: Vec<usize>,
    pub frames: u32,
    /// At most that many counts per cycle; in CSV a hundred times as many per second.
    pub speed: i32,
    pub pace: Pace,
    pub meanwhile: Meanwhile,
}

/// A part of the program. After each the machine is at rest, and no command is pending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    Op,
    Leave(MasterState),
    On(Vec<usize>),
    Off(Vec<usize>),
    Move(Motion),
    Home(usize, i8),
    /// Objects are read and written, while nothing moves.
    Sdo(usize),
    /// An SDO that the slave aborts.
    SdoAborted(usize),
    /// A slave refuses OP once.
    Refused(usize),
    Outputs(usize, u16),
}

/// The machine and its program.
#[derive(Clone, Debug)]
pub struct Plan {
    pub size: SlotSize,
    pub cycle_us: u32,
    pub ahead: u16,
    pub units: Vec<Unit>,
    pub steps: Vec<Step>,
}

impl Plan {
    pub fn random(seed: u64) -> Self {
        let mut dice = Dice(seed ^ 0x006D_6967_7261_7465);
        let size = dice.pick(&[SlotSize::Bytes12, SlotSize::Bytes16]);
        let cycle_us = dice.pick(&[250, 500, 1000, 1000, 1000, 1000, 2000, 4000]);
        let mut units = vec![Unit::random(size, &mut dice)];
        while units.len() < 5 && !dice.one_in(4) {
            units.push(Unit::random(size, &mut dice));
        }
        let ahead = dice.pick(&[4, 4, 1, 8, 20]);
        let mut steps = vec![Step::Op];
        let mut on = vec![false; units.len()];
        for _ in 0..6 + dice.below(5) {
            steps.push(next(&units, &mut on, &mut dice));
        }
        Self { size, cycle_us, ahead, units, steps }
    }

    pub fn slaves(&self) -> Vec<Box<dyn Slave>> {
        self.units.iter().map(Unit::model).collect()
    }
}

/// Slaves that satisfy `of`.
fn those(units: &[Unit], of: impl Fn(usize, &Unit) -> bool) -> Vec<usize> {
    (1..).zip(units).filter(|(slave, unit)| of(*slave, unit)).map(|(slave, _)| slave).collect()
}

fn any(of: &[usize], dice: &mut Dice) -> Option<usize> {
    (!of.is_empty()).then(|| of[dice.below(of.len() as u64) as usize])
}

fn next(units: &[Unit], on: &mut [bool], dice: &mut Dice) -> Step {
    let off = those(units, |slave, unit| unit.axes > 0 && !on[slave - 1]);
    let is_on = those(units, |slave, _| on[slave - 1]);
    let slave = 1 + dice.below(units.len() as u64) as usize;
    match dice.below(16) {
        0 => Step::Sdo(slave),
        1 if dice.one_in(2) => Step::SdoAborted(slave),
        2 if dice.one_in(2) => {
            on.fill(false);
            Step::Leave(dice.pick(&[MasterState::SafeOp, MasterState::PreOp, MasterState::Init]))
        }
        3 if dice.one_in(3) => {
            on.fill(false);
            Step::Refused(slave)
        }
        4 if units[slave - 1].kind == SlaveKind::Io => Step::Outputs(slave, dice.roll() as u16),
        5 if !is_on.is_empty() => {
            let slave = is_on[dice.below(is_on.len() as u64) as usize];
            on[slave - 1] = false;
            Step::Off(vec![slave])
        }
        6 | 7 => {
            let home = those(units, |slave, unit| on[slave - 1] && unit.homes());
            match any(&home, dice) {
                Some(slave) => Step::Home(slave, dice.pick(&[35, 17, 18, 19, 21, 24, 28, 33, 1])),
                None => switch_on(&off, on, dice).unwrap_or(Step::Sdo(slave)),
            }
        }
        8..=10 if !off.is_empty() => switch_on(&off, on, dice).unwrap_or(Step::Sdo(slave)),
        _ if is_on.is_empty() => switch_on(&off, on, dice).unwrap_or(Step::Sdo(slave)),
        _ => Step::Move(motion(units, on, is_on, dice)),
    }
}

fn switch_on(off: &[usize], on: &mut [bool], dice: &mut Dice) -> Option<Step> {
    let mut slaves: Vec<usize> = off.iter().copied().filter(|_| !dice.one_in(3)).collect();
    slaves.extend(any(off, dice).filter(|_| slaves.is_empty()));
    slaves.iter().for_each(|slave| on[slave - 1] = true);
    (!slaves.is_empty()).then_some(Step::On(slaves))
}

fn motion(units: &[Unit], on: &mut [bool], is_on: Vec<usize>, dice: &mut Dice) -> Motion {
    let mut slaves: Vec<usize> = is_on.iter().copied().filter(|_| !dice.one_in(4)).collect();
    if slaves.is_empty() {
        slaves.clone_from(&is_on);
    }
    let others = those(units, |slave, _| !slaves.contains(&slave));
    let others_off = those(units, |slave, unit| unit.axes > 0 && !on[slave - 1]);
    let others_on = those(units, |slave, _| on[slave - 1] && !slaves.contains(&slave));
    let with_alarms = those(units, |slave, unit| slaves.contains(&slave) && unit.has_alarms() && unit.is_csp());
    let meanwhile = match dice.below(12) {
        0 | 1 => Some(Meanwhile::Sdos(1 + dice.below(units.len() as u64) as usize)),
        2 => any(&others_off, dice).map(Meanwhile::On),
        3 => any(&others_on, dice).map(Meanwhile::Off),
        4 | 5 => any(&with_alarms, dice).map(Meanwhile::Alarm),
        6 => any(&others, dice).map(Meanwhile::Lost),
        7 => any(&others, dice).map(Meanwhile::LostAndBack),
        8 => Some(Meanwhile::Clear),
        _ => None,
    };
    let meanwhile = meanwhile.unwrap_or(Meanwhile::Nothing);
    match meanwhile {
        Meanwhile::On(slave) => on[slave - 1] = true,
        Meanwhile::Off(slave) | Meanwhile::Lost(slave) | Meanwhile::LostAndBack(slave) => on[slave - 1] = false,
        _ => {}
    }
    Motion {
        slaves,
        frames: 60 + dice.below(240) as u32,
        speed: 4 + dice.below(60) as i32,
        pace: dice.pick(&[
            Pace::Ahead(40),
            Pace::Ahead(120),
            Pace::EachReport,
            Pace::WithStalls(30),
            Pace::Threshold(120),
            Pace::Ahead(10),
        ]),
        meanwhile,
    }
}
