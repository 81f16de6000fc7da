//! The board: the engine, the bus that it drives, and the board time reached so far. The runners (`Stepped` on a virtual
//! clock, `Threaded` on the real one) call it to let board time pass.

use super::partial_frames::{Assembler, INCOMPLETE_CYCLES};
use super::{BoardHandle, Engine, EngineConfig, Event, PartialFrames};
use crate::fieldbus::{CardsGone, Fieldbus, Ns, Strangers};
use crate::sk::Frame;

/// A script of actions on a board and its network at given times, for example faults.
pub trait Script: Send {
    /// Called when a cycle begins at `now`. Carries out every action that is due and passes an event for each of them to
    /// `done`, for the log. It is part of the cycle, so it must not allocate.
    fn run(&mut self, now: Ns, done: &mut dyn FnMut(Event));

    /// Whether all actions of the script are done.
    fn is_over(&self) -> bool;
}

/// An EC01M with its network. It is plain state, which changes only in calls of these methods.
pub struct Board {
    engine: Engine,
    bus: Box<dyn Fieldbus>,
    handle: BoardHandle,
    script: Option<Box<dyn Script>>,
    now: Ns,
    next_cycle: Ns,
    cycles: u64,
    last_report: Ns,
    silent_cycles: u64,
    /// When the newest cycle of the bus ran, board time. If it ran too long ago, frames no longer come back from the
    /// network.
    last_passed: Ns,
    partial: Assembler,
    /// How often the board had booted at the end of the last cycle, and whether its host interface answered then. If
    /// either has changed, an incomplete command frame is dropped.
    seen: (u64, bool),
}

impl Board {
    /// Creates a board that is switched on at time 0.
    pub fn new(config: EngineConfig, bus: Box<dyn Fieldbus>) -> Self {
        let engine = Engine::new(config, bus.pacing());
        let (next_cycle, seen) = (engine.period_ns(), (engine.boots(), engine.talks()));
        Self {
            engine,
            bus,
            handle: BoardHandle::default(),
            script: None,
            now: 0,
            next_cycle,
            cycles: 0,
            last_report: 0,
            silent_cycles: 0,
            last_passed: 0,
            partial: Assembler::new(),
            seen,
        }
    }

    /// The engine of the board, for reading its state.
    pub const fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The engine of the board, to change what no command changes, such as the local inputs.
    pub const fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// The handle by which scripts and tests reach the board while it runs, from any thread.
    pub fn handle(&self) -> BoardHandle {
        self.handle.clone()
    }

    /// Replaces the script. With `None` no script runs from now on.
    pub fn set_script(&mut self, script: Option<Box<dyn Script>>) {
        self.script = script;
    }

    /// The bus between the board and its slaves.
    pub(super) fn bus(&self) -> &dyn Fieldbus {
        &*self.bus
    }

    /// The BUSY pin between two exchanges: high from a boot until the first PreOP after it. An SPI host that ignores
    /// the pin reads zeros meanwhile (SK-4).
    pub const fn busy(&self) -> bool {
        !self.engine.talks()
    }

    /// The network cards that have disappeared ([`Fieldbus::cards_gone`]).
    pub fn cards_gone(&self) -> Option<CardsGone> {
        self.bus.cards_gone()
    }

    /// Frames received from the network that are no answers of slaves ([`Fieldbus::strangers`]).
    pub fn strangers(&self) -> Strangers {
        self.bus.strangers()
    }

    /// Whether frames come back from the network: the bus has run a cycle within `silence_tolerance_ns` plus one cycle
    /// time.
    pub(super) fn network_answers(&self) -> bool {
        self.now - self.last_passed < self.engine.silence_tolerance_ns() + self.engine.period_ns()
    }

    /// The board's time, nanoseconds since it was switched on.
    pub const fn now(&self) -> Ns {
        self.now
    }

    /// When the next cycle of the board is due, board time.
    pub const fn next_cycle(&self) -> Ns {
        self.next_cycle
    }

    /// The number of cycles since the board was switched on.
    pub const fn cycles(&self) -> u64 {
        self.cycles
    }

    /// If the board has stopped making reports, and no script is left that could change that: when it made the last
    /// report, and the number of cycles since. `None`: reports come, or may still come. The board makes no reports
    /// while the cable before the first slave is cut, or while reports are suppressed.
    pub fn silence(&self) -> Option<(Ns, u64)> {
        let over = self.script.as_ref().is_none_or(|script| script.is_over());
        let silent = over && self.silent_cycles > 0 && self.now - self.last_report > self.engine.silence_tolerance_ns();
        silent.then_some((self.last_report, self.silent_cycles))
    }

