//! The homing of one axis (SK-7): bit 4 of the controlword, which statuswords of the drive count, and when homing has
//! ended.
//!
//! **Which statuswords count** \[OURS]. When bit 4 rises, bits 10, 12 and 13 may still show an earlier homing or
//! another mode. The inputs of a cycle were measured before its outputs arrived. So the first statusword that counts is
//! in the answer of the cycle after the one that carried bit 4 to the drive, however many outputs a bus has queued. A
//! result, attained or error, is accepted in three cases, in which it cannot be an old one:
//! - A statusword that counts has shown bits 12 and 13 clear before.
//! - The drive, enabled and in mode 6, has shown them clear in every answer of the last [`RESULT_SETTLE_NS`] before bit 4
//!   reached it. So the result of a drive that is home at once, by methods 35 and 37, is accepted at once.
//! - The same result was shown for [`RESULT_SETTLE_NS`].
//!
//! The time before bit 4 counts from the end of the write of 0x6060, and starts again whenever the drive shows bit 12
//! or 13 or is not enabled. For a drive may confirm the write before it changes its mode, and then show the result of
//! an earlier homing. In CSP, bit 12 means that the drive follows its target.
//!
//! **When the next homing may start** \[OURS]. While the board still waits for a result to settle, reports already show
//! GO_HOME with bits 10 and 12, and the program may send the next GO_HOME. So for the rule of one homing at a time,
//! homing ends earlier: as soon as a report has shown GO_HOME with bits 10 and 12, or with bit 13
//! ([`AxisHoming::seems_over`]). Each axis of a two-channel pulse module counts by its own statusword. The slot shows
//! only the statusword of axis 1; a program can read the one of axis 2 as 0x6841.
//!
//! **What follows the end** \[OURS]. Bit 4 falls. Once the drive has received the clear bit, it gets time to come to a
//! standstill. Then outputs with its actual position, in the coordinates after homing, hold the axis there. The mode
//! may change only after the drive has received these outputs, too: so no target from before homing can make the axis
//! jump.

use std::fmt;

use crate::ethercat::cia402::{DriveState, Statusword};
use crate::fieldbus::Ns;

/// How many consecutive sets of outputs, one per cycle, must have bit 4 clear before it may rise again \[OURS]. That is
/// 2 ms at the shortest cycle, so that a drive that does not read its controlword in every cycle still sees the edge.
const START_BIT_LOW_SETS: u8 = 8;

/// A homing result in the statusword is accepted if the drive has shown no result for this long before bit 4 rose, or
/// shows the same result for this long after it \[OURS].
const RESULT_SETTLE_NS: Ns = 20_000_000;
/// [`RESULT_SETTLE_NS`] counts as passed only after at least this many answers of the drive, because with long cycles
/// only few answers come in that time \[OURS].
const RESULT_SETTLE_ANSWERS: u64 = 4;

/// How long the board waits for the drive to come to a standstill after homing; bit 10 shows the standstill \[OURS].
const STANDSTILL_TIMEOUT_NS: Ns = 500_000_000;

/// Why the homing of an axis has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum HomingEnd {
    /// Statusword bits 10 and 12: homing attained.
    Attained,
    /// Statusword bit 13: homing error.
    Error,
    /// The drive has left Operation enabled, by a fault for example.
    NotEnabled,
    /// SV_OFF was executed.
    ServoOff,
    /// ABORT_HOME was executed.
    Aborted,
    /// The host has written 0x6060 (0x6860).
    ModeWritten,
    /// The network has left OP, which ends all homing.
    LeftOp,
    /// The slave is lost.
    Lost,
}

impl HomingEnd {
    /// Whether the cause is a command in a FIFO entry. If SET_FIFO 1 clears this entry, the command is taken back, and
    /// the homing continues. A homing that has ended for another cause stays ended.
    const fn is_from_fifo_entry(self) -> bool {
        matches!(self, Self::ServoOff | Self::Aborted)
    }
}

impl fmt::Display for HomingEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Attained => "home attained",
            Self::Error => "homing error (statusword bit 13): see the drive's limits, switches and 0x6098",
            Self::NotEnabled => "the drive has left Operation enabled: see its error code",
            Self::ServoOff => "ended by SV_OFF",
            Self::Aborted => "ended by ABORT_HOME",
            Self::ModeWritten => "ended by the host's write of the mode of operation",
            Self::LeftOp => "ended with OP",
            Self::Lost => "the slave no longer answers: check its cable and power",
        })
    }
}

