//! A random writer: it brings the network up, homes, sets thresholds, moves its axes at any pace, and dies at a random
//! message.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryClient};
use ecmsk::sk::{
    FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SdoCommand, SlaveCommand, SlaveKind,
    SlotCommand, SlotSize,
};

use super::course::Accepted;
use super::eyes::Eyes;
use crate::machine::{SPEED, Unit};
use support::dice::Dice;

/// The most messages of a writer.
const MESSAGES: u64 = 2500;
/// How far a target in CSP may jump from one frame to the next beyond the path, when a path begins, counts.
const BEGIN: i64 = 300;

/// The writer is dead.
struct Dead;

/// What a writer did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Life {
    pub lost: u64,
    pub has_threshold: bool,
    pub has_homed: bool,
    pub torn: bool,
    /// Frames that the board has refused for their CRC.
    pub spoiled: u64,
    /// Whether its targets were cleared, or began at an unknown position, so that it jumps by itself.
    jumps: bool,
}

/// What the board has taken from it, and the greatest steps and velocities of that.
pub struct Bounds {
    greatest: BTreeMap<(u8, usize, &'static str), i64>,
    jumps: bool,
    accepted: Accepted,
}

impl fmt::Debug for Bounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { greatest, jumps, accepted: _ } = self;
        f.debug_struct("Bounds").field("greatest", greatest).field("jumps", jumps).finish_non_exhaustive()
    }
}

impl Bounds {
    /// Whether it jumps by itself.
    pub const fn jumps(&self) -> bool {
        self.jumps
    }

    /// All targets, velocities and torques.
    pub fn accepted(&self) -> &Accepted {
        &self.accepted
    }

    /// For each axis, the greatest value of the writer and that of the server.
    pub fn compare<'a>(&'a self, eyes: &'a Eyes) -> impl Iterator<Item = ((u8, usize, &'static str), (i64, i64))> + 'a {
        eyes.greatest().into_iter().filter(|_| !self.jumps).map(|(slave, axis, mode, server)| {
            let key = (slave, axis, mode);
            (key, (self.greatest.get(&key).copied().unwrap_or_default() + BEGIN, server))
        })
    }
}

pub struct Writer<'a> {
    caller: InMemoryClient<'a>,
    eyes: Arc<Eyes>,
    units: &'a [Unit],
    size: SlotSize,
    cycle_us: u32,
    dice: Dice,
    /// Messages until it dies.
    left: u64,
    life: Life,
    /// The targets that the board has taken.
    accepted: Accepted,
    greatest: BTreeMap<(u8, usize, &'static str), i64>,
    full: u64,
    /// The dice that choose frames with a wrong CRC, if the board checks CRCs.
    spoils: Option<Dice>,
    /// Whether it has begun to spoil frames.
    is_spoiling: bool,
    /// So many more successive frames are spoiled.
    spoiled_run: u64,
}

impl<'a> Writer<'a> {
    pub fn new(
        caller: InMemoryClient<'a>,
        eyes: Arc<Eyes>,
        units: &'a [Unit],
        size: SlotSize,
        cycle_us: u32,
        mut dice: Dice,
    ) -> Self {
        let left = if dice.one_in(5) { dice.below(300) } else { 200 + dice.below(MESSAGES) };
        let (life, full) = (Life::default(), eyes.full());
        let (accepted, greatest) = (Accepted::new(), BTreeMap::new());
        let (spoils, is_spoiling, spoiled_run) = (None, false, 0);
        Self {
            caller,
            eyes,
            units,
            size,
            cycle_us,
            dice,
            left,
            life,
            accepted,
            greatest,
            full,
            spoils,
            is_spoiling,
            spoiled_run,
        }
    }

    /// As a writer of a board that checks CRCs. Once it moves its axes, some of its frames have a wrong one.
    pub fn spoiling(self, dice: Dice) -> Self {
        Self { spoils: Some(dice), ..self }
    }

    /// Runs until it dies, or has nothing left to do.
    pub fn live(&mut self, set_up: &[Frame]) {
        let _: Result<(), Dead> = self.run(set_up);
    }

    pub fn dies(self) -> (InMemoryClient<'a>, Bounds, Life) {
        let jumps = self.life.jumps || self.life.has_homed;
        let bounds = Bounds { greatest: self.greatest, jumps, accepted: self.accepted };
        self.eyes.begin_to_compare();
        (self.caller, bounds, self.life)
    }

