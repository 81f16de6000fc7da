//! A random program: it moves its axes on smooth paths from their positions, and does everything else at random. With
//! random faults.

use std::ops::AddAssign;

use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::Counters;
use ecmsk::fieldbus::{AlState, Ns};
use ecmsk::sk::{
    FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SlaveCommand,
    SlotCommand, SlotSize, StateByte,
};
use ecmsk::slave::{AlStatus, DeviceFault, Fault, Input};

use crate::machine::{MARKER, Machine};
use crate::path::{Now, Path, Wish};
use support::dice::Dice;

/// Totals of the schedules, so that none passes without events.
#[derive(Debug, Default)]
pub struct Done {
    pub cycles: u64,
    pub in_op: u64,
    pub enabled: u64,
    pub followed: u64,
    pub discarded: u64,
    pub full: u64,
    pub cleared: u64,
    pub faults: u64,
    pub ignored: u64,
    pub lost: u64,
    pub homed: u64,
    pub fastest: f64,
    /// Over a bus that is late: axes that were switched on, reports that were compared with the cycle that they answer,
    /// cycles whose answers were lost.
    pub risen: u64,
    pub compared: u64,
    pub answers_lost: u64,
}

impl AddAssign for Done {
    fn add_assign(&mut self, other: Self) {
        self.cycles += other.cycles;
        self.in_op += other.in_op;
        self.enabled += other.enabled;
        self.followed += other.followed;
        self.discarded += other.discarded;
        self.full += other.full;
        self.cleared += other.cleared;
        self.faults += other.faults;
        self.ignored += other.ignored;
        self.lost += other.lost;
        self.homed += other.homed;
        self.fastest = self.fastest.max(other.fastest);
        self.risen += other.risen;
        self.compared += other.compared;
        self.answers_lost += other.answers_lost;
    }
}

impl Done {
    /// Asserts that the schedules had enough events.
    pub fn assert_enough(&self, schedules: u64) {
        let least = [
            ("cycles in OP", self.in_op, 500),
            ("cycles enabled", self.enabled, 300),
            ("targets followed", self.followed, 300),
            ("targets counted", self.discarded, 10),
            ("faults", self.faults, 1),
        ];
        for (what, n, each) in least {
            assert!(n >= each * schedules, "{what}: only {n} in {schedules} schedules");
        }
        let some = [self.full, self.cleared, self.ignored, self.lost, self.homed];
        assert!(some.iter().all(|n| *n > 0) && self.fastest > 0.4, "{self:?}");
    }
}

impl Done {
    /// The same over a bus that is late: programs wait longer there before they move.
    pub fn assert_enough_late(&self, schedules: u64) {
        let least = [
            ("cycles in OP", self.in_op, 1500),
            ("cycles enabled", self.enabled, 500),
            ("targets followed", self.followed, 150),
            ("targets counted", self.discarded, 30),
            ("faults", self.faults, 2),
            ("twice the axes switched on", 2 * self.risen, 1),
            ("reports compared", self.compared, 1000),
        ];
        for (what, n, each) in least {
            assert!(n >= each * schedules, "{what}: only {n} in {schedules} schedules");
        }
        let some = [self.full, self.cleared, self.ignored, self.lost, self.homed, self.answers_lost];
        assert!(some.iter().all(|n| *n > 0) && self.fastest > 0.4, "{self:?}");
    }
}

/// The checks of a schedule.
pub trait Checks {
    /// The marker's command in the next frame.
    fn next_mark(&mut self) -> SlotCommand;
    /// A frame has arrived in OP.
    fn arrived(&mut self, frame: &Frame, size: SlotSize, before: &Counters, after: &Counters);
    /// SW_RESET.
    fn forget(&mut self);
    /// The shafts of unit `n` were jammed, or freed.
    fn jam(&mut self, machine: &Machine, n: usize, jammed: bool);
    /// A cycle of the board has passed: the time since the previous one, its reports and the time of each.
    fn cycle(&mut self, machine: &Machine, reports: &[(Frame, Ns)], dt_ns: Ns, before: &Counters, after: &Counters);
    /// Adds what was seen to the totals.
    fn tell(&self, done: &mut Done);
    /// All is at rest.
    fn close(&self, machine: &Machine);
}

