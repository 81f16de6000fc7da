//! The events of a run within a range of times: alarms, failed state changes, gaps and lost frames.

use ecmsk::link::Dir;
use ecmsk::summary::{Alarm, FrameCounts, FrameEvent, FrameWatch, Summary};

use crate::filter::Times;
use crate::recording::Framed;

/// \[OURS] The largest number of moments that are kept; a page shows fewer.
const MOMENTS_MAX: usize = 1000;

/// A moment at which something went wrong: an alarm or a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Time of the recording in nanoseconds.
    pub at_ns: i64,
    /// The alarm that begins at this time; `None` if a gap in a motion ends.
    pub alarm: Option<Alarm>,
}

/// Finds the events of a run in its frames, which must be sorted by time. All frames are used to follow the state of
/// the board and its slaves, but only events within the times are in the summary.
pub struct Events {
    times: Times,
    watch: Option<FrameWatch>,
    summary: Summary,
    /// The counts of all frames before the times, and of all frames up to the end of the times.
    counts: [FrameCounts; 2],
    /// The first alarms and gaps.
    moments: Vec<Moment>,
    /// Whether there are frames within the times. The next field: whether there are frames after them.
    is_any: bool,
    goes_on: bool,
}

impl Events {
    /// Starts without frames. Only events within `times` will be in the summary.
    pub fn new(times: Times) -> Self {
        Self {
            times,
            watch: None,
            summary: Summary::default(),
            counts: Default::default(),
            moments: Vec::new(),
            is_any: false,
            goes_on: false,
        }
    }

    /// Processes the next frame.
    pub fn frame(&mut self, framed: &Framed) {
        let (at_ns, frame, times) = (framed.time_ns, &framed.recorded.frame, self.times);
        let watch = self.watch.get_or_insert_with(|| FrameWatch::new(framed.size));
        watch.damage(framed.recorded.damage_before);
        let gaps = watch.counts().gaps;
        let mut alarms = Vec::new();
        match framed.recorded.dir {
            Dir::Write => watch.command(at_ns, frame),
            Dir::Read => watch.report(at_ns, frame, &mut |event| {
                if times.contains(at_ns) {
                    self.summary.add_event(event);
                }
                if let FrameEvent::Alarm(alarm) = event {
                    alarms.push(Some(alarm));
                }
            }),
        }
        if watch.counts().gaps > gaps {
            alarms.push(None);
        }
        if times.contains(at_ns) {
            let room = MOMENTS_MAX.saturating_sub(self.moments.len());
            self.moments.extend(alarms.into_iter().take(room).map(|alarm| Moment { at_ns, alarm }));
        }
        match (times.begin_after(at_ns), times.contains(at_ns)) {
            (true, _) => self.counts = [watch.counts(); 2],
            (false, true) => (self.counts[1], self.is_any) = (watch.counts(), true),
            (false, false) => self.goes_on = true,
        }
    }

    /// The first alarms and gaps, sorted by time.
    pub fn moments(&self) -> &[Moment] {
        &self.moments
    }

    /// Whether there is a frame within the times.
    pub const fn is_any(&self) -> bool {
        self.is_any
    }

    /// The summary of the events within the times. `has_end`: the recording has all frames up to the end of the run.
    pub fn summary(&self, has_end: bool) -> Summary {
        let [before, counts] = self.counts;
        let mut summary = self.summary.clone();
        summary.set_frame_counts(&FrameCounts {
            commands: counts.commands - before.commands,
            reports: counts.reports - before.reports,
            full: counts.full - before.full,
            crc: counts.crc - before.crc,
            gaps: counts.gaps - before.gaps,
            // An unreached state counts only if the program has given up. This is unknown if it went on after the
            // times, or if the end of the recording is missing.
            unreached: counts.unreached.filter(|_| !self.goes_on && has_end),
        });
        summary
    }
}
