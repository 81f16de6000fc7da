//! The second look at a recording: the lines of the plot.

use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, SlaveCommand, SlaveKind,
    SlotCommand, SlotSize,
};

use super::decimate::Line;
use super::follow::{Follow, InForce, Targets};
use super::states::{Span, States};
use super::{Window, style, survey};
use crate::cli::recording::Framed;

/// Columns of pixels that a line is thinned to: the width of a diagram.
const COLUMNS: u32 = style::WIDTH - style::LEFT - style::RIGHT;

/// A line in pieces, seconds and values.
pub type Pieces = Vec<Vec<(f64, f64)>>;

/// What there is to draw.
pub struct Lines {
    /// One for each axis.
    pub axes: Vec<AxisLines>,
    /// Free entries of the FIFO.
    pub fifo_free: Pieces,
    /// When the full count went up, seconds; near ones are one.
    pub full: Vec<f64>,
    /// Reports with a higher full count than the one before.
    pub full_reports: u64,
    /// Whether the differences were asked for.
    pub with_difference: bool,
}

/// The lines of one axis.
pub struct AxisLines {
    /// Slave.
    pub axis: u8,
    /// Counts, as sent.
    pub target: Pieces,
    /// Counts.
    pub position: Pieces,
    /// Counts: the target executed minus the position, while the drive follows it.
    pub difference: Pieces,
    /// As the drive scales it.
    pub target_velocity: Pieces,
    /// Percent of rated, as sent.
    pub target_torque: Pieces,
    /// Percent of rated.
    pub torque: Pieces,
    /// When the drive was not just enabled.
    pub states: Vec<Span>,
}

impl AxisLines {
    /// Whether nothing of the axis is drawn.
    pub fn is_empty(&self) -> bool {
        let lines = [&self.target, &self.position, &self.target_velocity, &self.target_torque, &self.torque];
        lines.iter().all(|line| line.is_empty())
    }
}

/// The lines under construction.
pub struct Series {
    window: Window,
    board: Option<(u16, u8)>,
    axes: Vec<Axis>,
    /// Ids of the commands shown; empty: all.
    commands: Vec<u8>,
    fifo_free: Line,
    full: Line,
    full_reports: u64,
    full_count: Option<u16>,
    in_op: bool,
    kinds: Kinds,
    follow: Option<Follow>,
}

struct Axis {
    number: u8,
    target: Line,
    position: Line,
    difference: Line,
    target_velocity: Line,
    target_torque: Line,
    torque: Line,
    states: States,
}

impl Series {
    /// Lines across `window` of these slaves of that board. `cycle_ns`: its cycle, for the differences, if they are wanted.
    pub fn new(window: Window, axes: &[u8], board: Option<(u16, u8)>, cycle_ns: Option<i64>) -> Self {
        let line = || Line::new(window, COLUMNS);
        let held = || Line::holding(window, COLUMNS);
        let axis = |number: &u8| Axis {
            number: *number,
            target: held(),
            position: line(),
            difference: line(),
            target_velocity: held(),
            target_torque: held(),
            torque: line(),
            states: States::new(window, COLUMNS),
        };
        Self {
            window,
            board,
            axes: axes.iter().map(axis).collect(),
            commands: Vec::new(),
            fifo_free: line(),
            full: line(),
            full_reports: 0,
            full_count: None,
            in_op: false,
            kinds: Kinds::new(None),
            follow: cycle_ns.map(Follow::new),
        }
    }

    /// Shows an axis only where its slot asks for or answers a command with one of these ids; none: always.
    pub fn only(self, commands: Vec<u8>) -> Self {
        Self { commands, ..self }
    }

    /// The next frame, in the order of time.
    pub fn frame(&mut self, framed: &Framed) {
        if self.board.is_some_and(|board| board != framed.board()) {
            return;
        }
        match framed.recorded.dir {
            Dir::Write => self.command(framed),
            Dir::Read if survey::is_op(framed) => self.report(framed),
            Dir::Read => self.outside_op(framed),
        }
    }

    /// The lines.
    pub fn finish(self) -> Lines {
        let axis = |axis: Axis| AxisLines {
            axis: axis.number,
            target: axis.target.finish(),
            position: axis.position.finish(),
            difference: axis.difference.finish(),
            target_velocity: axis.target_velocity.finish(),
            target_torque: axis.target_torque.finish(),
            torque: axis.torque.finish(),
            states: axis.states.finish(),
        };
        Lines {
            axes: self.axes.into_iter().map(axis).collect(),
            fifo_free: self.fifo_free.finish(),
            full: self.full.finish().into_iter().flatten().map(|(seconds, _)| seconds).collect(),
            full_reports: self.full_reports,
            with_difference: self.follow.is_some(),
        }
    }

