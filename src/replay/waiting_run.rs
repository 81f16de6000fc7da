//! The run of a model whose host waits for everything that the recorded program may have waited for.

use std::collections::VecDeque;

use super::ReplayStart;
use super::observed_board::{Agreement, ObservedBoard};
use super::start::CYCLE_NS;
use crate::compare::{RecordedRun, TimedFrame};
use crate::engine::Board;
use crate::link::Dir;
use crate::sk::{Frame, SlotSize};

/// Timeout for a state of the network, in nanoseconds of the board's time: with 40 slaves behind an ECM-XF the start to
/// OP takes up to 14 s. \[OURS]
const STATE_WAIT_NS: i64 = 30_000_000_000;
/// Timeout for everything but the state of the network, in nanoseconds of the board's time. \[OURS]
const OTHER_WAIT_NS: i64 = 2_000_000_000;
/// Limit for the sum of all waits, in nanoseconds of the board's time. It ends the replay of a recording that the model
/// cannot follow. \[OURS]
const TOTAL_WAIT_NS: i64 = 120_000_000_000;

/// The run of the model: the recorded command frames in their order, and the model's reports. A frame is sent at its
/// recorded time, or later, once the model shows everything that the recorded board had shown before the program sent
/// the frame.
///
/// A recording does not show what the program waited for. So the host waits for everything that a program may wait for
/// (`ObservedBoard`): the state of the network, the states of the drives, inputs, SDO answers, an axis at rest, room in
/// the FIFO. After a timeout it no longer waits for the thing in question. After the last frame it waits once more.
/// \[OURS]
///
/// The host receives each report of the model before it sends its next command. If the recorded host missed reports, it
/// receives only the newest one. A report has the time of its cycle; over a chip the host receives it some cycles
/// later.
pub struct WaitingRun {
    source: RecordedRun,
    board: Board,
    /// The model's time minus the time on the clock of the recording, ns.
    offset_ns: i64,
    tick_ns: i64,
    recorded: ObservedBoard,
    model: ObservedBoard,
    agreement: Agreement,
    /// The reports that the host has not received yet, with the times of their cycles.
    unread: Vec<(Frame, u64)>,
    reports: u64,
    /// `read_ns`: when the recorded host received its last report. `misses`: whether it had missed reports before that
    /// one.
    read_ns: Option<i64>,
    misses: bool,
    begun: bool,
    ended: bool,
    ready: VecDeque<TimedFrame>,
    waited_ns: i64,
}

impl WaitingRun {
    /// The run of the model `board`.
    pub(super) fn new(source: RecordedRun, board: Board, start: &ReplayStart, size: SlotSize) -> Self {
        Self {
            source,
            board,
            offset_ns: 0,
            tick_ns: start.tick_ns,
            recorded: ObservedBoard::new(size),
            model: ObservedBoard::new(size),
            agreement: Agreement::default(),
            unread: Vec::new(),
            reports: 0,
            read_ns: None,
            misses: false,
            begun: false,
            ended: false,
            ready: VecDeque::new(),
            waited_ns: 0,
        }
    }

    /// How much longer than the recorded program the host has waited so far, in nanoseconds of the board's time.
    pub const fn waited_ns(&self) -> i64 {
        self.waited_ns
    }

    /// Chooses the offset between the two clocks, at the first frame: the model's cycles end at the same times as those
    /// of the recorded board.
    fn begin(&mut self, first_ns: i64) {
        self.offset_ns = time(self.board.next_cycle()).saturating_sub(self.tick_ns);
        let behind = time(self.board.now()).saturating_sub(first_ns.saturating_add(self.offset_ns));
        if behind > 0 {
            let cycles = behind.saturating_add(CYCLE_NS - 1) / CYCLE_NS;
            self.offset_ns = self.offset_ns.saturating_add(cycles.saturating_mul(CYCLE_NS));
        }
    }

    fn play(&mut self, observed: TimedFrame) {
        if !std::mem::replace(&mut self.begun, true) {
            self.begin(observed.at_ns);
        }
        let at = observed.at_ns.saturating_add(self.offset_ns).max(0).unsigned_abs();
        let (unread, model) = (&mut self.unread, &mut self.model);
        self.board.advance(at, &mut |frame, made| {
            model.report(frame);
            unread.push((frame.clone(), made));
        });
        if observed.dir == Dir::Read {
            let since_ns =
                observed.at_ns.saturating_sub(self.read_ns.replace(observed.at_ns).unwrap_or(observed.at_ns));
            self.misses = since_ns > time(self.board.engine().period_ns()).saturating_mul(2);
            self.recorded.report(&observed.frame);
            self.receive();
            return;
        }
        self.wait();
        // The recorded program had received the reports made so far before it wrote this command. The model's host
        // receives them first, too, so that none of them is taken for an answer to the command.
        self.receive();
        let now = self.board.now();
        let (unread, model) = (&mut self.unread, &mut self.model);
        self.board.host(&observed.frame, now, &mut |frame, made| {
            model.report(frame);
            unread.push((frame.clone(), made));
        });
        self.recorded.command(&observed.frame);
        self.model.command(&observed.frame);
        let at_ns = self.recorded_time(now);
        self.ready.push_back(TimedFrame { at_ns, ..observed });
    }

    /// Waits until the model shows everything that the recorded board has shown.
    fn wait(&mut self) {
        let began = time(self.board.now());
        while self.waited_ns < TOTAL_WAIT_NS {
            let missing = self.agreement.missing(&self.recorded, &self.model);
            let Some(missing) = missing else { break };
            let waited = time(self.board.now()).saturating_sub(began);
            if waited > if missing.is_state() { STATE_WAIT_NS } else { OTHER_WAIT_NS } {
                self.agreement.give_up(missing);
                continue;
            }
            self.receive();
            let (unread, model) = (&mut self.unread, &mut self.model);
            self.board.cycle(&mut |frame, made| {
                model.report(frame);
                unread.push((frame.clone(), made));
            });
        }
        let waited = time(self.board.now()).saturating_sub(began);
        self.offset_ns = self.offset_ns.saturating_add(waited);
        self.waited_ns = self.waited_ns.saturating_add(waited);
    }

    /// Receives the reports of the model; if the recorded host missed reports, only the newest one.
    fn receive(&mut self) {
        if self.misses {
            self.unread.drain(..self.unread.len().saturating_sub(1));
        }
        for (frame, made) in std::mem::take(&mut self.unread) {
            self.reports += 1;
            let (number, at_ns) = (self.reports, self.recorded_time(made));
            self.ready.push_back(TimedFrame { number, at_ns, dir: Dir::Read, frame });
        }
    }

    /// Converts a time of the model to the clock of the recording. The time that the host has waited is included, so
    /// frames after a wait are later than in the recording.
    fn recorded_time(&self, ns: u64) -> i64 {
        time(ns).saturating_sub(self.offset_ns).saturating_add(self.waited_ns)
    }
}

fn time(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}

impl Iterator for WaitingRun {
    type Item = TimedFrame;

    fn next(&mut self) -> Option<TimedFrame> {
        while self.ready.is_empty() && !self.ended {
            match self.source.next() {
                Some(observed) => self.play(observed),
                None => {
                    self.ended = true;
                    self.wait();
                    self.receive();
                }
            }
        }
        self.ready.pop_front()
    }
}
