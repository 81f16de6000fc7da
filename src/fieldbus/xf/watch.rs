//! Lost slaves, and resets of the chip.
//!
//! An error counter, which stops at 255, and an interrupt flag of the chip show that the working counter of some cycle
//! was wrong. They do not show which slave was the cause. The bus then reads the AL states of all slaves. It also reads
//! them at intervals, since below SafeOP no cycle shows that a slave is gone. A slave stays lost until a change of
//! state brings it back.
//!
//! **Inputs of a cycle with a wrong working counter** are not used \[OURS], as far as possible: an answer header only
//! has the number of errors, but neither the cycles nor the slaves. So after new errors the inputs of the next
//! [`DOUBT_CYCLES`] cycles that are read are not used, and all slaves keep their previous inputs. The inputs of cycles
//! that were read before that header were used already. If the errors continue, although the AL states show that no
//! slave is lost, the inputs of all slaves become stale and all slaves count as lost
//! ([`STALE_AFTER`](crate::fieldbus::STALE_AFTER)). While a slave is lost every cycle has a wrong working counter, so
//! the errors show nothing about the other slaves.

use super::ask::{Ask, Asked};
use super::chip_bus::ChipBus;
use super::clear::SETTLED;
use super::jobs::state_of;
use super::local_io::PinSetup;
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::is_stale;
use crate::xf::Interrupts;
use crate::xf::host::{HostError, HostState, Wires};

/// The interval at which the states of the slaves are read if nothing requires it earlier, ns. \[OURS]
const INTERVAL_NS: Ns = 100_000_000;

/// The number of next cycles whose inputs are not used after an answer header has counted a new working counter error.
/// Any of these cycles may have had the error: the header may be two exchanges old, and between two exchanges there may
/// be no cycle. \[OURS]
const DOUBT_CYCLES: u32 = 4;

/// The present step in reading the states of all slaves.
#[derive(Clone, Copy, Debug, Default)]
enum Step {
    /// The chip executes STATE_UPDATE: it reads the states of all slaves.
    #[default]
    Renew,
    /// The chip returns the lowest state of all slaves: if it is OP, no slave is lost.
    All,
    One(u8),
}

/// The progress of the repeated reading of all slaves' AL states, and the working counter errors that make the next
/// reading begin early.
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    asked: Option<Asked>,
    step: Step,
    next_at: Ns,
    wkc_errors: u8,
    is_suspicious: bool,
    /// The id of the first outputs that may have missed a slave that is not lost; `None`: the working counter was right
    /// since the newest complete reading of the states began.
    suspect_from: Option<u64>,
    /// Whether the working counter was wrong, or may have been, since the newest reading began.
    has_new_errors: bool,
    /// The number of cycles with a wrong working counter while no slave was lost: `wrong_before` before the newest
    /// reading of the states began, `wrong_cycles` since then.
    wrong_before: u64,
    wrong_cycles: u64,
    /// The id of the first outputs that were not sent yet: `unsent` when the newest answer header came, `unsent_before`
    /// when the newest reading of the states began.
    unsent: Option<u64>,
    unsent_before: Option<u64>,
    chip_resets: u64,
    /// The inputs of this many of the next cycles are not used.
    doubt_cycles: u32,
    /// Times on the clock of the wires to the chip. `read_at`: when the newest reading began that has found no slave
    /// lost. `reading_since`: when the newest reading began.
    read_at: Option<Ns>,
    reading_since: Option<Ns>,
    /// `held_cycles`: the number of consecutive cycles whose inputs were not used. `held_since`: when the first of them
    /// ran, on the clock of the wires to the chip.
    held_cycles: u32,
    held_since: Ns,
}

/// The progress of bringing all slaves to PreOP after the chip has not answered for a while. The slaves may still be in
/// OP then, because the chip runs its cycles without the host.
#[derive(Clone, Copy, Debug)]
pub(super) enum TakingDown {
    No,
    /// The slaves have to leave OP: PreOP is requested as soon as the driver runs.
    Due,
    Asked(Asked),
}

