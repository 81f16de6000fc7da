//! The start of a program in the manner of the vendor's samples, over any bus, in virtual time: SET_AXIS for five groups, SET_DC and
//! DRIVE_MODE, 2 ms apart and without a read, a rest, and SET_STATE.

use ecmsk::cia402::Mode;
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::{Fieldbus, Ns};
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, Frame, MasterCommand, MasterResponse, MasterState, SlaveCommand, SlaveKind,
    SlotSize, StateByte,
};
use ecmsk::slave::{Channels, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};

const SIZE: SlotSize = SlotSize::Bytes12;
/// The time between two frames of the burst.
const APART_NS: Ns = 2_000_000;
/// No boot takes longer.
const BOOT_NS: Ns = 60_000_000_000;
/// No start takes more cycles.
const PATIENCE: usize = 60_000;

/// What a program declares, and how long it rests before it asks for a state.
#[derive(Clone, Debug)]
pub struct Start {
    /// Slave n is `kinds[n - 1]`.
    pub kinds: Vec<SlaveKind>,
    pub mode: Mode,
    pub cycle: CycleTime,
    pub rest_ms: u64,
}

impl Start {
    /// Drives in CSP with a cycle of 1 ms.
    pub fn of_drives(drives: usize) -> Self {
        Self::of(vec![SlaveKind::Drive; drives])
    }

    /// Slaves of these kinds.
    pub fn of(kinds: Vec<SlaveKind>) -> Self {
        Self { kinds, mode: Mode::Csp, cycle: CycleTime::DEFAULT, rest_ms: 0 }
    }

    /// Forty slaves of all kinds, in turn: drives, steppers, IO modules, pulse modules of one and of two channels.
    pub fn of_forty_mixed() -> Self {
        use SlaveKind::{Drive, Hsp, Io, Step};
        Self::of([Drive, Step, Io, Hsp, Hsp].into_iter().cycle().take(40).collect())
    }

    /// The same, with these slaves declared as none.
    #[must_use]
    pub fn without(mut self, none: &[usize]) -> Self {
        none.iter().for_each(|slave| self.kinds[slave - 1] = SlaveKind::None);
        self
    }

    /// The same, with a rest before SET_STATE.
    #[must_use]
    pub fn resting(self, rest_ms: u64) -> Self {
        Self { rest_ms, ..self }
    }

    /// The slaves of the declared kinds; slaves declared as none are drives. Each second pulse module has two channels.
    pub fn slaves(&self) -> Vec<Box<dyn Slave>> {
        let mut modules = 0;
        let slave = |kind: &SlaveKind| -> Box<dyn Slave> {
            match kind {
                SlaveKind::Drive | SlaveKind::None => Box::new(Drive::new(DriveConfig::default())),
                SlaveKind::Step => Box::new(Drive::new(DriveConfig::stepper())),
                SlaveKind::Io => Box::<Io>::default(),
                SlaveKind::Hsp => {
                    modules += 1;
                    let channels = if modules % 2 == 0 { Channels::Two } else { Channels::One };
                    Box::new(Hsp::new(HspConfig::with(channels)))
                }
            }
        };
        self.kinds.iter().map(slave).collect()
    }
}

/// A program with its board, which has booted.
pub struct Program {
    pub board: Board,
    report: Frame,
    reports: u64,
}

impl Program {
    pub fn new(bus: impl Fieldbus + 'static) -> Self {
        let mut board = Board::new(EngineConfig::default(), Box::new(bus));
        assert!(board.boot(BOOT_NS), "the board does not talk");
        Self { board, report: Frame::new(), reports: 0 }
    }

    fn send(&mut self, build: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        build(&mut frame);
        let at = self.board.now();
        self.board.host(&frame, at, &mut |_, _| {});
    }

    /// Runs a cycle.
    pub fn cycle(&mut self) {
        let Self { board, report, reports } = self;
        board.cycle(&mut |frame, _| {
            report.clone_from(frame);
            *reports += 1;
        });
    }

    /// Lets that time pass.
    pub fn pass(&mut self, time_ns: Ns) {
        let until = self.board.now() + time_ns;
        while self.board.next_cycle() <= until {
            self.cycle();
        }
    }

    pub fn state(&self) -> StateByte {
        MasterResponse::decode(&self.report.slot(SIZE, 0)).state
    }

    /// Sends the burst, then rests.
    pub fn declare(&mut self, start: &Start) {
        for group in 0..5u8 {
            let kind = |k: usize| start.kinds.get(usize::from(group) * 8 + k).copied().unwrap_or(SlaveKind::None);
            let kinds = std::array::from_fn(kind);
            self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group, kinds }));
            self.pass(APART_NS);
        }
        let set_dc = MasterCommand::SetDc { cycle: start.cycle, shift: DcShift::Auto };
        self.send(|frame| frame.put_master(SIZE, &set_dc));
        self.pass(APART_NS);
        let drive_mode = SlaveCommand::DriveMode { mode: start.mode, sync: DriveSync::DcSync };
        self.send(|frame| {
            (1..=start.kinds.len()).for_each(|slave| frame.put_slave(SIZE, slave, &drive_mode.into()));
        });
        self.pass(APART_NS + start.rest_ms * 1_000_000);
    }

    /// Asks for a state; returns the time that it takes, and the number of reports until one shows it.
    ///
    /// # Panics
    /// If a state comes that is not on the way.
    pub fn go(&mut self, state: MasterState) -> Took {
        let (since, reports) = (self.board.now(), self.reports);
        self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(state)));
        for _ in 0..PATIENCE {
            self.cycle();
            assert!(!self.state().is_failed(), "{:?}", self.board.engine().state_failure());
            if self.state() == StateByte::reached(state) {
                return Took { ns: self.board.now() - since, reports: self.reports - reports };
            }
        }
        panic!("never {state}")
    }
}

/// The duration of a change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Took {
    pub ns: Ns,
    pub reports: u64,
}

impl Took {
    pub const fn ms(self) -> u64 {
        self.ns / 1_000_000
    }
}

/// How long a start takes over a bus, from SET_STATE to SafeOP, and from there to OP.
pub fn times(start: &Start, bus: impl Fieldbus + 'static) -> [Took; 2] {
    let mut program = Program::new(bus);
    program.declare(start);
    [MasterState::SafeOp, MasterState::Op].map(|state| program.go(state))
}
