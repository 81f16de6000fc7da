//! A program's plan for one slave: a smooth path from the position of its axes, or homing.

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::engine::HomingPhase;
use ecmsk::sk::{Frame, SdoCommand, SlaveCommand};

use crate::machine::{Machine, SPEED, Unit};
use support::dice::Dice;

/// Successive reports without an accepted target after which a path restarts.
const MISSES: u32 = 100;

/// The program's plan for the axes of a slave.
#[derive(Clone, Copy, Default)]
pub enum Path {
    /// No targets are sent.
    #[default]
    Rest,
    /// Each frame carries the next targets.
    Run { at: [i32; 2], speed: [i32; 2], goal: [i32; 2], misses: u32 },
    /// The slave is being homed: the next step, and the cycles before it.
    Home { step: Step, wait: u64, method: i8 },
}

/// Steps of homing.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Step {
    Mode,
    Method,
    Go,
    /// Waits until homing has ended, or the program gives up.
    Wait,
    /// Firmware 1.7 writes the mode back; programs do it, too.
    Back,
}

/// A command that a path needs.
pub enum Wish {
    Nothing,
    /// In the frame of this cycle.
    Slave(SlaveCommand),
    /// In a frame of its own.
    Sdo(SdoCommand),
    Abort,
}

/// The program's knowledge when it makes a frame.
pub struct Now<'a> {
    pub machine: &'a Machine,
    pub report: &'a Frame,
    /// Whether no sent frame is still in the FIFO.
    pub empty: bool,
}

impl Path {
    /// The next command for a slave. A path begins at the axis's position once the FIFO has no older entry, goes on
    /// while its targets are accepted, and ends when the axis is not on any more.
    pub fn next(&mut self, unit: &Unit, now: &Now, dice: &mut Dice) -> Wish {
        let (statusword, positions) = unit.answer(now.report, now.machine.size);
        let on = statusword.is_enabled() && !now.machine.state().is_failed();
        let homing = now.machine.board.engine().homing_phase(unit.slave as u8) != HomingPhase::Idle;
        match *self {
            // The plan was given up: no command until homing has ended.
            Self::Rest | Self::Run { .. } if homing => self.rest(),
            Self::Rest if on && now.empty && unit.can_home() && dice.one_in(3) => {
                let method = dice.pick(&[35, 37, 35, 17, 18, 19, 21, 24, 28, 33, 1, 7, 15, -3]);
                *self = Self::Home { step: Step::Mode, wait: 0, method };
                Wish::Nothing
            }
            Self::Rest if on && now.empty => {
                *self = Self::Run { at: positions, speed: [0; 2], goal: [0; 2], misses: 0 };
                Wish::Nothing
            }
            Self::Rest if on || !now.empty || !dice.one_in(3) => Wish::Nothing,
            // These targets are executed while the axis is off: they are discarded.
            Self::Rest => Wish::Slave(unit.motion(positions, [0; 2])),
            Self::Run { .. } if !on => self.rest(),
            Self::Run { misses: MISSES.., .. } => self.rest(),
            Self::Run { .. } => Wish::Slave(self.run(unit, now, dice)),
            Self::Home { .. } if !on => self.rest(),
            Self::Home { ref mut wait, step, .. } if *wait > 0 => {
                *wait -= 1;
                // Programs do send targets meanwhile: they count as ignored, or are rejected in mode 6. A target that
                // is executed after homing would be an old position.
                if step == Step::Wait && now.empty && dice.one_in(4) {
                    Wish::Slave(unit.motion(positions, [0; 2]))
                } else {
                    Wish::Nothing
                }
            }
            Self::Home { step, method, .. } => self.home(step, method, unit, (statusword, now.machine.late), dice),
        }
    }

    fn rest(&mut self) -> Wish {
        *self = Self::Rest;
        Wish::Nothing
    }

    fn run(&mut self, unit: &Unit, now: &Now, dice: &mut Dice) -> SlaveCommand {
        let Self::Run { at, speed, goal, misses } = self else { unreachable!("called on a run") };
        let step = SPEED / (1_000_000 / now.machine.cycle.us() as i32);
        let fastest = if unit.mode == Mode::Csp { step } else { SPEED };
        let accepted = now.report.slot(now.machine.size, unit.slave).id == unit.motion(*at, *speed).id().code();
        *misses = if accepted { 0 } else { *misses + 1 };
        for axis in (0..unit.axes).filter(|_| accepted) {
            if dice.one_in(100) {
                goal[axis] = dice.below(2 * fastest as u64 + 1) as i32 - fastest;
            }
            let change = (fastest / 50).max(1);
            speed[axis] += (goal[axis] - speed[axis]).clamp(-change, change);
            at[axis] = at[axis].wrapping_add(speed[axis]);
        }
        unit.motion(*at, *speed)
    }

    fn home(
        &mut self,
        step: Step,
        method: i8,
        unit: &Unit,
        (statusword, late): (Statusword, u64),
        dice: &mut Dice,
    ) -> Wish {
        let next = |path: &mut Self, step, wait| *path = Self::Home { step, wait, method };
        let write = |index, value: u8| SdoCommand::Write {
            slave: unit.slave as u8,
            object: ObjectAddress::new(index, 0),
            size: SdoSize::One,
            value: value.into(),
        };
        match step {
            Step::Mode => {
                next(self, Step::Method, 10 + late);
                Wish::Sdo(write(0x6060, 6))
            }
            Step::Method => {
                next(self, Step::Go, 10 + late);
                Wish::Sdo(write(0x6098, method as u8))
            }
            Step::Go => {
                next(self, Step::Wait, 20 + late);
                Wish::Slave(SlaveCommand::GoHome)
            }
            Step::Wait => {
                let Statusword(word) = statusword;
                let attained = word & Statusword::TARGET_REACHED != 0 && word & Statusword::BIT12 != 0;
                let ended = attained || word & Statusword::BIT13 != 0;
                let no_patience = dice.one_in(800);
                if ended || no_patience {
                    next(self, Step::Back, dice.pick(&[0, 1, 5, 50]));
                }
                if no_patience { Wish::Abort } else { Wish::Nothing }
            }
            Step::Back => {
                *self = Self::Rest;
                Wish::Sdo(write(0x6060, unit.mode.code()))
            }
        }
    }
}

impl Unit {
    fn can_home(&self) -> bool {
        // A pulse module has no switches here.
        self.kind != ecmsk::sk::SlaveKind::Hsp
    }
}