impl<W: Wires> ChipBus<W> {
    /// Brings all slaves to PreOP, before anything else, after the chip has not answered for a while: it may still repeat
    /// its newest outputs, while nothing controls the axes. Returns whether this is under way.
    pub(super) fn take_down(&mut self, now: Ns) -> bool {
        self.taking_down = match self.taking_down {
            TakingDown::No => return false,
            TakingDown::Due if self.host.state() == HostState::Running => {
                let asked = Ask::Enter(None, AlState::PreOp).submit(&mut self.host, now);
                asked.map_or(TakingDown::Due, TakingDown::Asked)
            }
            TakingDown::Due => TakingDown::Due,
            TakingDown::Asked(asked) => match asked.reply(&mut self.host) {
                None => TakingDown::Asked(asked),
                // If the chip refuses the command, it has no initialised network, so no slave is in OP and nothing is
                // left to do. If the chip has not answered, the command is repeated.
                Some(Ok(_) | Err(HostError::Refused { .. } | HostError::Failed { .. })) => TakingDown::No,
                Some(Err(_)) => TakingDown::Due,
            },
        };
        !matches!(self.taking_down, TakingDown::No)
    }

    /// Evaluates the newest answer header, if it was not evaluated yet: the fill levels, and the errors of the working
    /// counter. Also notices a reset of the chip.
    pub(super) fn look_at_header(&mut self) {
        let counters = self.host.counters();
        if counters.chip_resets != self.watch.chip_resets {
            self.watch.chip_resets = counters.chip_resets;
            self.counters.chip_resets += 1;
            self.lose_all();
        }
        if counters.answers == self.headers {
            return;
        }
        self.headers = counters.answers;
        let Some(header) = self.host.header() else { return };
        if self.flying.is_empty() && counters.answers >= self.reported_at + SETTLED {
            self.ledger.caught_up();
        }
        self.ledger.header(header.rx_fifo, header.tx_fifo);
        let cycle_ns = self.network.cycle.ns();
        self.level.header(self.wires.now(), header.rx_fifo, self.ledger.unseen(), cycle_ns);
        let (errors, is_flagged) = (header.wkc_errors, header.interrupts.contains(Interrupts::WORKING_COUNTER));
        let unsent = Some(self.ledger.next_id());
        // The error counter stops at 255. From then on only the interrupt flag shows new errors. While a slave is lost,
        // the flag shows nothing either, because every cycle has a wrong working counter.
        let says_nothing = errors == u8::MAX && !self.network.lost.is_empty();
        let is_full = errors == u8::MAX && !says_nothing;
        if is_flagged {
            self.host.clear_interrupts(Interrupts::WORKING_COUNTER, 0);
        }
        let watch = &mut self.watch;
        let is_wrong = errors != watch.wkc_errors || is_full && is_flagged;
        if is_wrong && self.runs && self.job.is_none() && self.network.lost.is_empty() {
            watch.doubt_cycles = DOUBT_CYCLES;
            watch.wrong_cycles += u64::from(errors.saturating_sub(watch.wkc_errors).max(1));
        }
        watch.wkc_errors = errors;
        watch.is_suspicious |= is_wrong;
        if is_wrong || says_nothing {
            watch.suspect_from = watch.suspect_from.or(watch.unsent);
            watch.has_new_errors = true;
        }
        watch.unsent = unsent;
    }

    /// Called when a reading of the states of all slaves begins.
    pub(super) fn begin_reading(&mut self) {
        self.watch.wrong_before = std::mem::take(&mut self.watch.wrong_cycles);
        self.watch.has_new_errors = false;
        self.watch.unsent_before = self.watch.unsent;
        self.watch.reading_since = Some(self.wires.now());
    }

