//! Finds in the frames of a running program what a flight recorder keeps: alarms, axes that their drives hold back, lost
//! slaves, changes of state that failed, gaps in the reports, following errors beyond a limit.

use super::line::{Alarm, HeldBack};
use super::watch::{FrameEvent, FrameWatch};
use crate::link::Dir;
use crate::link::record::flight::{FlightWatch, Kind};
use crate::recording::{ExecutionReport, RunExecution, SizeFinder};
use crate::sk::dump::MAX_SLAVES;
use crate::sk::{
    CommandId, DriveResponse, FRAME_LEN, Frame, MasterResponse, MasterState, SlaveCommand, SlotSize, StateByte,
    TargetEffect,
};

/// A pause between two reports in OP can be a gap only if it is longer than this, ns. \[OURS]
const GAP_MIN_NS: u64 = 100_000_000;
/// A gap must also be longer than the longest of the last intervals between reports by this factor, since a program may
/// read rarely. \[OURS]
const GAP_TIMES: u64 = 10;
/// The number of intervals between the last reports that a gap is compared with. \[OURS]
const DISTANCES: usize = 8;

/// Finds the events of a flight recorder in the frames of a running program. Frames have to come in the order of their
/// times; only frames that a thread passes on late may be out of order.
pub struct FlightEvents {
    finder: SizeFinder,
    size: SlotSize,
    frames: FrameWatch,
    reports: Reports,
    axes: Option<Following>,
}

impl FlightEvents {
    /// `slot` is the slot size, if the link knows it; otherwise it is found from the frames. A following error of more
    /// than `following_error` counts is an event; with `None` following errors are not watched.
    pub fn new(slot: Option<SlotSize>, following_error: Option<u32>) -> Self {
        let size = slot.unwrap_or_default();
        Self {
            finder: SizeFinder::new(slot),
            size,
            frames: FrameWatch::new(size),
            reports: Reports::default(),
            axes: following_error.map(Following::new),
        }
    }

    /// Finds the slot size from the frames. If it differs from the one assumed so far, the watch starts again with the
    /// new size.
    fn look_at_size(&mut self, frame: &Frame) {
        if self.finder.given().is_some() {
            return;
        }
        self.finder.look(frame, FRAME_LEN);
        let (size, _) = self.finder.size();
        if size != self.size {
            self.size = size;
            self.frames = FrameWatch::new(size);
            self.axes = self.axes.take().map(|axes| Following::new(axes.limit));
        }
    }
}

impl FlightWatch for FlightEvents {
    fn frame(&mut self, dir: Dir, at_ns: u64, frame: &Frame, found: &mut dyn FnMut(Kind, String)) {
        self.look_at_size(frame);
        let (at, size) = (i64::try_from(at_ns).unwrap_or(i64::MAX), self.size);
        if dir == Dir::Write {
            self.frames.command(at, frame);
            if let Some(axes) = &mut self.axes {
                axes.run.command(at, frame, size);
            }
            return;
        }
        self.frames.report(at, frame, &mut |event| match event {
            // The flight recorder adds the time of the event itself.
            FrameEvent::Alarm(alarm) => found(Kind::Alarm, Alarm { at_ns: None, ..alarm }.to_string()),
            FrameEvent::HeldBack(held) => found(Kind::HeldBack, HeldBack { at_ns: None, ..held }.to_string()),
            FrameEvent::StateFailed(failed) => {
                // A failed change of state ends below OP. A failure that is shown in OP means that a slave has left OP.
                let is_lost = StateByte(failed.state).state() == Some(MasterState::Op);
                found(if is_lost { Kind::LostSlave } else { Kind::State }, failed.to_string());
            }
        });
        let board = MasterResponse::decode(&frame.slot(size, 0));
        if let Some(silence_ns) = self.reports.report(at_ns, board.state) {
            found(Kind::Gap, format!("no report for {:.3} s", silence_ns as f64 / 1e9));
        }
        if let Some(axes) = &mut self.axes {
            axes.report(at, frame, size, found);
        }
    }

    fn missed(&mut self) {
        self.reports = Reports::default();
        self.axes = self.axes.take().map(|axes| Following::new(axes.limit));
    }
}

/// The intervals between reports in OP.
#[derive(Default)]
struct Reports {
    last_ns: Option<u64>,
    distances: [u64; DISTANCES],
    next: usize,
}

impl Reports {
    /// Processes the next report. Returns the interval since the previous report, ns, if it is a gap.
    fn report(&mut self, at_ns: u64, state: StateByte) -> Option<u64> {
        if state.state() != Some(MasterState::Op) {
            *self = Self::default();
            return None;
        }
        let distance = at_ns.saturating_sub(self.last_ns.replace(at_ns)?);
        let usual = self.distances.iter().copied().max().unwrap_or(0);
        let is_known = self.distances.iter().all(|distance| *distance > 0);
        self.distances[self.next] = distance;
        self.next = (self.next + 1) % DISTANCES;
        (is_known && distance > GAP_MIN_NS.max(usual.saturating_mul(GAP_TIMES))).then_some(distance)
    }
}

/// Watches the following errors of all axes.
struct Following {
    limit: u32,
    run: RunExecution,
    axes: [Axis; MAX_SLAVES],
}