/// The homing result that a statusword shows: bits 10 and 12 for attained, bit 13 for error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ShownResult {
    None,
    Attained,
    Error,
}

impl ShownResult {
    const fn of(Statusword(word): Statusword) -> Self {
        const ATTAINED: u16 = Statusword::TARGET_REACHED | Statusword::BIT12;
        if word & Statusword::BIT13 != 0 {
            Self::Error
        } else if word & ATTAINED == ATTAINED {
            Self::Attained
        } else {
            Self::None
        }
    }
}

const fn shows_no_result(Statusword(word): Statusword) -> bool {
    word & (Statusword::BIT12 | Statusword::BIT13) == 0
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Idle,
    /// GO_HOME was executed. Bit 4 rises once it has been clear for [`START_BIT_LOW_SETS`] sets of outputs.
    Requested,
    /// Bit 4 is set; `first` is the id of the first outputs with it. The last `in_a_row` consecutive answers have shown
    /// `result`. If `clear_seen`, the drive has shown bits 12 and 13 clear, so a result is accepted at once.
    Running { first: u64, result: ShownResult, in_a_row: u64, clear_seen: bool },
    /// Homing has ended for the cause `end`, and the drive is coming to a standstill. `clear` is the id of the first
    /// outputs with bit 4 clear; `None`: they were not made yet. `answers` counts the answers that the drive measured
    /// after it got these outputs.
    Braking { end: HomingEnd, clear: Option<u64>, answers: u64 },
    /// The drive stands still. `there` is the id of the first outputs that hold it at its actual position; `None`: they
    /// were not made yet.
    Holding { end: HomingEnd, there: Option<u64> },
}

/// A change in the homing of an axis that the answer of a cycle causes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HomingEvent {
    /// Homing has ended for this cause.
    Ended(HomingEnd),
    /// The drive has come to a standstill after homing and is held there. The mode of operation may change.
    AtStandstill,
}

/// The statusword of an axis in the answer of a cycle, and the outputs that had reached the slave when it was measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    pub(super) statusword: Statusword,
    /// The id of the newest outputs that had reached the slave when it measured this statusword.
    pub(super) outputs_received: Option<u64>,
    /// The time between two answers: the cycle time, ns.
    pub(super) period_ns: Ns,
}

impl Answer {
    /// Whether the drive measured this answer after the outputs with the id `outputs` had reached it. `None`: these
    /// outputs were not made yet, so the result is false.
    fn follows(&self, outputs: Option<u64>) -> bool {
        outputs.is_some() && self.outputs_received >= outputs
    }

    /// The number of answers, one per cycle, that come within `ns`, rounded up.
    fn in_time(&self, ns: Ns) -> u64 {
        ns.div_ceil(self.period_ns.max(1))
    }
}

/// The state of the homing of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct AxisHoming {
    phase: Phase,
    /// In how many more sets of outputs bit 4 must stay clear before it may rise.
    low_sets_left: u8,
    /// The number of consecutive answers, before bit 4 rose, that showed the drive enabled, in mode 6 and without a
    /// result.
    clear_answers: u64,
    /// Answers of cycles before this time may be from before the change to mode 6, so they are ignored.
    mode_since: Ns,
    /// The newest homing that has ended for another cause than a command of a FIFO entry: the id of its first outputs
    /// with bit 4 set, and the cause of its end. A rollback to a time before that end must not resume this homing.
    ended: Option<(u64, HomingEnd)>,
}

impl AxisHoming {
    /// An axis that is not homing. Bit 4 must stay clear in `low_sets_left` more sets of outputs.
    pub(super) const fn idle(low_sets_left: u8) -> Self {
        Self { phase: Phase::Idle, low_sets_left, clear_answers: 0, mode_since: 0, ended: None }
    }

    /// In how many more sets of outputs bit 4 must stay clear before it may rise.
    pub(super) const fn low_sets_left(&self) -> u8 {
        self.low_sets_left
    }

    /// Whether GO_HOME was executed and homing has not ended yet.
    pub(super) const fn is_homing(&self) -> bool {
        matches!(self.phase, Phase::Requested | Phase::Running { .. })
    }