    /// Called when all AL states have been read. A slave that is not lost was in its state all the time, and has
    /// received the outputs that were sent before the reading began. Cycles with a wrong working counter are the
    /// exception: some slave that is still there has missed them, and the chip does not report which one. If no slave
    /// is lost, the outputs of these cycles count as lost.
    pub(super) fn end_reading(&mut self) {
        let missed = std::mem::take(&mut self.watch.wrong_before);
        if self.network.lost.is_empty() && self.job.is_none() {
            self.lose_sets(missed);
            self.watch.read_at = self.watch.reading_since;
        }
        self.watch.suspect_from = self.watch.unsent_before.filter(|_| self.watch.has_new_errors);
    }

    /// Whether the inputs of the cycle that was just read are in doubt. Must be called once for each cycle that was
    /// read, because each call decrements [`Watch::doubt_cycles`].
    pub(super) fn takes_in_doubt(&mut self) -> bool {
        let is_doubtful = self.watch.doubt_cycles > 0 && self.network.lost.is_empty();
        self.watch.doubt_cycles = self.watch.doubt_cycles.saturating_sub(1);
        is_doubtful
    }

    /// Evaluates a cycle that ran at the time `at`: counts consecutive cycles whose inputs were not used (`is_held`),
    /// and marks the inputs as stale if there are too many.
    pub(super) fn judge_inputs(&mut self, at: Ns, is_held: bool) {
        if !is_held {
            self.watch.held_cycles = 0;
            return;
        }
        if self.watch.held_cycles == 0 {
            self.watch.held_since = at;
        }
        let Watch { held_cycles, held_since, read_at, .. } = &mut self.watch;
        *held_cycles = held_cycles.saturating_add(1);
        if *read_at > Some(*held_since) && is_stale(*held_cycles, self.network.cycle.ns(), true) {
            self.lose_stale();
        }
    }

    /// The slaves that send inputs and are not lost: they were brought to SafeOP or OP, and have inputs in the chip's
    /// layout.
    pub(super) fn with_inputs(&self) -> SlaveSet {
        let has_inputs = |slave: &u8| self.network.places[usize::from(*slave) - 1].input_bytes > 0;
        self.network.at_least(AlState::SafeOp).difference(self.network.lost).iter().filter(has_inputs).collect()
    }

    /// Marks all slaves with inputs as lost, after the working counter was wrong for too long: it is not known which
    /// slaves still send inputs.
    fn lose_stale(&mut self) {
        let from = self.watch.suspect_from.or(self.watch.unsent);
        let stale = self.with_inputs();
        for slave in stale.iter() {
            self.network.lost_from[usize::from(slave) - 1] = from;
        }
        self.network.lost = self.network.lost.union(stale);
        self.network.stale = self.network.stale.union(stale);
        self.hold_lost(self.network.lost);
    }

    /// Continues reading the states of the slaves, or begins it when it is due.
    pub(super) fn watch_on(&mut self, now: Ns) {
        if let Some(asked) = self.watch.asked {
            let Some(reply) = asked.reply(&mut self.host) else { return };
            self.watch.asked = None;
            // If the chip has answered that it could not read a slave, this slave is silent, and the reading goes on.
            // If the chip itself does not answer, nothing is known of the slaves, and the reading ends.
            let unreadable = matches!(reply, Err(HostError::Refused { .. } | HostError::Failed { .. }));
            let next = match self.watch.step {
                // A running job reads the states of the slaves itself, so the reading ends then, too.
                _ if self.job.is_some() || reply.is_err() && !unreadable => None,
                Step::Renew if unreadable => Some(Step::One(1)),
                Step::Renew => Some(Step::All),
                Step::All if self.are_all_in_op(state_of(reply)) => {
                    self.end_reading();
                    None
                }
                Step::All => Some(Step::One(1)),
                Step::One(slave) => {
                    self.note_state(slave, state_of(reply));
                    if slave == self.network.found {
                        self.end_reading();
                    }
                    (slave < self.network.found).then_some(Step::One(slave + 1))
                }
            };
            if let Some(step) = next {
                self.watch_step(step, now);
            }
            return;
        }
        let is_due = self.watch.is_suspicious || now >= self.watch.next_at;
        let is_free = self.job.is_none() && self.sdo.is_none() && self.host.state() == HostState::Running;
        if is_due && is_free && self.network.initialised {
            self.watch.next_at = now.saturating_add(INTERVAL_NS);
            self.watch.is_suspicious = false;
            self.begin_reading();
            self.watch_step(Step::Renew, now);
        }
    }