/// The program, its machine, and the checks.
pub struct Program<C> {
    dice: Dice,
    machine: Machine,
    checks: C,
    report: Frame,
    paths: Vec<Path>,
    /// Cycles for which the program sends nothing.
    pause: u64,
    /// Reports in a row with an empty FIFO.
    empty: u64,
    /// Cycles until cable and slaves are whole again.
    broken: u64,
    /// Cycles until another slave is lost, and which one.
    next_loss: Option<(u64, u8)>,
    /// Cycles until a jam and its consequences are over.
    jam: u64,
    done: Done,
}

impl<C: Checks> Program<C> {
    pub fn new(seed: u64, machine: Machine, checks: C) -> Self {
        let paths = vec![Path::Rest; machine.units.len()];
        Self {
            dice: Dice(seed),
            machine,
            checks,
            report: Frame::new(),
            paths,
            pause: 0,
            empty: 0,
            broken: 0,
            next_loss: None,
            jam: 0,
            done: Done::default(),
        }
    }

    /// Runs until that many cycles have passed, most of them in OP.
    pub fn run(&mut self, cycles: u64) {
        while self.done.cycles < cycles {
            let state = self.machine.state();
            if state.state() != Some(MasterState::Op) && self.dice.one_in(60) {
                for frame in self.machine.set_up() {
                    self.send(frame);
                }
            } else if state == StateByte::failed(Some(MasterState::Op)) && self.dice.one_in(100) {
                self.master(&MasterCommand::SetState(MasterState::Op));
            }
            if self.dice.one_in(25) {
                self.something();
            }
            if self.dice.one_in(250) {
                self.fault();
            }
            self.drive();
            self.cycle();
        }
    }

    /// Ends all faults, clears the FIFO, and lets that many cycles pass.
    pub fn come_to_rest(&mut self, cycles: u64) {
        (self.broken, self.next_loss, self.jam) = (0, None, self.jam.min(301));
        self.master(&MasterCommand::SetFifo(FifoAction::Clear));
        for _ in 0..cycles {
            self.cycle();
        }
        self.checks.close(&self.machine);
    }

    pub fn done(self) -> Done {
        let counters = self.machine.board.engine().counters();
        let mut done = Done {
            discarded: counters.discarded_before_enabled + counters.ignored_homing + counters.for_lost,
            full: counters.full,
            cleared: counters.cleared,
            ignored: counters.ignored_homing,
            lost: counters.for_lost,
            answers_lost: counters.answers_lost,
            ..self.done
        };
        self.checks.tell(&mut done);
        done
    }

    /// Runs a cycle.
    fn cycle(&mut self) {
        let Self { machine, checks, report, .. } = self;
        let (before, then) = (*machine.board.engine().counters(), machine.board.now());
        let mut reports = Vec::new();
        machine.board.cycle(&mut |frame, at| reports.push((frame.clone(), at)));
        if let Some((newest, _)) = reports.last() {
            report.clone_from(newest);
        }
        let after = *machine.board.engine().counters();
        checks.cycle(machine, &reports, machine.board.now() - then, &before, &after);
        self.done.cycles += 1;
        self.done.in_op += u64::from(self.machine.in_op());
        self.done.enabled += (0..self.paths.len()).filter(|n| self.is_on(*n)).count() as u64;
        for n in 0..self.paths.len() {
            // Also while the program sends nothing.
            if !self.is_on(n) {
                self.paths[n] = Path::Rest;
            }
        }
        let free = MasterResponse::decode(&self.report.slot(self.machine.size, 0)).fifo_free;
        self.empty = match reports.len() as u64 {
            0 if self.machine.late > 0 && self.machine.board.engine().fifo_free() == FIFO_ENTRIES => self.empty,
            0 => 0,
            news if free == FIFO_ENTRIES => self.empty + news,
            _ => 0,
        };
        self.repair();
    }

    fn is_on(&self, n: usize) -> bool {
        self.machine.units[n].answer(&self.report, self.machine.size).0.is_enabled()
    }

