//! Sends the frames of a motion, one a cycle, for `move` and `jog`. An axis that does not take its target does not stop
//! the other axes. If the axes have stopped because this process was late, they are not started again at full speed.

use std::time::{Duration, Instant};

use ecmsk::ecm::{Axis, Config, EcmError, Guard, Snapshot, Stream, StreamStats};
use ecmsk::sk::{SlotSize, StateByte};

use crate::board::{Board, BoardError, Units};

/// \[OURS] How long before their execution targets are sent, so that they wait in the FIFO. If this process is late by
/// less than this time, the motion has no gap.
const AHEAD: Duration = Duration::from_millis(64);
/// \[OURS] The limits of the number of buffered frames. They override [`AHEAD`] for very short and very long cycles.
const DEPTHS: std::ops::RangeInclusive<u64> = 8..=150;
/// \[OURS] If an internal limit of the drive keeps an axis away from its target for this long, the motion fails. This
/// is more than twice the time of the buffered frames, so by then the reports answer the present targets.
const HELD_LIMIT: Duration = Duration::from_millis(150);
/// \[OURS] The time limit for braking after Ctrl-C. The tool promises to end within 2 s after Ctrl-C; the rest of that time
/// is for closing the board.
pub const BRAKE_LIMIT: Duration = Duration::from_millis(1500);
/// \[OURS] The number of cycles in which the last targets are sent again, so that the drives can settle.
const HOLD_FRAMES: usize = 9;
/// \[OURS] After a gap longer than this the axes start again from rest. After a shorter gap they continue at their
/// speed; otherwise a program that is often slightly late would never finish a move.
const GAP_MAX: Duration = Duration::from_millis(100);
/// \[OURS] Braking ends early if the board has had no target for more cycles than this, because the axes have stopped
/// then. Fewer cycles do not stop a drive, and a single lost report may look like one such cycle.
const BRAKE_GAP_CYCLES: u64 = 5;
/// \[OURS] If this process sends no frame for longer than this, it has stalled and the axes have stopped. With long
/// cycles, twice the execution time of the buffered frames is used instead.
const STALL: Duration = Duration::from_millis(100);

/// The stream of frames of one motion.
pub struct Frames<'a> {
    board: &'a Board,
    pub stream: Stream<'a>,
    /// The last report before the motion.
    before: Snapshot,
    /// Axes that have refused a target. They get no new targets, because a later target would be a jump.
    holding: Vec<u8>,
    gaps: Gaps,
}

impl<'a> Frames<'a> {
    /// Begins to send frames to axes that are at rest, as the report `before` shows them. `depth`: the number of
    /// buffered frames, see [`depth`]; `cycle`: the cycle time in seconds.
    ///
    /// # Errors
    /// Those of [`ecmsk::ecm::Ecm::stream`].
    pub fn begin(board: &'a Board, before: Snapshot, depth: u16, cycle: f64) -> Result<Self, BoardError> {
        let stream = board.ecm.stream(depth).map_err(|error| board.explain(error))?;
        let stall = STALL.max(Duration::from_secs_f64(2.0 * f64::from(depth) * cycle));
        // On a virtual clock, time waits for this process, so a stall makes no gap.
        let stall = (!board.ecm.link_info().virtual_time).then_some(stall);
        let gaps = Gaps::new(stall, cycle, Instant::now());
        Ok(Self { board, stream, before, holding: Vec::new(), gaps })
    }

    /// Whether this process was so late that the board has executed all buffered frames. The axes have then stopped at
    /// their last targets and must start from rest. Must be called before each frame.
    pub fn axes_stand(&mut self) -> bool {
        self.gaps.axes_stand(Instant::now())
    }