#[derive(Clone, Copy, Default)]
struct Axis {
    /// The target of the CSP command that was executed last; `None` once another command has ended it.
    target: Option<i32>,
    /// Whether the following error is beyond the limit.
    is_beyond: bool,
}

impl Axis {
    fn executed(&mut self, order: &SlaveCommand) {
        match order {
            SlaveCommand::Csp(motion) => self.target = Some(motion.first.target),
            _ if order.id().target_effect() == TargetEffect::Keeps => {}
            _ => self.target = None,
        }
    }
}

impl Following {
    fn new(limit: u32) -> Self {
        Self { limit, run: RunExecution::new(), axes: [Axis::default(); MAX_SLAVES] }
    }

    fn report(&mut self, at_ns: i64, frame: &Frame, size: SlotSize, found: &mut dyn FnMut(Kind, String)) {
        match self.run.report(at_ns, frame, size) {
            Some(ExecutionReport::Executed { entries, .. }) => {
                for entry in &entries {
                    for (slave, order) in &entry.orders {
                        self.axes[slave - 1].executed(order);
                    }
                }
            }
            Some(ExecutionReport::Later) => return,
            Some(ExecutionReport::Unknown) | None => {
                self.axes = [Axis::default(); MAX_SLAVES];
                return;
            }
        }
        for (slave, axis) in (1..=size.max_slaves()).zip(&mut self.axes) {
            let Some(target) = axis.target else { continue };
            let drive = DriveResponse::decode(&frame.slot(size, slave));
            // Homing moves the zero of the position, so the target is not comparable any more.
            if CommandId::from_code(drive.head.id) == CommandId::GoHome || !drive.statusword.is_enabled() {
                *axis = Axis::default();
                continue;
            }
            // On an axis that turns without end the 32-bit position wraps around.
            let error = target.wrapping_sub(drive.position).unsigned_abs();
            let was_beyond = std::mem::replace(&mut axis.is_beyond, error > self.limit);
            if axis.is_beyond && !was_beyond {
                found(Kind::FollowingError, format!("slave {slave} is {error} counts from its target {target}"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ethercat::cia402::Statusword;
    use crate::sk::{FIFO_ENTRIES, Motion, SlaveResponse};

    const MS: u64 = 1_000_000;

    /// The events of reports in OP at these times.
    fn events(times: impl IntoIterator<Item = u64>) -> Vec<String> {
        let mut watch = FlightEvents::new(Some(SlotSize::Bytes12), None);
        let mut found = Vec::new();
        let mut report = Frame::new();
        report.bytes_mut()[2] = StateByte::reached(MasterState::Op).0;
        for at_ns in times {
            watch.frame(Dir::Read, at_ns, &report, &mut |kind, text| {
                assert_eq!(kind, Kind::Gap);
                found.push(text);
            });
        }
        found
    }

    /// A gap is longer than 100 ms, and long in comparison with the program's usual intervals between reports.
    #[test]
    fn a_gap_is_long_for_its_program() {
        let every = |from: u64, ms: u64| (0..20).map(move |number| (from + number * ms) * MS);
        assert_eq!(events(every(0, 1).chain(every(119, 1))), [""; 0]);
        assert_eq!(events(every(0, 1).chain(every(120, 1))), ["no report for 0.101 s"]);
        assert_eq!(events(every(0, 500)), [""; 0]);
        assert_eq!(events(every(0, 500).chain(every(14_000, 500))), [""; 0]);
        assert_eq!(events(every(0, 500).chain(every(15_000, 500))), ["no report for 5.500 s"]);
        // As long as few reports have come, the program's usual interval is not known, and nothing counts as a gap.
        assert_eq!(events([0, 1000 * MS, 3000 * MS]), [""; 0]);
    }

    /// A following error is the shorter distance between target and position, also where positions wrap around.
    #[test]
    fn a_following_error_past_the_largest_position() {
        const SIZE: SlotSize = SlotSize::Bytes12;
        for (position, says) in
            [(i32::MAX - 5, None), (i32::MAX - 5000, Some("slave 1 is 5006 counts from its target"))]
        {
            let mut watch = FlightEvents::new(Some(SIZE), Some(1000));
            let state = StateByte::reached(MasterState::Op);
            let board = MasterResponse { state, fifo_free: FIFO_ENTRIES, ..MasterResponse::default() };
            let (mut command, mut report) = (Frame::new(), Frame::new());
            command.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(i32::MIN + 5)).into());
            report.put(SIZE, 0, &board.encode());
            let head = SlaveResponse { id: 0x15, index: 0 };
            let drive = DriveResponse { head, statusword: Statusword(0x1637), position, ..DriveResponse::default() };
            report.put(SIZE, 1, &drive.encode());
            let mut found = Vec::new();
            for (at_ms, dir) in [(1, Dir::Read), (2, Dir::Write), (3, Dir::Read)] {
                let frame = if dir == Dir::Write { &command } else { &report };
                watch.frame(dir, at_ms * MS, frame, &mut |_, text| found.push(text));
            }
            assert_eq!(found.len(), usize::from(says.is_some()), "{found:?}");
            assert!(says.is_none_or(|says| found[0].starts_with(says)), "{found:?}");
        }
    }
}
