//! A random program: it moves its axes on smooth paths from where they stand, and does everything else at random. And
//! random faults.

use std::ops::AddAssign;

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::AlState;
use ecmsk::sk::{
    DriveResponse, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, Motion, RawSlot,
    SdoCommand, SlaveCommand, StateByte,
};
use ecmsk::slave::{AlStatus, DeviceFault};

use crate::books::Books;
use crate::dice::Dice;
use crate::machine::{MARKER, Machine, SPEED};
use crate::watch::Watch;

/// What schedules did, so that none passes for lack of it.
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
    pub fastest: f64,
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
        self.fastest = self.fastest.max(other.fastest);
    }
}

impl Done {
    /// Schedules that do little prove little.
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
        assert!(self.full > 0 && self.cleared > 0 && self.fastest > 0.4, "{self:?}");
    }
}

/// Where a program has an axis.
#[derive(Clone, Copy, Default)]
enum Path {
    /// No targets are sent.
    #[default]
    Rest,
    /// Each frame carries the next target.
    Run { at: i32, speed: i32, goal: i32 },
}

/// The program, its machine, and what is watched.
pub struct Program {
    dice: Dice,
    machine: Machine,
    books: Books,
    watch: Watch,
    report: Frame,
    paths: Vec<Path>,
    /// Cycles for which the program sends nothing.
    pause: u64,
    /// Reports in a row with an empty FIFO.
    empty: u64,
    /// Cycles until the cable is whole again.
    cut: u64,
    done: Done,
}

impl Program {
    pub fn new(seed: u64, machine: Machine) -> Self {
        let (watch, paths) = (Watch::new(&machine), vec![Path::Rest; machine.axes.len()]);
        Self {
            dice: Dice(seed),
            machine,
            books: Books::default(),
            watch,
            report: Frame::new(),
            paths,
            pause: 0,
            empty: 0,
            cut: 0,
            done: Done::default(),
        }
    }