    /// Sends the targets of one cycle. An axis does not take its target if it is lost, disabled, has an alarm or does
    /// not follow. From then on it holds its last target. The other axes still get their targets, so that they can be
    /// braked. Returns the error of the first axis that has begun to hold in this call.
    ///
    /// # Errors
    /// No axis takes targets, or the frame cannot be sent.
    pub fn send(&mut self, targets: impl IntoIterator<Item = (u8, i32)>) -> Result<Option<BoardError>, BoardError> {
        let mut refused = None;
        for (slave, target) in targets {
            if self.holding.contains(&slave) {
                continue;
            }
            match self.aim(slave, target) {
                Err(
                    error @ (EcmError::SlaveLost { .. }
                    | EcmError::Alarm { .. }
                    | EcmError::NotEnabled { .. }
                    | EcmError::SecondOff { .. }
                    | EcmError::TooFar { .. }
                    | EcmError::SoftLimit { .. }),
                ) => {
                    self.holding.push(slave);
                    refused.get_or_insert(error);
                }
                aimed => aimed.map_err(|error| self.board.explain(error))?,
            }
        }
        let stats = self.stream.step().map_err(|error| self.board.explain(error))?;
        self.gaps.sent(stats.underruns);
        Ok(refused.map(|error| self.board.explain(error)))
    }

    /// Sets the target of an axis. With 16-byte slots one command moves both channels of an HSP (a pulse module), so
    /// the second channel gets its position from before the motion and stays at rest.
    fn aim(&mut self, slave: u8, target: i32) -> Result<(), EcmError> {
        match self.before.slave(slave) {
            Some(ecmsk::ecm::SlaveView::Hsp(hsp)) if self.board.ecm.slot_size()? == SlotSize::Bytes16 => {
                let of = |target| ecmsk::sk::AxisTarget { target, outputs: 0 };
                self.stream.csp_hsp(slave, of(target), of(hsp.second.position))
            }
            _ => self.stream.csp(slave, target),
        }
    }

    /// Brakes the axes. `next` adds the targets of the next cycle and returns whether all axes are at rest with these
    /// targets. An axis that does not take its target does not stop the others. At the end the last targets are
    /// [held](Self::hold).
    ///
    /// If the axes have already stopped because this process was late, braking ends at once: more targets would start
    /// them again.
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn brake(&mut self, mut next: impl FnMut(&mut Vec<(u8, i32)>) -> bool) -> Result<(), BoardError> {
        let (mut targets, underruns) = (Vec::new(), self.gaps.underruns);
        while !self.axes_stand() && self.gaps.underruns <= underruns + BRAKE_GAP_CYCLES {
            targets.clear();
            let are_at_rest = next(&mut targets);
            self.send(targets.iter().copied())?;
            if are_at_rest {
                return self.hold(&targets).map(drop);
            }
        }
        self.board.reporter.note("this process was late, and the axes stood before they were braked");
        Ok(())
    }

    /// Sends the last targets a few more times, so that the drives reach them. Returns the error of the first axis that
    /// does not take its target.
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn hold(&mut self, targets: &[(u8, i32)]) -> Result<Option<BoardError>, BoardError> {
        let mut refused = None;
        for _ in 0..HOLD_FRAMES {
            refused = refused.or(self.send(targets.iter().copied())?);
        }
        Ok(refused)
    }

    /// Ends the motion. Axes that still move hold their last targets; axes that do not follow hold their actual
    /// positions, and a note about them is printed.
    ///
    /// # Errors
    /// As [`Stream::finish`].
    pub fn finish(self) -> Result<StreamStats, BoardError> {
        let finished = self.stream.finish();
        self.board.held_back().into_iter().for_each(|text| self.board.reporter.note(text));
        finished.map_err(|error| self.board.explain(error))
    }
}

/// Detects gaps in a motion: cycles in which the board had no target because this process was late.
struct Gaps {
    /// The longest allowed time between two frames; `None` on a virtual clock, where time waits for this process.
    stall: Option<Duration>,
    /// The cycle time in seconds.
    cycle: f64,
    /// The time at which the latest frame was due.
    newest: Instant,
    /// The number of cycles without a target since the motion began, as far as reports have shown them.
    underruns: u64,
    /// The number of cycles without a target in the present gap.
    gap: u64,
}

impl Gaps {
    const fn new(stall: Option<Duration>, cycle: f64, now: Instant) -> Self {
        Self { stall, cycle, newest: now, underruns: 0, gap: 0 }
    }

    /// Must be called when a frame is due. Returns whether the axes have stopped because there was a long gap before.
    fn axes_stand(&mut self, now: Instant) -> bool {
        let since = now.saturating_duration_since(std::mem::replace(&mut self.newest, now));
        // Reports show a gap only later, so the elapsed time is checked as well.
        let is_long = self.gap as f64 * self.cycle > GAP_MAX.as_secs_f64();
        let stand = is_long || self.stall.is_some_and(|stall| since > stall);
        if stand {
            self.gap = 0;
        }
        stand
    }

