//! The account of a program: its accepted commands, those that its slaves got, and the board's counters.

use std::collections::BTreeMap;

use ecmsk::engine::Counters;
use ecmsk::fieldbus::AlState;
use ecmsk::sk::FIFO_ENTRIES;

use super::follower::{Follower, Note};

/// The module of digital outputs; the slaves behind it are drives.
pub const IO: usize = 1;

/// A frame that the board has taken into its FIFO since the last rest.
#[derive(Default)]
struct Taken {
    /// Targets and marks in it.
    commands: u64,
    /// Of these, how many their slaves have got.
    got: u64,
}

/// The account of a slave.
#[derive(Default)]
struct Known {
    /// Targets, or marks in the outputs of the module, that were accepted and have not come yet, and their frames.
    open: BTreeMap<i32, usize>,
    /// The newest value that has come.
    newest: i32,
    /// An SV_ON that may still act: only if it was among that many first accepted frames.
    switched_on_by: Option<u64>,
    /// The numbers of the frames with an SV_OFF.
    switched_off_by: Vec<u64>,
    was_on: bool,
    state: AlState,
}

/// The totals of a schedule.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    pub accepted: u64,
    pub got: u64,
    pub cleared: u64,
    pub sets_lost: u64,
    pub single: u64,
    pub enabled: u64,
}

/// The account.
pub struct Books {
    slaves: Vec<Known>,
    frames: Vec<Taken>,
    /// Frames that were queued since the board was made.
    queued: u64,
    /// The number of accepted frames that are not held any more.
    done: u64,
    /// The counters at the last rest.
    then: Counters,
    pub account: Account,
}

/// Commands that were counted one by one.
fn single(counters: &Counters) -> u64 {
    counters.discarded_before_enabled + counters.for_lost + counters.ignored_homing + counters.rejected_total()
}

impl Books {
    pub fn new(slaves: usize, counters: &Counters) -> Self {
        let slaves = (0..slaves).map(|_| Known::default()).collect();
        Self { slaves, frames: Vec::new(), queued: 0, done: 0, then: *counters, account: Account::default() }
    }

    /// The board has taken a frame into its FIFO: with these targets and marks, each with its slave, and an SV_ON or SV_OFF for
    /// these.
    pub fn accepted(&mut self, commands: &[(usize, i32)], switched: &[(usize, bool)]) {
        for (slave, value) in commands {
            self.slaves[slave - 1].open.insert(*value, self.frames.len());
        }
        self.frames.push(Taken { commands: commands.len() as u64, got: 0 });
        self.account.accepted += commands.len() as u64;
        self.queued += 1;
        for (slave, on) in switched {
            let known = &mut self.slaves[slave - 1];
            if *on {
                known.switched_on_by = Some(self.queued);
            } else {
                known.switched_off_by.push(self.queued);
            }
        }
    }

    /// Whether an SV_ON may be under way to a slave.
    pub fn may_be_on(&self, slave: usize) -> bool {
        self.slaves[slave - 1].switched_on_by.is_some()
    }

    /// A cycle of the board has passed.
    pub fn look(&mut self, followers: &[Follower], fifo_free: u16) {
        for (n, follower) in followers.iter().enumerate() {
            for note in follower.inside().take_notes() {
                self.note(n + 1, note);
            }
        }
        self.done = self.queued - u64::from(FIFO_ENTRIES - fifo_free);
    }

