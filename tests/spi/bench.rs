//! A pacer and a modelled board in virtual time, each with its own clock.

use std::collections::VecDeque;

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::spi::{ExchangeContent, Pacer, PacerOptions, PacerPlan, WaitingFrames};
use ecmsk::sk::{CommandId, CycleTime, Frame, MasterState};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use super::frames::{SIZE, all, all_on, axes, cycle, master, state, to};

type Ns = u64;

/// A frame of 504 bytes at 24 MHz, and the board's processing time.
const ON_THE_WIRES: Ns = 168_000;
const PROCESSING: Ns = 50_000;
/// The limit of any change of state.
const LIMIT: Ns = 60_000_000_000;

/// The report that an exchange answers with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answers {
    /// The newest report when the exchange begins.
    Newest,
    /// The newest report at the end of the previous exchange.
    Older,
}

#[derive(Clone, Copy, Debug)]
pub struct Setup {
    pub slaves: usize,
    pub cycle_us: u32,
    pub prefill: u16,
    /// Between the begins of two exchanges.
    pub period: Ns,
    pub answers: Answers,
    /// By how much the host's clock is faster, in ppm.
    pub host_is_faster: i64,
}

impl Default for Setup {
    fn default() -> Self {
        Self { slaves: 1, cycle_us: 1000, prefill: 0, period: 0, answers: Answers::Newest, host_is_faster: 0 }
    }
}

/// The board's executed command in a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Executed {
    pub id: u8,
    pub index: u8,
}

pub struct Bench {
    pub setup: Setup,
    pub pacer: Pacer,
    pub board: Board,
    /// Frames that the program has written and the link holds.
    pub held: VecDeque<Frame>,
    /// The newest report that the program was given.
    pub report: Frame,
    /// The free count that it was given.
    pub free: u16,
    /// Each cycle of OP, as reported by slave 1; all slaves report the same.
    pub executed: Vec<Executed>,
    /// When each exchange began, and its content.
    pub begins: Vec<(Ns, ExchangeContent)>,
    /// The highest level the FIFO had.
    pub highest: u16,
    pub now: Ns,
    zero: Ns,
    newest: Frame,
    staged: Frame,
}