    /// Sends the frames of a cycle.
    fn drive(&mut self) {
        if self.pause > 0 {
            self.pause -= 1;
            return;
        }
        for n in 0..if self.dice.one_in(1500) { 200 } else { self.dice.pick(&[1, 1, 1, 1, 0, 2]) } {
            if !self.machine.in_op() {
                return;
            }
            let Self { machine, report, paths, dice, .. } = self;
            let (mut frame, mut extra, mut asks) = (Frame::new(), None, dice.one_in(10));
            let now = Now { machine, report, empty: self.empty > 3 && n == 0 };
            for (path, unit) in paths.iter_mut().zip(&machine.units) {
                let wish = path.next(unit, &now, dice);
                asks |= !matches!(wish, Wish::Nothing);
                match wish {
                    Wish::Nothing => {}
                    Wish::Slave(command) => frame.put_slave(machine.size, unit.slave, &command.into()),
                    Wish::Sdo(command) => extra = Some(command),
                    Wish::Abort => frame.put_slave(machine.size, unit.slave, &SlaveCommand::AbortHome.into()),
                }
            }
            if let Some(command) = extra {
                frame.put_sdo(machine.size, &command);
            }
            // A frame without commands would prevent the FIFO from running empty.
            if asks {
                self.send(frame);
            }
        }
    }

    /// Another random action of programs.
    fn something(&mut self) {
        let size = self.machine.size;
        let n = self.dice.below(self.paths.len() as u64) as usize;
        let slave = self.machine.units[n].slave;
        match self.dice.below(24) {
            // Not ahead of targets that are still in the FIFO: an axis that has stopped meanwhile would jump to them.
            0..=7 | 9..=12 if self.empty <= 3 => {}
            0..=7 => self.slave(slave, SlaveCommand::ServoOn),
            8 => self.slave(slave, SlaveCommand::ServoOff),
            9..=12 => self.slave(slave, SlaveCommand::AlarmClear),
            13 => {
                self.rest();
                self.master(&MasterCommand::SetFifo(FifoAction::Clear));
            }
            14 => {
                let threshold = self.dice.below(161) as u32;
                self.master(&MasterCommand::SetFifo(FifoAction::Threshold(threshold)));
            }
            15 if self.dice.one_in(5) => {
                use MasterState::*;
                let state = self.dice.pick(&[Init, PreOp, SafeOp, Op]);
                self.rest();
                self.master(&MasterCommand::SetState(state));
            }
            16 | 17 => {
                let object = self.dice.pick(&[(0x1018, 1), (0x6041, 0), (0x6060, 0), (0x1234, 0)]);
                let object = ObjectAddress::new(object.0, object.1);
                self.sdo(SdoCommand::Read { slave: slave as u8, object });
            }
            18 => {
                let mode = self.machine.units[n].mode.code();
                let value = if self.dice.one_in(3) { self.dice.pick(&[8, 9, 10, 3]) } else { mode };
                // A path in one mode does not continue in another.
                self.rest();
                self.sdo(SdoCommand::Write {
                    slave: slave as u8,
                    object: ObjectAddress::new(0x6060, 0),
                    size: SdoSize::One,
                    value: value.into(),
                });
            }
            19 | 20 => self.pause = self.dice.below(200),
            21 => {
                // A command that does not belong there.
                let id = self.dice.pick(&[0x13, 0x14, 0x06, 0x21, 0x77, 0xBF]);
                let mut frame = Frame::new();
                frame.put(size, slave, &RawSlot { id, data1: self.dice.roll() as u32, ..RawSlot::ZERO });
                self.send(frame);
            }
            22 if self.dice.one_in(20) => {
                self.rest();
                self.master(&MasterCommand::SoftReset);
                while !self.machine.board.engine().talks() {
                    self.cycle();
                }
            }
            _ => self.paths[n] = Path::Rest,
        }
    }

