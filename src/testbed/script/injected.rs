//! Events that are injected while a simulated board runs, each in the syntax of a script line without its time. The
//! thread of the control socket puts an event into a [`Slot`]; the next cycle of the board carries it out
//! ([`InjectedScript`]).

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

/// The maximum number of injected events with `for` that are active at a time. Memory for their ends is reserved before
/// the first cycle, so that no cycle allocates. \[OURS]
const LASTING_MAX: usize = 64;

/// The properties of a simulated machine that determine which verbs it supports.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Abilities {
    /// Whether the slaves are reached by EtherCAT frames. The verb `noise`, which damages frames, needs them.
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
    /// A message with the mistake and what is allowed instead, in most cases also with the column.
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

/// The result of an injected event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// The event was carried out.
    Done {
        /// The number of the cycle; 0 is the first cycle after the link was opened.
        cycle: u64,
        /// The beginning of that cycle, ns of board time since the link was opened.
        at: Ns,
    },
    /// The event was not carried out, because [`LASTING_MAX`] events with `for` are active.
    TooMany,
}

/// Passes one event at a time from the thread of the control socket to the cycle. The state determines which of the two
/// may use the locks, so neither ever waits for a lock of the other.
#[derive(Debug, Default)]
pub(crate) struct Slot {
    state: AtomicU8,
    event: Mutex<Option<Injected>>,
    outcome: Mutex<Option<Outcome>>,
}

/// The states of a [`Slot`]: there is no event; an event waits for a cycle; a cycle carries the event out; the outcome
/// of the event can be read.
const IDLE: u8 = 0;
const ASKED: u8 = 1;
const TAKEN: u8 = 2;
const ANSWERED: u8 = 3;

impl Slot {
    /// The maximum number of active events with `for`, for error messages.
    pub(crate) const LASTING_MAX: usize = LASTING_MAX;

    /// Puts an event into the slot for the next cycle. The slot has to be free: new, or after [`Self::outcome`] or
    /// [`Self::take_back`].
    pub(crate) fn ask(&self, event: Injected) {
        *lock(&self.event) = Some(event);
        self.state.store(ASKED, Ordering::Release);
    }

    /// Takes the outcome of the event out of the slot, which is free afterwards. `None`: no cycle has handled the event
    /// yet.
    pub(crate) fn outcome(&self) -> Option<Outcome> {
        if self.state.load(Ordering::Acquire) != ANSWERED {
            return None;
        }
        let outcome = lock(&self.outcome).take();
        self.state.store(IDLE, Ordering::Release);
        outcome
    }

    /// Cancels the event if no cycle has taken it yet. Returns whether the event was cancelled.
    pub(crate) fn take_back(&self) -> bool {
        self.state.compare_exchange(ASKED, IDLE, Ordering::AcqRel, Ordering::Acquire).is_ok()
    }

    fn is_asked(&self) -> bool {
        self.state.load(Ordering::Acquire) == ASKED
    }

    /// Called by the cycle: passes a waiting event to `take`, and stores the outcome.
    fn answer(&self, take: impl FnOnce(Injected) -> Outcome) {
        if !self.is_asked() {
            return;
        }
        if self.state.compare_exchange(ASKED, TAKEN, Ordering::AcqRel, Ordering::Acquire).is_err() {
            return;
        }
        // Only the cycle uses these locks while the state is TAKEN, so the cycle never waits for them.
        let outcome = lock(&self.event).take().map(take);
        *lock(&self.outcome) = outcome;
        self.state.store(ANSWERED, Ordering::Release);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The script of a board with a control socket: the events of `script=`, if there is one, and the events that come
/// through a [`Slot`].
pub(crate) struct InjectedScript {
    script: Option<RunningScript>,
    slot: Arc<Slot>,
    network: Cable,
    board: BoardHandle,
    /// The board time at which the link was opened, ns.
    opened: Ns,
    /// The number of cycles that have begun since the link was opened.
    cycles: u64,
    /// The active events with `for`: for each one the board time of its end, ns, and the step that ends it. The vector
    /// never grows beyond its capacity.
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

    /// Only events that have already been injected count. So a board that stays silent reports this, although the
    /// control socket could still end the silence.
    fn is_over(&self) -> bool {
        self.script.as_ref().is_none_or(engine::Script::is_over) && self.lasting.is_empty() && !self.slot.is_asked()
    }
}
