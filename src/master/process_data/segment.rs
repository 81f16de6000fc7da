//! A datagram with process data, and what has come back of it in a cycle.

use super::CycleDone;
use super::expected::Expected;
use crate::ethercat::{Command, SlaveSet};

/// A datagram with process data; with LRW off two, an LWR and an LRD.
#[derive(Debug)]
pub(super) struct Segment {
    pub(super) command: Command,
    pub(super) data: Vec<u8>,
    pub(super) slaves: SlaveSet,
    /// The right working counters. The first is for the only datagram, or with LRW off for the LRD; the second is for
    /// the LWR.
    pub(super) expected: [Expected; 2],
    answer: Answer,
}

/// What has come back of the datagrams of a segment in the present cycle.
#[derive(Debug, Default)]
struct Answer {
    /// The number of datagrams that have not returned.
    missing: u8,
    /// The sum of the working counters that came back.
    counted: u16,
    /// The working counter of the LWR, which is part of `counted`.
    written: u16,
    /// The inputs have come back with a right working counter.
    is_fresh: bool,
    /// The working counter of the inputs shows that all slaves have taken part with all their data.
    is_of_all: bool,
    /// A datagram has come back with a wrong working counter.
    is_doubtful: bool,
}

impl Segment {
    pub(super) fn new(command: Command, data: Vec<u8>) -> Self {
        Self { command, data, slaves: SlaveSet::EMPTY, expected: [Expected::default(); 2], answer: Answer::default() }
    }

    /// Whether two datagrams are sent, an LWR and an LRD.
    pub(super) fn is_split(&self, is_lrw_off: bool) -> bool {
        is_lrw_off && self.command == Command::Lrw
    }

    /// Resets the results for a new cycle.
    pub(super) fn begin(&mut self, is_lrw_off: bool) {
        self.answer = Answer { missing: 1 + u8::from(self.is_split(is_lrw_off)), ..Answer::default() };
    }

    /// Takes a datagram of the segment that has come back. `is_written`: the segment is sent as two datagrams, and this
    /// is the LWR with the outputs. Returns whether the datagram has inputs of this cycle.
    pub(super) fn receive(&mut self, is_written: bool, working_counter: u16) -> bool {
        let answer = &mut self.answer;
        answer.missing = answer.missing.saturating_sub(1);
        answer.counted = answer.counted.saturating_add(working_counter);
        if is_written || self.command == Command::Lwr {
            answer.written = working_counter;
        }
        let expected = &self.expected[usize::from(is_written)];
        let is_right = expected.allows(working_counter);
        answer.is_doubtful |= !is_right;
        if is_written || !is_right {
            return false;
        }
        (answer.is_fresh, answer.is_of_all) = (true, expected.is_of_all(working_counter));
        true
    }

    /// Adds what has come back to the result of the cycle. `expected`: the working counter of the slaves that take part.
    /// `certain`: those that take part for certain.
    pub(super) fn end(&self, cycle: &mut CycleDone, taking_part: SlaveSet, expected: u16, certain: SlaveSet) {
        let Answer { missing, counted, written, is_fresh, is_of_all, is_doubtful } = self.answer;
        cycle.expected_working_counter += expected;
        if missing == 0 {
            cycle.working_counter = cycle.working_counter.saturating_add(counted);
            cycle.written = cycle.written.saturating_add(written);
        } else {
            cycle.lost += 1;
        }
        if missing > 0 || counted < expected {
            cycle.short = cycle.short.union(taking_part);
        }
        if is_doubtful {
            cycle.doubtful = cycle.doubtful.union(taking_part);
        }
        if is_fresh && self.command != Command::Lwr {
            let came = if is_of_all { self.slaves } else { self.slaves.intersection(certain) };
            cycle.fresh = cycle.fresh.union(came);
        }
    }
}