    /// Whether homing has ended, but the steps after it have not, so that the mode of operation must not change yet.
    pub(super) const fn is_ending(&self) -> bool {
        matches!(self.phase, Phase::Braking { .. } | Phase::Holding { .. })
    }

    /// Whether the axis is not homing and has finished the steps after its last homing.
    pub(super) const fn is_idle(&self) -> bool {
        matches!(self.phase, Phase::Idle)
    }

    /// Whether the axis is not homing, and bit 4 has been clear for long enough that it may rise at once.
    pub(super) const fn is_at_rest(&self) -> bool {
        self.is_idle() && self.low_sets_left == 0
    }

    /// GO_HOME: homing starts with one of the next sets of outputs.
    pub(super) const fn start(&mut self) {
        self.phase = Phase::Requested;
    }

    /// Delays a requested homing: bit 4 does not rise in the next set of outputs. Called for each set while an SDO write
    /// of the axis's mode, which would end the homing, is under way.
    pub(super) fn wait(&mut self) {
        if self.phase == Phase::Requested {
            self.low_sets_left = self.low_sets_left.max(1);
        }
    }

    /// Ends homing, if the axis is homing; returns whether it was.
    pub(super) const fn end(&mut self, end: HomingEnd) -> bool {
        if !self.is_homing() {
            return false;
        }
        if let Phase::Running { first, .. } = self.phase {
            self.low_sets_left = START_BIT_LOW_SETS;
            self.clear_answers = 0;
            if !end.is_from_fifo_entry() {
                self.ended = Some((first, end));
            }
        }
        self.phase = Phase::Braking { end, clear: None, answers: 0 };
        true
    }

    /// Skips the steps after homing, which are the wait for a standstill and holding the axis at its position. Called
    /// when the slave is lost, or when the mode of operation has changed already: these steps only prepare that change.
    pub(super) const fn skip_standstill(&mut self) {
        if self.is_ending() {
            self.phase = Phase::Idle;
        }
    }

    /// Called when 0x6060 was written, at the latest at `at`. Answers of cycles before `at` are ignored, since they may show
    /// the earlier mode.
    pub(super) const fn mode_written(&mut self, at: Ns) {
        self.clear_answers = 0;
        self.mode_since = at;
    }

    /// Evaluates the answer of the cycle at `at` unless bit 4 of the controlword (start homing) is set. Counts
    /// consecutive answers in which the drive is enabled, in mode 6, and shows neither bit 12 nor bit 13. With enough
    /// of them before bit 4 rises, the first result after it is accepted at once.
    pub(super) fn observe_idle(&mut self, at: Ns, in_mode_6: bool, statusword: Statusword) {
        if matches!(self.phase, Phase::Running { .. }) {
            return;
        }
        let clear_answers = in_mode_6 && statusword.is_enabled() && shows_no_result(statusword);
        self.clear_answers = if clear_answers && at >= self.mode_since { self.clear_answers + 1 } else { 0 };
    }

    /// Whether a report has shown a result of this homing to the host: the statusword in the newest report shows a
    /// result, and the newest outputs that this report answers, with the id `shown`, had bit 4 set.
    pub(super) fn seems_over(&self, shown: Option<u64>, statusword: Statusword) -> bool {
        matches!(self.phase, Phase::Running { first, .. } if shown >= Some(first))
            && ShownResult::of(statusword) != ShownResult::None
    }

    /// The value of bit 4 of the controlword in the next outputs, unless a command changes it before.
    pub(super) const fn start_bit(&self) -> bool {
        matches!(self.phase, Phase::Running { .. })
    }

    /// Whether the next set of outputs must be sent even if it equals the last one: the time for which bit 4 has to stay
    /// clear is counted in sets of outputs, and homing waits for the answer to a certain set.
    pub(super) const fn is_under_way(&self) -> bool {
        self.low_sets_left > 0
            || matches!(
                self.phase,
                Phase::Requested | Phase::Braking { clear: None, .. } | Phase::Holding { there: None, .. }
            )
    }

    /// The value of bit 4 of the controlword in the next set of outputs, whose id is `id`.
    pub(super) fn next_bit(&mut self, id: u64) -> bool {
        match &mut self.phase {
            Phase::Running { .. } => return true,
            Phase::Requested if self.low_sets_left == 0 => {
                self.phase = Phase::Running { first: id, result: ShownResult::None, in_a_row: 0, clear_seen: false };
                return true;
            }
            Phase::Braking { clear: mark, .. } | Phase::Holding { there: mark, .. } => {
                mark.get_or_insert(id);
            }
            Phase::Requested | Phase::Idle => {}
        }
        self.low_sets_left = self.low_sets_left.saturating_sub(1);
        false
    }