    fn run(&mut self, set_up: &[Frame]) -> Result<(), Dead> {
        for frame in set_up {
            self.write(frame)?;
        }
        // Some writers never read.
        let is_blind = self.dice.one_in(8);
        self.life.jumps |= is_blind;
        for _ in 0..1500 {
            if is_blind {
                self.say(ClientMessage::Pass(Duration::from_millis(300)))?;
                break;
            }
            if self.state() == Some(MasterState::Op) {
                break;
            }
            self.read()?;
        }
        let mut on = Frame::new();
        self.units.iter().for_each(|unit| on.put_slave(self.size, unit.slave, &SlaveCommand::ServoOn.into()));
        self.write(&on)?;
        // Some writers do not wait for it.
        let patience = if self.dice.one_in(6) { self.dice.below(10) } else { 600 };
        if is_blind {
            self.say(ClientMessage::Pass(Duration::from_millis(100)))?;
        }
        for _ in 0..if is_blind { 0 } else { patience } {
            if self.all_on() {
                break;
            }
            self.read()?;
        }
        self.life.jumps |= !self.all_on();
        if !is_blind && self.dice.one_in(3) {
            self.home()?;
        }
        if self.dice.one_in(2) {
            self.threshold()?;
        }
        self.drive(is_blind)
    }

    /// Sends a message; only half of it if it is the last one.
    fn say(&mut self, what: ClientMessage<'_>) -> Result<(), Dead> {
        if self.left == 0 {
            if self.dice.one_in(2) {
                self.life.torn = true;
                self.caller.say(what, self.dice.below(InMemoryClient::length(what) as u64) as usize);
            } else if self.dice.one_in(2) {
                // It waits for an answer, and the board waits for time.
                self.caller.begin(ClientMessage::Pass(Duration::from_millis(self.dice.below(500))), usize::MAX);
            }
            return Err(Dead);
        }
        self.left -= 1;
        assert!(self.caller.say(what, usize::MAX), "the server keeps it");
        drop(self.caller.take_sent());
        Ok(())
    }

    fn write(&mut self, frame: &Frame) -> Result<(), Dead> {
        let Some(spoils) = &mut self.spoils else { return self.write_as_it_is(frame) };
        let mut frame = frame.clone();
        if self.is_spoiling && spoils.one_in(100) {
            // The board would reset itself, and its state would be unknown.
            frame.put_master(self.size, &MasterCommand::SoftReset);
            return self.write_spoiled(frame);
        }
        if self.is_spoiling && self.spoiled_run == 0 && spoils.one_in(30) {
            self.spoiled_run = spoils.pick(&[1, 1, 1, 2, 200]);
        }
        if self.spoiled_run > 0 {
            self.spoiled_run -= 1;
            return self.write_spoiled(frame);
        }
        frame.fill_crc(self.size);
        self.write_as_it_is(&frame)
    }

    /// Writes a frame that the board refuses.
    fn write_spoiled(&mut self, mut frame: Frame) -> Result<(), Dead> {
        frame.fill_crc(self.size);
        frame.bytes_mut()[3] ^= 0x55;
        self.life.spoiled += 1;
        self.say(ClientMessage::Write(&frame))
    }

    fn write_as_it_is(&mut self, frame: &Frame) -> Result<(), Dead> {
        self.say(ClientMessage::Write(frame))?;
        let full = self.eyes.full();
        if std::mem::replace(&mut self.full, full) != full {
            self.life.lost += 1;
            return Ok(());
        }
        for unit in self.units {
            self.note(unit, frame);
        }
        Ok(())
    }

    /// The board has taken the frame.
    fn note(&mut self, unit: &Unit, frame: &Frame) {
        let slot = frame.slot(self.size, unit.slave);
        let (targets, mode) = match SlotCommand::decode(&slot, self.size).map(|slot| slot.command) {
            Ok(SlaveCommand::Csp(motion)) => ([motion.first.target, motion.second.target], "CSP"),
            Ok(SlaveCommand::Csv(motion)) => ([motion.first.target, motion.second.target], "CSV"),
            Ok(SlaveCommand::Cst(torque)) => ([torque.into(), 0], "CST"),
            _ => return,
        };
        let slave = unit.slave as u8;
        let accepted = self.accepted.entry(slave).or_default();
        let before = accepted.last().copied();
        accepted.push(targets);
        for axis in 0..unit.axes {
            let size = match (mode, before) {
                ("CSP", Some(before)) => i64::from(targets[axis].wrapping_sub(before[axis])).abs(),
                ("CSP", None) => 0,
                // Reports show a velocity that is not quite the commanded one.
                _ => i64::from(targets[axis]).abs() * 5 / 4 + 5000,
            };
            let greatest = self.greatest.entry((slave, axis, mode)).or_default();
            *greatest = size.max(*greatest);
        }
    }

    fn read(&mut self) -> Result<(), Dead> {
        self.say(ClientMessage::Read)
    }

    fn report(&self) -> Frame {
        self.eyes.report()
    }

    fn state(&self) -> Option<MasterState> {
        MasterResponse::decode(&self.report().slot(self.size, 0)).state.state()
    }

