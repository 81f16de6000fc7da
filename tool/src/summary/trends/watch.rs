//! Processes the frames of a recording, and adds the results to the part of the time to which each frame belongs.

use ecmsk::link::Dir;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, MasterResponse, MasterState, SlaveKind, StateByte};
use ecmsk::summary::{FrameCounts, FrameEvent, FrameWatch, Summary};

use super::homings::HomingFinder;
use super::motions::MotionFinder;
use super::part::Part;
use super::reserve::Reserve;
use crate::motion::{Axes, Quantity, Value};
use crate::plot::series::answers_abort_home;
use crate::recording::Framed;
use crate::summary::extremes::AxisExtremes;

/// Collects the results of a recording. Its frames must be sorted by time.
pub struct Watch {
    frames: Option<FrameWatch>,
    counts: FrameCounts,
    axes: Axes,
    found: Vec<AxisExtremes>,
    motions: Vec<MotionFinder>,
    homings: Vec<HomingFinder>,
    reserve: Reserve,
    summary: Summary,
    last_ns: Option<i64>,
    damage_before: u64,
}

/// The results of a whole recording.
pub struct Whole {
    pub summary: Summary,
    /// The extreme values of each axis that was moved.
    pub axes: Vec<(usize, AxisExtremes)>,
}

impl Watch {
    /// Starts without frames.
    pub fn new() -> Self {
        Self {
            frames: None,
            counts: FrameCounts::default(),
            axes: Axes::new(),
            found: vec![AxisExtremes::default(); MAX_SLAVES],
            motions: vec![MotionFinder::default(); MAX_SLAVES],
            homings: (0..MAX_SLAVES).map(|_| HomingFinder::default()).collect(),
            reserve: Reserve::new(),
            summary: Summary::default(),
            last_ns: None,
            damage_before: 0,
        }
    }

    /// Processes the next frame. `at_ns` is its time since the first frame of the part.
    pub fn frame(&mut self, framed: &Framed, at_ns: i64, part: &mut Part) {
        let (time_ns, frame, size) = (framed.time_ns, &framed.recorded.frame, framed.size);
        self.damage(framed.recorded.damage_before);
        let passed = self.last_ns.replace(time_ns).map_or(0, |last_ns| time_ns.saturating_sub(last_ns));
        part.recorded_ns += u64::try_from(passed).unwrap_or_default();
        let watch = self.frames.get_or_insert_with(|| FrameWatch::new(size));
        watch.damage(framed.recorded.damage_before);
        match framed.recorded.dir {
            Dir::Write => {
                watch.command(time_ns, frame);
                self.axes.frame(framed, &mut |_| {});
                for (slave, homing) in (1..=size.max_slaves()).zip(&mut self.homings) {
                    if CommandId::from_code(frame.slot(size, slave).id) == CommandId::GoHome {
                        homing.ask();
                    }
                }
                if let Some(waiting) = self.reserve.command(time_ns, frame, size) {
                    part.waited(waiting);
                }
            }
            Dir::Read => {
                let summary = &mut self.summary;
                watch.report(time_ns, frame, &mut |event| {
                    summary.add_event(event);
                    match event {
                        FrameEvent::Alarm(_) => part.alarms += 1,
                        FrameEvent::HeldBack(_) => {}
                        // A failure that is reported in OP is a slave that has left OP.
                        FrameEvent::StateFailed(failed) => match StateByte(failed.state).state() {
                            Some(MasterState::Op) => part.lost_slaves += 1,
                            _ => part.states_failed += 1,
                        },
                    }
                });
                self.report(framed, at_ns, part);
            }
        }
        self.count(part);
    }

    /// Forgets unfinished motions and homings before a damaged section of the recording, because their end is unknown.
    fn damage(&mut self, damage_before: u64) {
        if damage_before > self.damage_before {
            self.damage_before = damage_before;
            self.last_ns = None;
            self.motions.fill(MotionFinder::default());
            self.homings.iter_mut().for_each(HomingFinder::interrupt);
            self.reserve = Reserve::new();
        }
    }

    fn report(&mut self, framed: &Framed, at_ns: i64, part: &mut Part) {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        let found = &mut self.found;
        let mut errors = [None; MAX_SLAVES];
        self.axes.frame(framed, &mut |Value { slave, quantity, value, at_ns: value_ns }| {
            let (Some(found), Some(axis)) = (found.get_mut(slave - 1), part.moved(slave)) else { return };
            found.take(quantity, value, value_ns);
            axis.extremes.take(quantity, value, at_ns);
            if quantity == Quantity::FollowingError {
                errors[slave - 1] = Some(value.unsigned_abs());
            }
        });
        let board = MasterResponse::decode(&frame.slot(size, 0));
        self.reserve.report(&board);
        let is_op = board.state.state() == Some(MasterState::Op);
        let is_aborted = is_op && answers_abort_home(frame, size);
        for slave in 1..=size.max_slaves() {
            if !self.axes.is_moved(slave) {
                continue;
            }
            let target = self.axes.target(slave);
            let motion = self.motions[slave - 1].report(framed.time_ns, target, errors[slave - 1]);
            let homing = &mut self.homings[slave - 1];
            // In state 0x18 the slot of a lost slave has old values.
            let homed = if is_op && !board.state.is_failed() && self.axes.kind(slave) != Some(SlaveKind::Io) {
                homing.report(framed.time_ns, &DriveResponse::decode(&frame.slot(size, slave)), is_aborted)
            } else {
                homing.interrupt();
                None
            };
            if motion.is_none() && homed.is_none() {
                continue;
            }
            let Some(axis) = part.moved(slave) else { continue };
            if let Some((way, error)) = motion {
                axis.motions.add(way, error);
            }
            if let Some(homed) = homed {
                axis.homings.add(homed);
            }
        }
    }

    /// Adds the growth of the frame counts since the last call.
    fn count(&mut self, part: &mut Part) {
        let Some(watch) = &self.frames else { return };
        let (before, now) = (std::mem::replace(&mut self.counts, watch.counts()), watch.counts());
        part.full += now.full.saturating_sub(before.full);
        part.crc += now.crc.saturating_sub(before.crc);
        if now.gaps > before.gaps {
            part.gaps += now.gaps - before.gaps;
            part.waited(0);
        }
    }

    /// Ends the reading and returns the results of the whole recording.
    pub fn finish(mut self) -> Whole {
        self.summary.set_frame_counts(&self.counts);
        let axes = (1..).zip(self.found).filter(|(slave, _)| self.axes.is_moved(*slave)).collect();
        Whole { summary: self.summary, axes }
    }
}