    fn note(&mut self, slave: usize, note: Note) {
        let known = &mut self.slaves[slave - 1];
        match note {
            Note::State(state) => {
                known.state = state;
                if state != AlState::Op {
                    self.fell(slave);
                }
            }
            Note::Got { out, .. } if slave == IO => {
                let mark = i32::from(out.outputs);
                if mark != 0 && (mark != known.newest || !known.was_on) {
                    self.value(slave, mark, "outputs");
                }
                // The outputs hold until they are switched off.
                self.slaves[slave - 1].was_on = mark != 0;
            }
            Note::Got { out, was_on, is_on, position } => {
                // An SV_ON after the SV_OFF waits for its end. An SV_OFF that is still held has switched off nothing.
                let off = known.switched_off_by.iter().rfind(|frame| **frame <= self.done + 1);
                let is_asked = known.switched_on_by > off.copied();
                if !is_on && known.was_on && !is_asked {
                    self.fell(slave);
                } else if is_on && !was_on {
                    assert_eq!(out.target, position, "slave {slave} jumps when it is switched on");
                    let by = self.slaves[slave - 1].switched_on_by;
                    assert!(by.is_some(), "slave {slave} is switched on, and no SV_ON has asked for it");
                    self.account.enabled += 1;
                } else if is_on && out.target != position {
                    self.value(slave, out.target, "target");
                }
                self.slaves[slave - 1].was_on = is_on;
            }
        }
    }

    /// A drive is off, or a slave has left OP: only an SV_ON that may still be held, or comes later, switches it on again.
    fn fell(&mut self, slave: usize) {
        let (known, done) = (&mut self.slaves[slave - 1], self.done);
        known.switched_on_by = known.switched_on_by.filter(|frame| *frame > done);
        known.was_on = false;
    }

    /// A slave that follows has got a new value.
    fn value(&mut self, slave: usize, value: i32, what: &str) {
        let known = &mut self.slaves[slave - 1];
        let frame = known.open.remove(&value);
        let Some(frame) = frame else {
            panic!("slave {slave} gets {what} {value} again, or nobody has sent it; the newest was {}", known.newest);
        };
        assert!(value > known.newest, "slave {slave} gets {what} {value} behind {}", known.newest);
        known.newest = value;
        self.frames[frame].got += 1;
        self.account.got += 1;
    }

    /// The values that have not come: slave, value and frame.
    fn missing(&self) -> Vec<(usize, i32, usize)> {
        let slaves = self.slaves.iter().zip(1..);
        slaves.flat_map(|(known, slave)| known.open.iter().map(move |(value, frame)| (slave, *value, *frame))).collect()
    }

    /// Checks the account at rest, when no entry is held and the bus has none ahead: everything accepted since the last
    /// rest was received or counted. `quiet`: there was no fault since then.
    pub fn compare(&mut self, counters: &Counters, quiet: bool) {
        let then = std::mem::replace(&mut self.then, *counters);
        let cleared = counters.cleared - then.cleared;
        let sets_lost = counters.outputs_lost - then.outputs_lost;
        let counted = single(counters) - single(&then);
        let queued = self.frames.len() as u64;
        let executed = counters.executed - then.executed;
        assert_eq!(queued, executed + cleared, "frames queued: executed or cleared");
        // A set of outputs has one frame at most: the frames that miss most count as cleared or lost with their set.
        let mut missed: Vec<u64> = self.frames.iter().map(|frame| frame.commands - frame.got).collect();
        missed.sort_unstable_by(|a, b| b.cmp(a));
        let singly: u64 = missed.iter().skip((cleared + sets_lost) as usize).sum();
        assert!(
            singly <= counted,
            "{singly} commands more were lost than {cleared} frames cleared, {sets_lost} sets lost and {counted} counted: {:?}",
            self.missing().iter().take(20).collect::<Vec<_>>()
        );
        let seen = self.frames.iter().filter(|frame| frame.got > 0).count() as u64;
        let slack = if quiet { 0 } else { sets_lost };
        assert!(
            seen + cleared <= queued + slack,
            "{queued} queued, {cleared} cleared, {seen} have come ({sets_lost} lost)"
        );
        if quiet {
            assert_eq!(sets_lost, 0, "sets of outputs were lost, and nothing went wrong");
        }
        self.account.cleared += cleared;
        self.account.sets_lost += sets_lost;
        self.account.single += counted;
        self.frames.clear();
        self.slaves.iter_mut().for_each(|known| known.open.clear());
    }
}