    fn watch_step(&mut self, step: Step, now: Ns) {
        let ask = match step {
            Step::Renew => Ask::UpdateStates,
            Step::All => Ask::StateOfAll,
            Step::One(slave) => Ask::StateOf(slave),
        };
        self.watch.step = step;
        self.watch.asked = ask.submit(&mut self.host, now).ok();
    }

    /// Whether all slaves are in OP, as the lowest AL state of all slaves shows, and jobs have brought all of them to
    /// OP.
    fn are_all_in_op(&self, lowest: Option<AlState>) -> bool {
        let network = &self.network;
        lowest == Some(AlState::Op) && network.lost.is_empty() && network.in_op() == SlaveSet::first(network.found)
    }

    /// Whether the states of the slaves are being read.
    pub(super) const fn is_watching(&self) -> bool {
        self.watch.asked.is_some()
    }

    /// Evaluates the state that was read from a slave: a slave below the state to which it was brought is lost.
    pub(super) fn note_state(&mut self, slave: u8, state: Option<AlState>) {
        self.network.note_objects(slave, state, self.wires.now());
        let commanded = self.network.commanded[usize::from(slave) - 1];
        if state.is_none_or(|state| state < commanded) {
            if !self.network.lost.contains(slave) {
                let from = if commanded == AlState::Op { self.watch.suspect_from.or(self.watch.unsent) } else { None };
                self.network.lost_from[usize::from(slave) - 1] = from;
                self.network.lost.insert(slave);
                self.network.forget_objects(slave);
                self.hold_lost(self.network.lost);
            }
        } else if commanded < AlState::SafeOp {
            self.network.found_again(slave);
        }
    }

    /// Called when the chip has lost its settings, for example by a reset: all slaves are lost, the sets of outputs in the chip
    /// are lost, and a running job has failed.
    pub(super) fn lose_all(&mut self) {
        if let Some(job) = self.job.take() {
            self.abandon_asked();
            let asked_for = self.next_job.take().or(Some(job).filter(|job| !job.is_ahead));
            self.job_done = asked_for.map(|job| job.cut_off()).or(self.job_done);
        }
        self.end_ahead();
        let in_op = self.network.in_op();
        // The chip no longer shows which slaves have missed earlier outputs. So for every slave in OP, all outputs that
        // are not known to be sent count as missed, and also all outputs from `suspect_from` on if it is set.
        let next = self.ledger.next_id();
        let missed_from = self.watch.suspect_from.map_or(next, |from| from.min(next));
        let all = SlaveSet::first(self.network.found);
        for slave in all.iter() {
            let n = usize::from(slave) - 1;
            if in_op.contains(slave) && !self.network.lost.contains(slave) {
                self.network.lost_from[n] = Some(missed_from);
            }
            self.network.commanded[n] = AlState::Init;
        }
        (self.network.lost, self.network.stale) = (all, SlaveSet::EMPTY);
        self.pins = PinSetup::Due;
        (self.network.initialised, self.network.mapped) = (false, false);
        self.lose_sets(self.ledger.ahead());
        self.ledger.lost();
        self.level.clear();
        self.flying.clear();
        (self.runs, self.repeat_is_due) = (false, false);
        self.gap = true;
    }
}