impl Bench {
    pub fn new(setup: Setup) -> Self {
        let drives = (0..setup.slaves).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>);
        let mut board = Board::new(EngineConfig::default(), Box::new(SimBus::new(drives.collect())));
        assert!(board.boot(LIMIT));
        let mut newest = Frame::new();
        board.cycle(&mut |report, _| newest.clone_from(report));
        let pacer = Pacer::new(PacerOptions {
            slot: SIZE,
            cycle: CycleTime::DEFAULT,
            prefill: setup.prefill,
            period_ns: setup.period,
            wires_ns: ON_THE_WIRES,
        });
        Self {
            pacer,
            zero: board.now(),
            board,
            held: VecDeque::new(),
            report: newest.clone(),
            free: 160,
            executed: Vec::new(),
            begins: Vec::new(),
            highest: 0,
            now: 0,
            staged: newest.clone(),
            newest,
            setup,
        }
    }

    /// In OP, all axes on.
    pub fn on(setup: Setup) -> Self {
        let mut bench = Self::new(setup);
        bench.held.extend(axes().chain([cycle(setup.cycle_us), to(MasterState::Op)]));
        bench.until(|bench| state(&bench.report) == Some(MasterState::Op));
        bench.held.push_back(all(setup.slaves, CommandId::ServoOn, 0, 0));
        bench.until(|bench| all_on(&bench.report, setup.slaves) && bench.free == 160);
        bench.executed.clear();
        bench.begins.clear();
        bench.highest = 0;
        bench
    }

    #[track_caller]
    pub fn until(&mut self, mut done: impl FnMut(&Self) -> bool) {
        let end = self.now + LIMIT;
        while !done(self) {
            assert!(self.now < end, "it does not come: {:?}, free {}", master(&self.report), self.free);
            self.exchange(Ns::MAX);
        }
    }

    /// Makes the next exchange if it is due by then, otherwise advances the time; whether there was one.
    pub fn exchange(&mut self, by: Ns) -> bool {
        loop {
            let motion = self.held.front().is_some_and(|frame| frame.slot(SIZE, 1).id == CommandId::Csp.code());
            let held = WaitingFrames { frames: self.held.len(), motion, last: false };
            match self.pacer.plan(self.now, held) {
                PacerPlan::Wait(at) if at > by => {
                    self.now = by;
                    self.board_to_now();
                    return false;
                }
                PacerPlan::Wait(at) => {
                    assert!(at > self.now, "a wait that is over");
                    self.now = at;
                }
                PacerPlan::Exchange { content, extra } => {
                    self.carry_out(content, extra);
                    return true;
                }
            }
        }
    }

    fn carry_out(&mut self, content: ExchangeContent, extra: bool) {
        let mut frame = Frame::new();
        match content {
            ExchangeContent::Host => frame = self.held.pop_front().expect("the pacer knows what is held"),
            own => self.pacer.own_frame(own, &mut frame),
        }
        self.begins.push((self.now, content));
        self.pacer.begins(&frame, content, extra, self.now);
        self.board_to_now();
        let mut answer = if self.setup.answers == Answers::Newest { self.newest.clone() } else { self.staged.clone() };
        self.now += ON_THE_WIRES;
        self.board_to_now();
        let at = self.board.now();
        self.board.host(&frame, at, &mut |_, _| unreachable!("its cycles have run"));
        self.highest = self.highest.max(160 - self.board.engine().fifo_free());
        self.pacer.ended(self.now);
        self.now += PROCESSING;
        self.board_to_now();
        self.staged = self.newest.clone();
        let response = master(&answer);
        self.pacer.answered(&response, extra, self.held.len());
        self.pacer.to_report(&mut answer, self.held.len());
        self.free = if self.pacer.op() { master(&answer).fifo_free } else { 160 };
        self.report = answer;
    }

    fn board_to_now(&mut self) {
        let slower = i128::from(self.now) * 1_000_000 / i128::from(1_000_000 + self.setup.host_is_faster);
        let to = self.zero + slower as Ns;
        let (newest, executed, slaves) = (&mut self.newest, &mut self.executed, self.setup.slaves);
        self.board.advance(to, &mut |report, _| {
            newest.clone_from(report);
            if state(report) == Some(MasterState::Op) {
                let heads = || (1..=slaves).map(|slave| report.slot(SIZE, slave));
                let first = report.slot(SIZE, 1);
                assert!(heads().all(|slot| (slot.id, slot.index) == (first.id, first.index)), "slaves are of one mind");
                executed.push(Executed { id: first.id, index: first.index });
            }
        });
    }

    /// The indexes of the targets that were executed, in order, and the cycles between the first and the last that
    /// executed none, for want of an entry or because the entry held none.
    pub fn targets(&self) -> (Vec<u8>, usize) {
        let csp = CommandId::Csp.code();
        let mut indexes: Vec<u8> = Vec::new();
        let mut gaps = 0;
        let mut since = 0;
        for cycle in &self.executed {
            if cycle.id == csp && indexes.last() != Some(&cycle.index) {
                gaps += if indexes.is_empty() { 0 } else { since };
                since = 0;
                indexes.push(cycle.index);
            } else {
                since += 1;
            }
        }
        (indexes, gaps)
    }

    /// Every target from 0 to `count` was executed once and in order, and nothing was lost; the gaps between them.
    #[track_caller]
    pub fn check(&self, count: u32) -> usize {
        let (indexes, gaps) = self.targets();
        let expected: Vec<u8> = (0..count).map(super::frames::index).collect();
        let differs = indexes.iter().zip(&expected).position(|(found, expected)| found != expected);
        assert_eq!(
            differs,
            None,
            "{:?}: around {:?}",
            self.setup,
            differs.map(|at| &indexes[at.saturating_sub(3)..at + 1])
        );
        assert_eq!(indexes.len(), expected.len(), "{:?}", self.setup);
        let counters = self.board.engine().counters();
        assert_eq!((counters.full, counters.rejected_total(), counters.crc), (0, 0, 0), "{:?}", self.setup);
        gaps
    }
}