    /// Runs until so many cycles have passed, most of them in OP.
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
            if self.dice.one_in(200) {
                self.fault();
            }
            self.drive();
            self.cycle();
        }
    }

    pub fn done(self) -> Done {
        let counters = self.machine.board.engine().counters();
        Done {
            followed: self.books.followed,
            discarded: self.books.discarded,
            full: counters.full,
            cleared: counters.cleared,
            fastest: self.watch.fastest,
            ..self.done
        }
    }

    /// A cycle passes.
    fn cycle(&mut self) {
        let Self { machine, books, watch, report, .. } = self;
        let (before, then) = (*machine.board.engine().counters(), machine.board.now());
        let mut news = false;
        machine.board.cycle(&mut |frame, _| {
            report.clone_from(frame);
            news = true;
        });
        let report = news.then_some(&*report);
        let after = *machine.board.engine().counters();
        books.cycle(report, machine.size, &machine.axes, &before, &after);
        watch.cycle(machine, report, machine.board.now() - then);
        self.done.cycles += 1;
        self.done.in_op += u64::from(self.machine.in_op());
        self.done.enabled += (0..self.paths.len()).filter(|n| self.answer(*n).statusword.is_enabled()).count() as u64;
        let free = MasterResponse::decode(&self.report.slot(self.machine.size, 0)).fifo_free;
        self.empty = if news && free == FIFO_ENTRIES { self.empty + 1 } else { 0 };
        self.cut = self.cut.saturating_sub(1);
        if self.cut == 0 {
            self.machine.network.heal();
        }
    }

    fn answer(&self, n: usize) -> DriveResponse {
        DriveResponse::decode(&self.report.slot(self.machine.size, self.machine.axes[n].slave))
    }

    /// Sends the frames of a cycle.
    fn drive(&mut self) {
        if self.pause > 0 {
            self.pause -= 1;
            return;
        }
        for _ in 0..if self.dice.one_in(300) { 200 } else { self.dice.pick(&[1, 1, 1, 1, 0, 2]) } {
            if !self.machine.in_op() {
                return;
            }
            let mut frame = Frame::new();
            for n in 0..self.paths.len() {
                if let Some(command) = self.next_target(n) {
                    frame.put_slave(self.machine.size, self.machine.axes[n].slave, &command.into());
                }
            }
            self.send(frame);
        }
    }

    /// The next command of a path. It begins where the axis is, once nothing is in the FIFO any more that it might be
    /// ahead of, and ends when the axis is no longer on.
    fn next_target(&mut self, n: usize) -> Option<SlaveCommand> {
        let answer = self.answer(n);
        let on = answer.statusword.is_enabled();
        let cycles_per_second = 1_000_000 / self.machine.cycle.us() as i32;
        let step = SPEED / cycles_per_second;
        let fastest = if self.machine.axes[n].mode == Mode::Csp { step } else { SPEED };
        match &mut self.paths[n] {
            Path::Rest if on && self.empty > 3 => {
                self.paths[n] = Path::Run { at: answer.position, speed: 0, goal: 0 };
            }
            Path::Rest => {
                // These are discarded while the axis is off, and keep it where it is if it is on when their turn comes.
                let target = if self.machine.axes[n].mode == Mode::Csp { answer.position } else { 0 };
                return (!on && self.dice.one_in(3)).then(|| self.command(n, target));
            }
            Path::Run { .. } if !on => self.paths[n] = Path::Rest,
            Path::Run { at, speed, goal } => {
                if self.dice.one_in(100) {
                    *goal = self.dice.below(2 * fastest as u64 + 1) as i32 - fastest;
                }
                let change = (fastest / 50).max(1);
                *speed += (*goal - *speed).clamp(-change, change);
                *at = at.wrapping_add(*speed);
                let (at, speed) = (*at, *speed);
                return Some(self.command(n, if self.machine.axes[n].mode == Mode::Csp { at } else { speed }));
            }
        }
        None
    }

    fn command(&self, n: usize, value: i32) -> SlaveCommand {
        match self.machine.axes[n].mode {
            Mode::Csp => SlaveCommand::Csp(Motion::to(value)),
            Mode::Csv => SlaveCommand::Csv(Motion::to(value)),
            // Less than friction holds: how fast a torque makes an axis is the program's affair.
            Mode::Cst => SlaveCommand::Cst((value % 25) as i16),
            Mode::Homing => unreachable!("no DRIVE_MODE"),
        }
    }

    /// Something that programs do besides moving.
    fn something(&mut self) {
        let size = self.machine.size;
        let n = self.dice.below(self.paths.len() as u64) as usize;
        let slave = self.machine.axes[n].slave;
        match self.dice.below(24) {
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
                let mode = self.machine.axes[n].mode.code();
                let value = if self.dice.one_in(3) { self.dice.pick(&[8, 9, 10, 3]) } else { mode };
                // What runs in one mode is not what runs in another.
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
                // A command that has no business there.
                let id = self.dice.pick(&[0x13, 0x14, 0x06, 0x21, 0x77, 0xBF]);
                let mut frame = Frame::new();
                frame.put(size, slave, &RawSlot { id, data1: self.dice.next() as u32, ..RawSlot::ZERO });
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

    /// Something goes wrong.
    fn fault(&mut self) {
        let n = self.dice.below(self.paths.len() as u64) as usize;
        let slave = self.machine.axes[n].slave as u8;
        let network = &self.machine.network;
        match self.dice.below(8) {
            0..=2 => {
                self.done.faults += 1;
                let code = self.dice.pick(&[0x7500, 0x8611, 0x2310, 0x3210]);
                network.raise_fault(slave, 0, DeviceFault { code, resettable: !self.dice.one_in(10) });
            }
            4 => network.refuse(slave, self.dice.one_in(3).then_some((AlState::SafeOp, AlStatus::INVALID_OUTPUTS))),
            5 => network.delay_sdo(slave, if self.dice.one_in(2) { 50_000_000 } else { 0 }),
            6 => network.abort_sdo(slave, self.dice.one_in(2).then_some(AbortCode::VALUE_RANGE)),
            _ => network.refuse(slave, None),
        }
    }

    /// All paths end: what was sent of them may not be executed.
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
        let Self { machine, books, .. } = self;
        let size = machine.size;
        let op = machine.in_op();
        let boots = machine.board.engine().boots();
        if op {
            frame.put_slave(size, MARKER, &SlaveCommand::IoRead.with_index(books.next_mark()));
        }
        frame.fill_crc(size);
        let before = *machine.board.engine().counters();
        machine.board.host(&frame, machine.board.now(), &mut |_, _| unreachable!());
        let after = *machine.board.engine().counters();
        if machine.board.engine().boots() != boots {
            books.forget();
        } else if op && machine.board.engine().talks() {
            books.arrived(&frame, size, &before, &after);
            if after.full > before.full {
                // The next target would be two steps away.
                self.rest();
            }
        }
    }
}