    /// Evaluates the answer of a cycle. Returns the change in the homing that it causes; `None`: no change.
    pub(super) fn take_answer(&mut self, answer: &Answer) -> Option<HomingEvent> {
        let Statusword(word) = answer.statusword;
        let off = answer.statusword.state().is_some_and(|state| state != DriveState::OperationEnabled);
        if off && self.end(HomingEnd::NotEnabled) {
            return Some(HomingEvent::Ended(HomingEnd::NotEnabled));
        }
        match &mut self.phase {
            Phase::Running { first, .. } if !answer.follows(Some(*first)) => {
                if !shows_no_result(answer.statusword) {
                    self.clear_answers = 0;
                }
                None
            }
            Phase::Running { result, in_a_row, clear_seen, .. } => {
                let shown = ShownResult::of(answer.statusword);
                *in_a_row = if shown == *result { *in_a_row + 1 } else { 1 };
                *result = shown;
                let settling = answer.in_time(RESULT_SETTLE_NS).max(RESULT_SETTLE_ANSWERS);
                *clear_seen |= shows_no_result(answer.statusword) || self.clear_answers >= settling;
                let settled = *in_a_row >= settling;
                let end = match shown {
                    ShownResult::Attained => HomingEnd::Attained,
                    ShownResult::Error => HomingEnd::Error,
                    ShownResult::None => return None,
                };
                (*clear_seen || settled).then(|| {
                    self.end(end);
                    HomingEvent::Ended(end)
                })
            }
            Phase::Braking { end, clear, answers } if answer.follows(*clear) => {
                *answers += 1;
                let reached = word & Statusword::TARGET_REACHED != 0;
                if off || reached || *end == HomingEnd::Attained || *answers >= answer.in_time(STANDSTILL_TIMEOUT_NS) {
                    self.phase = Phase::Holding { end: *end, there: None };
                }
                None
            }
            Phase::Holding { there, .. } if answer.follows(*there) => {
                self.phase = Phase::Idle;
                Some(HomingEvent::AtStandstill)
            }
            _ => None,
        }
    }

