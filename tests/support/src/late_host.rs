//! Drives in CSP behind the model of an ECM-XF, led by a PC that stalls again and again, in virtual time. During a
//! stall nothing uses the wires, and the chip and its slaves go on. Then board and program catch up, as on the real
//! clock.
//!
//! The program sends each drive a new target with each report, and each target once. The targets that a drive got in
//! each cycle of the network show what a stall has cost.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ecmsk::engine::{Board, Counters, EngineConfig};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::sk::{
    CycleTime, DcShift, DriveResponse, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, Motion,
    SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::xf::host::HostConfig;

use crate::chip_line::xf_bus_with;
use crate::ears::{Ear, Way};

const SIZE: SlotSize = SlotSize::Bytes12;
/// Counts from a target to the next one.
const STEP: i32 = 20;
/// How far the program is ahead of the board in cycles of 1 ms: frames in its FIFO, by which a board would bridge a
/// stall.
const LEAD: u64 = 60;
/// The runner catches up in steps of that length, and takes frames after each step (`engine::Threaded`).
const PART_NS: Ns = 5_000_000;
/// After that many cycles without a stall no frame is in transit any more.
const SETTLED: u64 = 200;
const PATIENCE: u64 = 100_000;

/// The stalls of the PC.
#[derive(Clone, Copy, Debug)]
pub struct Stalls {
    /// Length of a stall, in cycles.
    pub cycles: u64,
    /// From the begin of a stall to that of the next, in cycles.
    pub every: u64,
}

/// The targets that the drives got while they moved, and the board's counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Targets that the program has sent to each drive.
    pub targets: u64,
    /// Targets that a drive missed, for the drive that missed most.
    pub lost: u64,
    /// Targets that a drive got after a newer one, for the drive with the most.
    pub out_of_order: u64,
    /// Cycles in which a drive got the target of the previous cycle again, for the drive with the most.
    pub repeated: u64,
    /// The same for the drive with the fewest.
    pub repeated_least: u64,
    /// Cycles without a new frame while they moved, as the board has counted them.
    pub idle_cycles: u64,
    /// Sets and answers that the board has counted as lost, and frames for which its FIFO was full.
    pub counted_lost: u64,
    /// The number of stalls.
    pub stalls: u64,
}

/// The sum of the counters of losses.
fn lost(counters: &Counters) -> u64 {
    counters.outputs_lost + counters.answers_lost + counters.full + counters.for_lost + counters.cleared
}

/// The board's count of idle cycles when the first target was executed, and before the last one was.
#[derive(Default)]
struct Idle {
    at_first: Option<u64>,
    at_last: u64,
}

impl Idle {
    fn look(&mut self, before: &Counters, now: &Counters, sent: i32) {
        let executed = now.executed - before.executed;
        if executed > 0 {
            self.at_first.get_or_insert(now.idle_cycles);
        }
        if executed < sent as u64 {
            self.at_last = now.idle_cycles;
        }
    }
}

/// The PC with its program and its board, and the drives.
pub struct LateHost {
    board: Board,
    clock: Arc<AtomicU64>,
    cycle_ns: Ns,
    /// Frames that the program keeps in the board and under way to it.
    lead: u64,
    /// Offset of the board's clock to the wires'.
    skew: Ns,
    ears: Vec<Ear>,
    report: Frame,
    reports: u64,
    /// Frames that have not arrived yet, and when they do.
    inbox: VecDeque<(Ns, Frame)>,
    sent: i32,
}

impl LateHost {
    /// So many drives in OP that are on, with a cycle of 1 ms, behind a chip that holds `ahead` sets of outputs for a
    /// stall.
    pub fn new(drives: usize, ahead: u16) -> Self {
        Self::with_cycle(drives, ahead, CycleTime::DEFAULT, LEAD)
    }

    /// The same with this cycle, and a program that is ahead by that many frames.
    pub fn with_cycle(drives: usize, ahead: u16, cycle: CycleTime, lead: u64) -> Self {
        let ears: Vec<Ear> = (0..drives).map(|_| Ear::default()).collect();
        let slaves = ears.iter().map(Ear::drive).collect();
        let options = XfBusOptions { ahead, real_time: true, ..XfBusOptions::DEFAULT };
        let bus = xf_bus_with(slaves, Default::default(), HostConfig::DEFAULT, options);
        let clock = bus.wires().clock.clone();
        let board = Board::new(EngineConfig::default(), Box::new(bus));
        let (report, inbox) = (Frame::new(), VecDeque::new());
        let cycle_ns = cycle.ns();
        let mut host = Self { board, clock, cycle_ns, lead, skew: 0, ears, report, reports: 0, inbox, sent: 0 };
        assert!(host.board.boot(60_000_000_000), "the board does not talk");
        host.skew = host.board.now() - host.clock.load(Ordering::Relaxed);
        host.switch_on(drives, cycle);
        host
    }