    /// Called when a complete command frame arrives at `at`. The cycles that are due by then run first.
    pub fn host(&mut self, frame: &Frame, at: Ns, report: &mut dyn FnMut(&Frame, Ns)) {
        self.advance(at, report);
        self.engine.host(frame, at);
    }

    /// Called when bytes of command frames arrive at `at`, in pieces of any length. The cycles that are due by then run
    /// first. A frame counts as arrived with its last byte; [`PartialFrames`] says what happens to incomplete frames.
    pub fn bytes(&mut self, bytes: &[u8], at: Ns, report: &mut dyn FnMut(&Frame, Ns)) {
        self.advance(at, report);
        self.drop_late(self.now);
        let size = self.engine.config().slot;
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = self.partial.take(rest, self.now, size);
            rest = &rest[taken..];
            if let Some(frame) = self.partial.complete(size) {
                self.engine.host(frame, self.now);
            }
        }
    }

    /// Drops a command frame that has been incomplete for too long. This is called in each cycle, because there may be no
    /// further bytes with which to notice it.
    fn drop_late(&mut self, now: Ns) {
        if self.engine.config().partial_frames == PartialFrames::Dropped
            && let Some(bytes) = self.partial.drop_late(now, INCOMPLETE_CYCLES * self.engine.period_ns())
        {
            self.engine.frame_incomplete(bytes, now);
        }
    }

    /// Drops an incomplete frame if the board has booted or the host interface has begun to answer since the last
    /// cycle: the next byte begins a new frame (SK-4, SK-5 \[OURS]).
    fn forget_partial(&mut self) {
        let (boots, talks) = (self.engine.boots(), self.engine.talks());
        if (boots, talks) != self.seen {
            self.seen = (boots, talks);
            if self.partial.forget() {
                self.engine.frame_cut_off();
            }
        }
    }

    /// Advances board time to `to` and runs every cycle that is due by then.
    pub fn advance(&mut self, to: Ns, report: &mut dyn FnMut(&Frame, Ns)) {
        while self.next_cycle <= to {
            self.cycle(report);
        }
        self.now = self.now.max(to);
    }

    /// Advances board time to the next cycle and runs it.
    pub fn cycle(&mut self, report: &mut dyn FnMut(&Frame, Ns)) {
        let at = self.next_cycle;
        let reports = self.engine.counters().reports;
        if let Some(script) = &mut self.script {
            script.run(at, &mut |event| self.engine.note(event));
        }
        self.handle.apply(&mut self.engine);
        if self.engine.cycle(at, &mut *self.bus, report) {
            self.last_passed = at;
        }
        self.forget_partial();
        self.drop_late(at);
        self.now = at;
        self.next_cycle = self.engine.next_cycle(at);
        self.cycles += 1;
        if self.engine.counters().reports > reports || !self.engine.talks() {
            self.last_report = at;
            self.silent_cycles = 0;
        } else {
            self.silent_cycles += 1;
        }
    }

    /// Lets the bus work until `until`, at most until the next cycle is due. `now` is the time of the runner's clock. If the
    /// runner is late, `now` is later than board time, which advances from cycle to cycle. A bus on virtual time does not need
    /// this call.
    pub fn work_until(&mut self, now: Ns, until: Ns) {
        self.bus.work_until(now, until);
    }

    /// The time between two cycles of the board at present, ns.
    pub const fn period_ns(&self) -> Ns {
        self.engine.period_ns()
    }

    /// Whether a late runner runs all missed cycles one after the other ([`Fieldbus::catches_up`]).
    pub fn catches_up(&self) -> bool {
        self.bus.catches_up()
    }

    /// Called when the runner was late and has skipped `cycles` cycles. Board time does not advance by them.
    pub fn leave_out(&mut self, cycles: u64) {
        self.bus.leave_out(cycles.saturating_mul(self.engine.period_ns()));
        self.engine.note_left_out(cycles);
    }

    /// Boots the board: advances time until the host interface answers, at most by `limit_ns`. Returns whether it
    /// answers.
    pub fn boot(&mut self, limit_ns: Ns) -> bool {
        let end = self.now + limit_ns;
        while !self.engine.talks() && self.next_cycle <= end {
            self.cycle(&mut |_, _| {});
        }
        self.engine.talks()
    }
}