    /// Takes back the changes that commands of FIFO entries have made to this homing since its state was `then`, because
    /// SET_FIFO 1 has cleared these entries. A homing that the drive has ended stays ended.
    pub(super) fn roll_back_to(&mut self, then: &Self) {
        let braking = |end| Phase::Braking { end, clear: None, answers: 0 };
        let (phase, rest) = match (self.phase, then.phase) {
            (Phase::Running { first: now, .. }, Phase::Running { first, .. }) if now == first => return,
            (Phase::Idle, _) => (Phase::Idle, self.low_sets_left.max(then.low_sets_left)),
            (_, Phase::Running { first, .. }) if self.ended.is_some_and(|(ended, _)| ended == first) => {
                (self.ended.map_or(Phase::Idle, |(_, end)| braking(end)), START_BIT_LOW_SETS)
            }
            (Phase::Braking { end, .. } | Phase::Holding { end, .. }, Phase::Requested)
                if !end.is_from_fifo_entry() =>
            {
                (braking(end), then.low_sets_left)
            }
            (_, phase) => (phase, then.low_sets_left),
        };
        self.phase = phase;
        self.low_sets_left = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAR: Statusword = Statusword(0x0237);
    const ATTAINED: Statusword = Statusword(0x0237 | Statusword::TARGET_REACHED | Statusword::BIT12);

    fn answer(statusword: Statusword, outputs_received: u64) -> Answer {
        Answer { statusword, outputs_received: Some(outputs_received), period_ns: 1_000_000 }
    }

    /// An axis whose homing runs since the outputs with id 10.
    fn running() -> AxisHoming {
        let mut homing = AxisHoming::default();
        homing.start();
        assert!(homing.next_bit(10));
        homing
    }

    /// SK-5.22 A clear that takes back entries during homing does not change what the drive has shown since: it has
    /// shown no result, so that its next result is accepted at once.
    #[test]
    fn what_was_shown_counts_after_a_clear() {
        let mut homing = running();
        let then = homing;
        assert_eq!(homing.take_answer(&answer(CLEAR, 10)), None);
        homing.roll_back_to(&then);
        assert_eq!(homing.take_answer(&answer(ATTAINED, 11)), Some(HomingEvent::Ended(HomingEnd::Attained)));
    }

    /// SK-5.22 A clear takes back an ABORT_HOME and the GO_HOME after it. The first homing goes on, and its end by the
    /// drive is not taken back by a later clear.
    #[test]
    fn another_homing_is_taken_back() {
        let mut homing = running();
        let then = homing;
        assert!(homing.end(HomingEnd::Aborted));
        homing.start();
        let first = (11..40).find(|id| homing.next_bit(*id)).expect("bit 4 rises again");
        assert_eq!(first, 11 + u64::from(START_BIT_LOW_SETS), "after its rest");
        homing.roll_back_to(&then);
        assert!(homing.is_homing() && homing.next_bit(first + 1));
        // This answer was measured before bit 4 of the second homing could have been sent. It belongs to the first
        // homing, which goes on.
        assert_eq!(homing.take_answer(&answer(CLEAR, 10)), None);
        assert_eq!(homing.take_answer(&answer(ATTAINED, 10)), Some(HomingEvent::Ended(HomingEnd::Attained)));
        homing.roll_back_to(&then);
        assert!(!homing.is_homing(), "what the drive has ended stays ended");
    }

    /// SK-5.22 A homing was waiting until bit 4 had been clear for long enough when an ABORT_HOME ended it. When the
    /// ABORT_HOME is taken back, homing goes on, unless the drive has left Operation enabled meanwhile.
    #[test]
    fn one_that_waits_is_taken_back_to() {
        for (end, goes_on) in [(HomingEnd::Aborted, true), (HomingEnd::ServoOff, true), (HomingEnd::NotEnabled, false)]
        {
            let mut homing = AxisHoming::default();
            homing.start();
            let then = homing;
            assert!(homing.end(end));
            homing.roll_back_to(&then);
            assert_eq!((homing.is_homing(), homing.is_ending()), (goes_on, !goes_on), "{end}");
        }
    }

    /// SK-7.39 Answers that may be older than the change of mode are ignored, whatever they show: the 20 ms without a
    /// result, after which a result is accepted at once, begin after them.
    #[test]
    fn answers_of_before_the_mode_say_nothing() {
        const MS: Ns = 1_000_000;
        for older in [CLEAR, ATTAINED] {
            for (clear_answers, believed) in
                [(RESULT_SETTLE_NS / 1_000_000 - 1, false), (RESULT_SETTLE_NS / 1_000_000, true)]
            {
                let mut homing = AxisHoming::default();
                homing.mode_written(16 * MS);
                (0..16).for_each(|ms| homing.observe_idle(ms * MS, true, older));
                (0..clear_answers).for_each(|ms| homing.observe_idle((16 + ms) * MS, true, CLEAR));
                homing.start();
                assert!(homing.next_bit(10));
                let end = homing.take_answer(&answer(ATTAINED, 10));
                let expected = believed.then_some(HomingEvent::Ended(HomingEnd::Attained));
                assert_eq!(end, expected, "{clear_answers} answers after {older:?}");
            }
        }
    }

    /// SK-7.41 The time for coming to a standstill begins when the drive has got outputs with bit 4 clear. Statuswords
    /// from before that are ignored, for example bit 10 of an earlier move.
    #[test]
    fn standing_counts_when_bit_4_has_fallen() {
        const REACHED: Statusword = Statusword(0x0237 | Statusword::TARGET_REACHED);
        let mut homing = running();
        assert!(homing.end(HomingEnd::Aborted));
        assert!(!homing.next_bit(11));
        assert_eq!(homing.take_answer(&answer(REACHED, 10)), None);
        assert!(!homing.next_bit(12));
        assert_eq!(homing.take_answer(&answer(CLEAR, 12)), None, "it brakes");
        assert_eq!(homing.take_answer(&answer(REACHED, 13)), None, "it stands, and is to be held there");
        assert!(!homing.next_bit(14));
        assert_eq!(homing.take_answer(&answer(REACHED, 13)), None);
        assert_eq!(homing.take_answer(&answer(REACHED, 14)), Some(HomingEvent::AtStandstill));
    }
}