    fn switch_on(&mut self, drives: usize, cycle: CycleTime) {
        for group in 0..5 {
            let kind = |n| if usize::from(group) * 8 + n < drives { SlaveKind::Drive } else { SlaveKind::None };
            self.send(|frame| {
                frame.put_master(SIZE, &MasterCommand::SetAxis { group, kinds: std::array::from_fn(kind) })
            });
        }
        self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetDc { cycle, shift: DcShift::Auto }));
        self.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op)));
        let in_op = StateByte::reached(MasterState::Op);
        self.until("OP", |report| MasterResponse::decode(&report.slot(SIZE, 0)).state == in_op);
        let all = 1..=drives;
        self.send(|frame| all.clone().for_each(|slave| frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into())));
        let is_on = |report: &Frame, slave| DriveResponse::decode(&report.slot(SIZE, slave)).statusword.is_enabled();
        self.until("all on", |report| all.clone().all(|slave| is_on(report, slave)));
        self.cycles(SETTLED);
    }

    /// Sends the targets of that many cycles, with those stalls.
    pub fn lead(&mut self, cycles: u64, stalls: Stalls) -> Outcome {
        let (before, first) = (*self.board.engine().counters(), self.sent);
        self.ears.iter().for_each(|ear| ear.notes().targets.clear());
        let mut stood = 0;
        let mut idle = Idle::default();
        let end = self.now() + cycles * self.cycle_ns;
        let mut next_stall = self.now() + stalls.every * self.cycle_ns;
        while self.now() < end {
            self.fill_up();
            // The stalls begin at any time of a cycle.
            if stalls.cycles > 0 && self.now() >= next_stall {
                self.work_until(self.board.next_cycle() - (stood * 137_000) % self.cycle_ns);
                self.clock.fetch_add(stalls.cycles * self.cycle_ns, Ordering::Relaxed);
                next_stall += stalls.every * self.cycle_ns;
                stood += 1;
            }
            self.cycle();
            idle.look(&before, self.board.engine().counters(), self.sent - first);
        }
        for _ in 0..SETTLED {
            self.cycle();
            idle.look(&before, self.board.engine().counters(), self.sent - first);
        }
        let counted_lost = lost(self.board.engine().counters()) - lost(&before);
        let targets = (self.sent - first) as u64;
        let idle_cycles = idle.at_last - idle.at_first.unwrap_or_default();
        let repeated_least = u64::MAX;
        self.outcome(
            Outcome { targets, idle_cycles, counted_lost, stalls: stood, repeated_least, ..Outcome::default() },
            first,
        )
    }

    fn outcome(&self, base: Outcome, first: i32) -> Outcome {
        let mut outcome = base;
        let sent: Vec<i32> = (first..=self.sent).map(|n| n * STEP).collect();
        for ear in &self.ears {
            let way = Way::judge(&sent, &ear.notes().targets);
            assert_eq!(way.targets, base.targets);
            outcome.lost = outcome.lost.max(way.lost);
            outcome.out_of_order = outcome.out_of_order.max(way.out_of_order);
            outcome.repeated = outcome.repeated.max(way.repeated);
            outcome.repeated_least = outcome.repeated_least.min(way.repeated);
        }
        outcome
    }

    /// The time of the board if its runner is not late.
    fn now(&self) -> Ns {
        self.clock.load(Ordering::Relaxed) + self.skew
    }

    fn send(&mut self, build: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        build(&mut frame);
        frame.fill_crc(SIZE);
        self.inbox.push_back((self.now(), frame));
    }

    /// Sends targets until `lead` of them wait in the board and on the way to it.
    fn fill_up(&mut self) {
        let waiting = FIFO_ENTRIES - MasterResponse::decode(&self.report.slot(SIZE, 0)).fifo_free;
        (u64::from(waiting) + self.inbox.len() as u64..self.lead).for_each(|_| self.next_target());
    }

    fn next_target(&mut self) {
        self.sent += 1;
        let (drives, target) = (self.ears.len(), self.sent * STEP);
        self.send(|frame| {
            (1..=drives).for_each(|slave| frame.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(target)).into()));
        });
    }

    fn until(&mut self, what: &str, done: impl Fn(&Frame) -> bool) {
        for _ in 0..PATIENCE {
            if done(&self.report) {
                return;
            }
            self.cycle();
        }
        panic!("never: {what}");
    }

    fn cycles(&mut self, cycles: u64) {
        (0..cycles).for_each(|_| self.cycle());
    }

    fn work_until(&mut self, until: Ns) {
        self.board.work_until(self.now(), until);
        self.clock.fetch_max(until - self.skew, Ordering::Relaxed);
    }

    /// One wake-up of the runner: one cycle, or all cycles for which it is late.
    fn cycle(&mut self) {
        self.work_until(self.board.next_cycle());
        let now = self.now();
        let part = now.min(self.board.next_cycle() + PART_NS);
        let Self { board, report, reports, inbox, .. } = self;
        let mut keep = |frame: &Frame, _| {
            report.clone_from(frame);
            *reports += 1;
        };
        while inbox.front().is_some_and(|(at, _)| *at <= part) {
            let Some((at, frame)) = inbox.pop_front() else { break };
            board.host(&frame, at.max(board.now()), &mut keep);
        }
        board.advance(part, &mut keep);
    }
}