    /// Makes a random fault.
    fn fault(&mut self) {
        let n = self.dice.below(self.paths.len() as u64) as usize;
        let (slave, axes) = (self.machine.units[n].slave as u8, self.machine.units[n].axes);
        let units = self.paths.len() as u64;
        let network = &self.machine.network;
        match self.dice.below(14) {
            0..=3 => {
                self.done.faults += 1;
                let code = self.dice.pick(&[0x7500, 0x8611, 0x2310, 0x3210]);
                let fault = DeviceFault { code, resettable: !self.dice.one_in(10) };
                // The fault is of both axes of a module: a program sees only one statusword.
                (0..2).for_each(|axis| network.apply_fault(slave, Fault::Alarm { axis, fault }));
            }
            4 | 5 => {
                network.cut_after(self.dice.below(1 + units) as u8);
                self.broken = 1 + self.dice.below(100);
            }
            6 | 7 => {
                if self.dice.one_in(2) {
                    network.lose(slave);
                } else {
                    network.silence(slave, true);
                }
                self.broken = 1 + self.dice.below(100);
                // If losses are known late, two losses close together are distinguished by their times.
                if self.machine.late > 0 && self.dice.one_in(2) {
                    let other = self.machine.units[self.dice.below(units) as usize].slave as u8;
                    self.next_loss = Some((self.dice.below(30), other));
                    self.broken += 30;
                }
            }
            8 if self.jam == 0 => {
                (0..axes).for_each(|axis| network.apply_fault(slave, Fault::Jam { axis, jammed: true }));
                self.checks.jam(&self.machine, n, true);
                self.jam = 600;
            }
            9 => {
                let input = self.dice.pick(&[Input::NegativeLimit, Input::PositiveLimit, Input::Home, Input::Index]);
                network.apply_fault(
                    slave,
                    Fault::Stick {
                        axis: 0,
                        input: Some(input),
                        value: self.dice.pick(&[None, Some(false), Some(true)]),
                    },
                );
            }
            10 => network.refuse(slave, self.dice.one_in(3).then_some((AlState::SafeOp, AlStatus::INVALID_OUTPUTS))),
            11 => network.delay_sdo(slave, if self.dice.one_in(2) { 50_000_000 } else { 0 }),
            12 => network.abort_sdo(slave, self.dice.one_in(2).then_some(AbortCode::VALUE_RANGE)),
            _ => network.refuse(slave, None),
        }
    }

    /// Heals faults when their time is over.
    fn repair(&mut self) {
        let network = &self.machine.network;
        if let Some((wait, slave)) = &mut self.next_loss {
            if *wait == 0 {
                network.silence(*slave, true);
                self.next_loss = None;
            } else {
                *wait -= 1;
            }
        }
        self.broken = self.broken.saturating_sub(1);
        if self.broken == 0 {
            network.heal();
            for unit in &self.machine.units {
                network.find(unit.slave as u8);
                network.silence(unit.slave as u8, false);
            }
        }
        self.jam = self.jam.saturating_sub(1);
        if self.jam == 300 {
            for unit in &self.machine.units {
                (0..unit.axes)
                    .for_each(|axis| network.apply_fault(unit.slave as u8, Fault::Jam { axis, jammed: false }));
            }
        } else if self.jam == 0 {
            (0..self.paths.len()).for_each(|n| self.checks.jam(&self.machine, n, false));
        }
    }

    /// Ends all paths: their sent targets may not be executed.
    fn rest(&mut self) {
        self.paths.fill(Path::Rest);
    }

    fn master(&mut self, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(self.machine.size, command);
        self.send(frame);
    }

    fn slave(&mut self, slave: usize, command: SlaveCommand) {
        let mut frame = Frame::new();
        frame.put_slave(self.machine.size, slave, &command.into());
        self.send(frame);
    }

    fn sdo(&mut self, command: SdoCommand) {
        let mut frame = Frame::new();
        frame.put_sdo(self.machine.size, &command);
        self.send(frame);
    }

    /// Sends a frame, with its mark and its CRC. No time passes: a cycle's frames come between two cycles.
    fn send(&mut self, mut frame: Frame) {
        let Self { machine, checks, .. } = self;
        let size = machine.size;
        let op = machine.in_op();
        let boots = machine.board.engine().boots();
        if op {
            frame.put_slave(size, MARKER, &checks.next_mark());
        }
        frame.fill_crc(size);
        let before = *machine.board.engine().counters();
        machine.board.host(&frame, machine.board.now(), &mut |_, _| unreachable!());
        let after = *machine.board.engine().counters();
        if machine.board.engine().boots() != boots {
            checks.forget();
        } else if op && machine.board.engine().talks() {
            checks.arrived(&frame, size, &before, &after);
            if after.full > before.full {
                // The next target would be two steps away.
                self.rest();
            }
        }
    }
}