    fn all_on(&self) -> bool {
        let report = self.report();
        self.units.iter().all(|unit| unit.answer(&report, self.size).0.is_enabled())
    }

    fn master(&mut self, command: &MasterCommand) -> Result<(), Dead> {
        let mut frame = Frame::new();
        frame.put_master(self.size, command);
        self.write(&frame)
    }

    /// A threshold: any, often one that is never reached.
    fn threshold(&mut self) -> Result<(), Dead> {
        self.life.has_threshold = true;
        let free = match self.dice.below(4) {
            0 => 1,
            1 => 1 + self.dice.below(20),
            _ => 1 + self.dice.below(u64::from(FIFO_ENTRIES)),
        };
        self.master(&MasterCommand::SetFifo(FifoAction::Threshold(free as u32)))
    }

    /// Homes a drive, waits for a while, and may go on before it is home.
    fn home(&mut self) -> Result<(), Dead> {
        let Some(unit) = self.units.iter().find(|unit| unit.kind != SlaveKind::Hsp) else { return Ok(()) };
        let write = |index, value: u8| SdoCommand::Write {
            slave: unit.slave as u8,
            object: ObjectAddress::new(index, 0),
            size: SdoSize::One,
            value: value.into(),
        };
        self.life.has_homed = true;
        let method = self.dice.pick(&[17, 18, 19, 21, 24, 33, 35]);
        for sdo in [write(0x6060, 6), write(0x6098, method)] {
            let mut frame = Frame::new();
            frame.put(self.size, self.size.sdo_slot(), &sdo.encode());
            self.write(&frame)?;
            for _ in 0..40 {
                self.read()?;
            }
        }
        let mut frame = Frame::new();
        frame.put_slave(self.size, unit.slave, &SlaveCommand::GoHome.into());
        self.write(&frame)?;
        for _ in 0..self.dice.pick(&[0, 5, 50, 300]) {
            self.read()?;
            if self.dice.one_in(4) {
                self.write(&Frame::new())?;
            }
        }
        Ok(())
    }

    /// Moves its axes on paths that begin at their positions, in frames at its own pace.
    fn drive(&mut self, is_blind: bool) -> Result<(), Dead> {
        self.is_spoiling = self.spoils.is_some();
        for _ in 0..if is_blind { 0 } else { 40 } {
            self.read()?;
        }
        let report = self.report();
        let mut at: Vec<[i32; 2]> = self.units.iter().map(|unit| unit.answer(&report, self.size).1).collect();
        let mut speed = vec![[0_i32; 2]; self.units.len()];
        // Counts per frame in CSP.
        let a_frame = (i64::from(SPEED) * i64::from(self.cycle_us) / 1_000_000) as i32;
        let goal: Vec<[i32; 2]> = self
            .units
            .iter()
            .map(|unit| {
                let fastest = if unit.mode == Mode::Csp { a_frame } else { SPEED };
                [0, 1].map(|_| self.dice.below(2 * fastest as u64 + 1) as i32 - fastest)
            })
            .collect();
        let reads_every = if is_blind { u64::MAX } else { self.dice.pick(&[1, 1, 1, 2, 8, u64::MAX]) };
        let ahead = self.dice.pick(&[0, 5, 50, 100, 150]);
        for n in 0..3000_u64 {
            if self.dice.one_in(40) {
                // A frame without commands.
                self.write(&Frame::new())?;
            } else {
                let mut frame = Frame::new();
                for (i, unit) in self.units.iter().enumerate() {
                    for axis in 0..unit.axes {
                        let change = (goal[i][axis].abs() / 50).max(1);
                        speed[i][axis] += (goal[i][axis] - speed[i][axis]).clamp(-change, change);
                        at[i][axis] = at[i][axis].wrapping_add(speed[i][axis]);
                    }
                    frame.put_slave(self.size, unit.slave, &unit.motion(at[i], speed[i]).into());
                }
                self.write(&frame)?;
            }
            if n >= ahead && !is_blind && n.is_multiple_of(reads_every) {
                self.read()?;
            }
            match self.dice.below(400) {
                0 => {
                    self.life.jumps = true;
                    self.master(&MasterCommand::SetFifo(FifoAction::Clear))?;
                }
                1 | 2 => self.threshold()?,
                3 => {
                    let cycles = self.dice.below(200);
                    self.say(ClientMessage::Pass(Duration::from_micros(cycles * u64::from(self.cycle_us))))?;
                }
                4 if self.dice.one_in(10) => {
                    // This wait would never end: the server does a part of it, or nothing, and goes on.
                    self.say(ClientMessage::Pass(Duration::from_nanos(1 << 63)))?;
                }
                _ => {}
            }
        }
        Ok(())
    }
}