    fn command(&mut self, framed: &Framed) {
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        self.kinds.command(frame, size);
        if !self.in_op {
            return;
        }
        let mut targets = Targets::default();
        for (axis, target) in self.axes.iter_mut().zip(&mut targets) {
            let slot = frame.slot(size, axis.number.into());
            let shown = self.commands.is_empty() || self.commands.contains(&slot.id);
            match SlotCommand::decode(&slot, size).map(|slot| slot.command) {
                Ok(SlaveCommand::Csp(motion)) => {
                    *target = Some(motion.first.target);
                    if shown {
                        axis.target.push(at_ns, motion.first.target.into());
                    }
                }
                Ok(SlaveCommand::GoHome) => axis.states.go_home(),
                Ok(_) if !shown => {}
                Ok(SlaveCommand::Csv(motion)) => axis.target_velocity.push(at_ns, motion.first.target.into()),
                Ok(SlaveCommand::Cst(torque)) => axis.target_torque.push(at_ns, percent(torque)),
                _ => {}
            }
        }
        if let Some(follow) = &mut self.follow {
            let master = MasterCommand::decode(&frame.slot(size, 0), size);
            follow.command(&targets, master == Ok(MasterCommand::SetFifo(FifoAction::Clear)));
        }
    }

    fn report(&mut self, framed: &Framed) {
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        self.kinds.response(frame, size);
        self.in_op = true;
        let master = MasterResponse::decode(&frame.slot(size, 0));
        self.fifo_free.push(at_ns, master.fifo_free.min(FIFO_ENTRIES).into());
        if self.full_count.replace(master.full_count).is_some_and(|before| before != master.full_count) {
            self.full_reports += u64::from(self.window.contains(at_ns));
            self.full.push(at_ns, 0.0);
        }
        let follow = self.follow.as_mut();
        let in_force = follow.map_or(InForce::Unknown, |follow| follow.report(at_ns, &master));
        let aborted = answers_abort_home(frame, size);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let number = usize::from(axis.number);
            let drive = DriveResponse::decode(&frame.slot(size, number));
            let shown = self.commands.is_empty() || self.commands.contains(&drive.head.id);
            if shown {
                axis.position.push(at_ns, drive.position.into());
            } else {
                // Not a line from before to after.
                let lines = [&mut axis.position, &mut axis.torque, &mut axis.difference];
                lines.into_iter().for_each(|line| line.interrupt(at_ns));
            }
            // An HSP has its inputs in the place of torque, and no error code.
            let is_drive = self.kinds.of(number) != Some(SlaveKind::Hsp);
            if axis.states.report(at_ns, &drive, aborted, is_drive) {
                // What was sent before is not in force any more.
                let targets = [&mut axis.target, &mut axis.target_velocity, &mut axis.target_torque];
                targets.into_iter().for_each(|line| line.interrupt(at_ns));
            }
            if is_drive && shown {
                axis.torque.push(at_ns, percent(drive.torque));
            }
            if !shown {
                continue;
            }
            let target = match in_force {
                InForce::Known(targets) => targets[i].filter(|_| drive.statusword.is_enabled()),
                InForce::Doubtful => continue,
                InForce::Unknown => None,
            };
            match target {
                Some(target) => axis.difference.push(at_ns, f64::from(target) - f64::from(drive.position)),
                None => axis.difference.interrupt(at_ns),
            }
        }
    }

    fn outside_op(&mut self, framed: &Framed) {
        self.kinds.response(&framed.recorded.frame, framed.size);
        if !std::mem::replace(&mut self.in_op, false) {
            return;
        }
        let at_ns = framed.time_ns;
        self.fifo_free.interrupt(at_ns);
        if let Some(follow) = &mut self.follow {
            follow.reset();
        }
        for axis in &mut self.axes {
            let lines = [&mut axis.target, &mut axis.position, &mut axis.difference];
            let more = [&mut axis.target_velocity, &mut axis.target_torque, &mut axis.torque];
            lines.into_iter().chain(more).for_each(|line| line.interrupt(at_ns));
            axis.states.interrupt(at_ns);
        }
    }
}

/// Whether a report answers ABORT_HOME, which ends homing of all slaves in whatever slot it was.
fn answers_abort_home(frame: &Frame, size: SlotSize) -> bool {
    (1..=size.max_slaves()).any(|n| CommandId::from_code(frame.slot(size, n).id) == CommandId::AbortHome)
}

/// From 0.1 % of rated.
fn percent(torque: i16) -> f64 {
    f64::from(torque) / 10.0
}
