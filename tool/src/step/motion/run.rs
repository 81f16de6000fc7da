//! Sends the frames of a move along its path, and brakes if the move must end early.

use std::time::Duration;

use ecmsk::ecm::{Snapshot, StreamStats};
use serde_json::json;

use super::super::frames::{BRAKE_LIMIT, Frames, lost};
use super::super::profile::{PathPoint, Profile};
use super::internal_limit::{self, Watched};
use super::path::{AxisPath, Path};
use super::{WHAT, refused};
use crate::board::{Board, BoardError};

/// How the motion along a path has ended, with its duration in seconds.
pub enum Ended {
    /// The last targets were sent to all axes, or the motion was braked after Ctrl-C. After Ctrl-C, [`Run::go`] returns
    /// an error and not this value.
    Arrived(f64),
    /// The FIFO was empty for too long, so the axes have stopped. The second value is the fraction of the path that
    /// they have covered, 0 to 1.
    Stood(f64, f64),
}

/// The motion along one path.
pub struct Run<'a> {
    pub board: &'a Board,
    pub path: &'a Path,
    /// Whether the board had already lost a slave before the move. If so, a lost slave does not end the move.
    pub lost_before: bool,
    /// The cycle time in seconds.
    pub cycle: f64,
    /// How long an internal limit of a drive may keep an axis away from its target before the move fails, in seconds.
    pub held_limit_s: f64,
}

impl Run<'_> {
    /// Sends one target per cycle until all axes have arrived, or until a gap has stopped the axes. Returns how the
    /// motion ended, and the counters of the stream.
    pub fn go(&self, mut frames: Frames<'_>) -> Result<(Ended, StreamStats), BoardError> {
        let stepped = self.steps(&mut frames);
        // `finish` brakes axes that are still moving, also after an error.
        let finished = frames.finish();
        let ended = stepped?;
        self.board.check_stop()?;
        Ok((ended, finished?))
    }

    fn steps(&self, frames: &mut Frames<'_>) -> Result<Ended, BoardError> {
        let Some(profile) = &self.path.profile else { return Ok(Ended::Arrived(0.0)) };
        let mut pace = self.board.reporter.pace();
        let mut last = PathPoint::default();
        let mut watched: Vec<Watched> = self.path.axes.iter().map(|axis| Watched::new(axis.slave)).collect();
        for frame in 1_u64.. {
            let time = frame as f64 * self.cycle;
            // This check comes first: otherwise braking would begin at the commanded speed and start axes that have
            // stopped.
            if frames.axes_stand() {
                return Ok(Ended::Stood(time - self.cycle, last.length / self.path.length));
            }
            if self.board.interrupt.signal().is_some() {
                self.brake(frames, last)?;
                return Ok(Ended::Arrived(time));
            }
            let now = frames.stream.snapshot().map_err(|error| self.board.explain(error))?;
            if now.state().is_failed() && !self.lost_before {
                return Err(self.braked(frames, last, lost(self.board, now.state())));
            }
            if let Some((slave, at)) = self.held_axis(&now, &mut watched, last, time) {
                let (axis, at) = (self.board.label(slave), self.board.in_units(slave, at).0);
                let why = format!("axis {axis} stands at {at}: {}", internal_limit::WHY);
                return Err(self.braked(frames, last, refused(why, internal_limit::NEXT)));
            }
            last = profile.at(time);
            let (done, part) = (time >= profile.seconds(), last.length / self.path.length);
            let target = |axis: &AxisPath| (axis.slave, if done { axis.end } else { axis.at(part) });
            let refused = frames.send(self.path.axes.iter().map(target))?;
            if done {
                let ends: Vec<(u8, i32)> = self.path.axes.iter().map(target).collect();
                return refused.or(frames.hold(&ends)?).map_or(Ok(Ended::Arrived(time)), Err);
            }
            if let Some(error) = refused {
                return Err(self.braked(frames, last, error));
            }
            if pace.due(Duration::from_secs_f64(time)) {
                let (all, part) = (profile.seconds(), time / profile.seconds());
                let text = format!("moving, {:.0} %, {time:.1} of {all:.1} s", part * 100.0);
                self.board.reporter.part(part, text, || json!({"verb": WHAT, "progress": part, "seconds": time}))?;
            }
        }
        Ok(Ended::Arrived(0.0))
    }

    /// The first axis that an internal limit of its drive has kept away from its target for too long, with its
    /// position; `None` if there is no such axis.
    fn held_axis(&self, now: &Snapshot, watched: &mut [Watched], last: PathPoint, time: f64) -> Option<(u8, i32)> {
        for (axis, watched) in self.path.axes.iter().zip(watched) {
            let target = axis.at(last.length / self.path.length);
            if watched.held_for(self.board, now, target, time) >= self.held_limit_s {
                return Some((axis.slave, now.position(axis.slave).unwrap_or_default()));
            }
        }
        None
    }

    /// Brakes along the path. `last` is the point of the path whose targets were sent last.
    fn brake(&self, frames: &mut Frames<'_>, last: PathPoint) -> Result<(), BoardError> {
        let brake = Profile::to_rest(last, self.path.limits, BRAKE_LIMIT);
        let brake = brake.map_err(|why| refused(why, "the axes hold their last targets"))?;
        let mut time = 0.0;
        frames.brake(|targets| {
            time += self.cycle;
            let part = brake.at(time).length / self.path.length;
            targets.extend(self.path.axes.iter().map(|axis| (axis.slave, axis.at(part))));
            time >= brake.seconds()
        })
    }

    /// Brakes because of an error, and returns that error.
    fn braked(&self, frames: &mut Frames<'_>, last: PathPoint, error: BoardError) -> BoardError {
        // If braking fails, the axes hold their last targets. Its error is ignored, since the first error says more.
        let _ = self.brake(frames, last);
        error
    }
}