    /// Must be called after a frame was sent. `underruns` is the number of cycles without a target since the motion
    /// began.
    fn sent(&mut self, underruns: u64) {
        // A long gap may become known over several frames, so the underruns of all of them are added up. Each frame
        // ends one cycle of the gap, so one is subtracted per frame. So single underruns that are far apart do not add
        // up to a long gap.
        let new = underruns - std::mem::replace(&mut self.underruns, underruns);
        self.gap = (self.gap + new).saturating_sub(1);
    }
}

/// The number of frames that are buffered in the FIFO ahead of their execution.
pub fn depth(network: &Config) -> u16 {
    let frames = AHEAD.as_micros() as u64 / u64::from(network.cycle_us.max(1));
    frames.clamp(*DEPTHS.start(), *DEPTHS.end()) as u16
}

/// How long an internal limit of the drive may keep an axis away from its target before the motion fails, in seconds.
pub fn held_limit_s(depth: u16, cycle: f64) -> f64 {
    HELD_LIMIT.as_secs_f64().max(2.0 * f64::from(depth) * cycle)
}

/// Refuses a velocity, in counts/s, at which the newest target is further ahead of the axis than its `--lead-limit`
/// allows, since the frames between them are buffered in the FIFO. That limit would end the motion.
///
/// # Errors
/// [`BoardError::Refused`].
pub fn check_lead(
    what: &str,
    network: &Config,
    slave: u8,
    axis: &Axis,
    velocity: f64,
    units: Units<'_>,
) -> Result<(), BoardError> {
    let behind = velocity * f64::from(depth(network)) * f64::from(network.cycle_us) * 1e-6;
    match axis.guard {
        Guard::Within(limit) if behind > f64::from(limit) => Err(BoardError::Refused {
            what: what.to_owned(),
            why: format!(
                "at {}/s the target of axis {} runs {} ahead of it, the limit is {}",
                units.way_text(slave, velocity),
                units.label(slave),
                units.way_text(slave, behind),
                units.way_text(slave, limit.into())
            ),
            next: "lower --velocity, or widen --lead-limit".into(),
        }),
        _ => Ok(()),
    }
}

/// The error for a board that has lost a slave during the motion. Reports do not show which slave is lost; some links
/// know it.
pub fn lost(board: &Board, found: StateByte) -> BoardError {
    let slave = board.link_stats().state_failure.and_then(|failure| failure.slave());
    board.explain(EcmError::SlaveLost { slave, found })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE: f64 = 0.001;

    fn ms(time: u64) -> Duration {
        Duration::from_millis(time)
    }

    /// docs/SAFETY.md: after a stall of this process the axes start again from rest. On a virtual clock there is no
    /// stall.
    #[test]
    fn a_process_that_stalls_finds_its_axes_standing() {
        let began = Instant::now();
        let mut gaps = Gaps::new(Some(ms(128)), CYCLE, began);
        assert!(!gaps.axes_stand(began + ms(128)));
        assert!(gaps.axes_stand(began + ms(128 + 129)));
        assert!(!gaps.axes_stand(began + ms(128 + 130)), "it goes on");
        let mut gaps = Gaps::new(None, CYCLE, began);
        assert!(!gaps.axes_stand(began + ms(5000)));
    }

    /// Underruns that become known over several frames add up to a gap; single underruns do not.
    #[test]
    fn underruns_in_a_row_are_a_gap() {
        let now = Instant::now();
        let mut gaps = Gaps::new(None, CYCLE, now);
        for frame in 1..1000 {
            gaps.sent(frame / 2);
            assert!(!gaps.axes_stand(now), "every other cycle");
        }
        let mut gaps = Gaps::new(None, CYCLE, now);
        for frame in 1..=3 {
            assert!(!gaps.axes_stand(now));
            gaps.sent(40 * frame);
        }
        assert!(gaps.axes_stand(now), "117 ms");
        assert!(!gaps.axes_stand(now), "they began from rest");
    }
}
