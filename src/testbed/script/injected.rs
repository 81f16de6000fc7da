//! Events that come while a simulated board runs, each in the syntax of a script's line without its time. The thread of
//! the control socket puts an event into a [`Slot`]; the next cycle of the board carries it out ([`InjectedScript`]).

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::ScriptOrigin;
use super::run::{RunningScript, Step};
use super::verbs;
use super::words::Words;
use crate::address::slaves::SlaveSpec;
use crate::address::text::visible;
use crate::engine::{self, BoardHandle, Event};
use crate::fieldbus::Ns;
use crate::slave::cable::Cable;

/// How many injected events with `for` may be in force at a time. Their ends are kept in memory that is there before the
/// first cycle. \[OURS]
const LASTING_MAX: usize = 64;

/// What a simulated machine has, and so which verbs it carries out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Abilities {
    /// Its slaves are reached by EtherCAT frames, which `noise` damages.
    pub(crate) has_frames: bool,
}

/// An event that was parsed and checked against the slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Injected {
    begin: Step,
    /// The end of an event with `for`; its `at` is the duration.
    end: Option<Step>,
}

impl Injected {
    /// Parses an event such as `alarm 2 0x7500`, `cut 2 for 1s` or `end cut` for a network of these slaves.
    ///
    /// # Errors
    /// What is wrong, with the column, and what is allowed.
    pub(crate) fn parse(text: &str, slaves: &[SlaveSpec], abilities: Abilities) -> Result<Self, String> {
        let wrong = |(column, message): (usize, String)| format!("column {column}: {}", visible(&message));
        if let Some(word) = Words::of(text).peek().filter(|word| matches!(word.text, "at" | "from")) {
            let message =
                format!("`{}` is of scripts; an injected event happens in the next cycle, leave it out", word.text);
            return Err(wrong((word.column, message)));
        }
        let (mut steps, mut origin) = (Vec::new(), ScriptOrigin::Start);
        verbs::parse_line(0, text, slaves, &mut origin, &mut steps).map_err(wrong)?;
        let mut steps = steps.into_iter();
        let Some(begin) = steps.next() else {
            return Err(wrong((1, format!("VERB is missing; allowed: {}", verbs::names(false).join(", ")))));
        };
        if begin.action.is_of_frames() && !abilities.has_frames {
            return Err(format!(
                "`{}` happens to frames, and this board reaches its simulated slaves without any",
                begin.verb
            ));
        }
        Ok(Self { begin, end: steps.next() })
    }
}

/// What has become of an injected event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It was carried out.
    Done {
        /// The number of the cycle, from 0, the first one after the opening of the link.
        cycle: u64,
        /// The beginning of that cycle, ns of board time after the opening of the link.
        at: Ns,
    },
    /// It was not carried out: [`LASTING_MAX`] events with `for` are in force.
    TooMany,
}

/// Hands one event at a time from a thread to the cycle. Its state says whose turn it is, so that neither ever waits for the
/// other's lock: the cycle takes the next event in its next cycle, whatever the thread does.
#[derive(Debug, Default)]
pub(crate) struct Slot {
    state: AtomicU8,
    event: Mutex<Option<Injected>>,
    outcome: Mutex<Option<Outcome>>,
}

/// States of a [`Slot`]: nothing is asked; an event waits for a cycle; a cycle carries it out; its outcome can be read.
const IDLE: u8 = 0;
const ASKED: u8 = 1;
const TAKEN: u8 = 2;
const ANSWERED: u8 = 3;

impl Slot {
    /// The most events with `for` that may be in force, for messages.
    pub(crate) const LASTING_MAX: usize = LASTING_MAX;

    /// Puts an event in for the next cycle. The slot has to be free: new, or after [`Self::outcome`] or [`Self::take_back`].
    pub(crate) fn ask(&self, event: Injected) {
        *lock(&self.event) = Some(event);
        self.state.store(ASKED, Ordering::Release);
    }

    /// What has become of the event; `None`: no cycle has begun yet. The slot is free afterwards.
    pub(crate) fn outcome(&self) -> Option<Outcome> {
        if self.state.load(Ordering::Acquire) != ANSWERED {
            return None;
        }
        let outcome = lock(&self.outcome).take();
        self.state.store(IDLE, Ordering::Release);
        outcome
    }

    /// Takes the event back if no cycle has taken it; returns whether that is so.
    pub(crate) fn take_back(&self) -> bool {
        self.state.compare_exchange(ASKED, IDLE, Ordering::AcqRel, Ordering::Acquire).is_ok()
    }

    fn is_asked(&self) -> bool {
        self.state.load(Ordering::Acquire) == ASKED
    }

    /// Called by the cycle: gives a waiting event to `take`, and keeps the outcome.
    fn answer(&self, take: impl FnOnce(Injected) -> Outcome) {
        if !self.is_asked() {
            return;
        }
        if self.state.compare_exchange(ASKED, TAKEN, Ordering::AcqRel, Ordering::Acquire).is_err() {
            return;
        }
        // Only the cycle uses these locks while the state is TAKEN, so that it never waits for one.
        let outcome = lock(&self.event).take().map(take);
        *lock(&self.outcome) = outcome;
        self.state.store(ANSWERED, Ordering::Release);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The script of a board with a control socket: the events of `script=`, if there is one, and those that come by a [`Slot`].
pub(crate) struct InjectedScript {
    script: Option<RunningScript>,
    slot: Arc<Slot>,
    network: Cable,
    board: BoardHandle,
    /// The opening of the link, board time.
    opened: Ns,
    /// The cycles that have begun since then.
    cycles: u64,
    /// Events in force that end by themselves, with the board time of their ends. Never grows beyond its capacity.
    lasting: Vec<(Ns, Step)>,
}

impl InjectedScript {
    /// `opened` is the board's time at which the link was opened.
    pub(crate) fn new(
        script: Option<RunningScript>,
        slot: Arc<Slot>,
        (network, board): (Cable, BoardHandle),
        opened: Ns,
    ) -> Self {
        Self { script, slot, network, board, opened, cycles: 0, lasting: Vec::with_capacity(LASTING_MAX) }
    }
}

impl engine::Script for InjectedScript {
    fn run(&mut self, now: Ns, done: &mut dyn FnMut(Event)) {
        if let Some(script) = &mut self.script {
            script.run(now, done);
        }
        let on = (&self.network, &self.board);
        let lasting = &mut self.lasting;
        lasting.retain(|(until, end)| {
            let is_over = *until <= now;
            if is_over {
                end.carry_out(None, on, now, done);
            }
            !is_over
        });
        let (cycle, at) = (self.cycles, now.saturating_sub(self.opened));
        self.cycles += 1;
        self.slot.answer(|Injected { begin, end }| {
            if end.is_some() && lasting.len() == LASTING_MAX {
                return Outcome::TooMany;
            }
            begin.carry_out(None, on, now, done);
            lasting.extend(end.map(|end| (now.saturating_add(end.at), end)));
            Outcome::Done { cycle, at }
        });
    }

    /// An event that nobody has asked for yet does not count: a board that is silent for good says so.
    fn is_over(&self) -> bool {
        self.script.as_ref().is_none_or(engine::Script::is_over) && self.lasting.is_empty() && !self.slot.is_asked()
    }
}
