//! Collects the curves of the plot while the recording is read a second time.

use ecmsk::ecm::Scale;
use ecmsk::link::Dir;
use ecmsk::recording::{Execution, ExecutionReport, Kinds, Orders};
use ecmsk::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, FifoAction, Frame, IoResponse, MasterCommand, MasterResponse, SlaveKind,
    SlotCommand, SlotSize,
};

use super::axis::Axis;
use super::decimate::{Line, Pieces};
use super::lanes::{Lane, Lanes};
use super::path::Path;
use super::states::{Span, States};
use super::{Window, survey};
use crate::recording::Framed;

pub use super::axis::AxisLines;

/// The part of the recording that is drawn: the times, the slaves and the commands.
pub struct Subject<'a> {
    /// The range of times that is shown.
    pub window: Window,
    /// The number of pixel columns to which lines are thinned.
    pub columns: u32,
    /// The slave numbers of the axes, each with its scale.
    pub axes: &'a [(u8, Scale)],
    /// The IO slaves.
    pub ios: &'a [u8],
    /// The two axes whose path in the plane is drawn; `None` for no path.
    pub plane: Option<[u8; 2]>,
    /// The address of the board whose frames are drawn, in case a capture has several boards.
    pub board: Option<(u16, u8)>,
    /// The cycle time in nanoseconds.
    pub cycle_ns: i64,
    /// The command ids of `--commands`: an axis is drawn only while its slot has one of these ids. If empty, it is
    /// always drawn.
    pub commands: Vec<u8>,
}

/// The curves of the plot.
pub struct Lines {
    /// The curves of each axis.
    pub axes: Vec<AxisLines>,
    /// The inputs and outputs of each IO slave, by slave number.
    pub ios: Vec<(u8, Vec<Lane>)>,
    /// The path of the two axes of the plane: the commanded path, and the actual one.
    pub plane: Option<[Pieces; 2]>,
    /// The number of free FIFO entries over time.
    pub fifo_free: Pieces,
    /// The times in seconds at which the full count rose, because command frames found the FIFO full and were lost.
    /// Times within one pixel column are merged.
    pub full: Vec<f64>,
    /// The number of reports whose full count (of frames that found the FIFO full) differs from that of the previous
    /// report.
    pub full_reports: u64,
    /// The time spans in which the FIFO was empty while an axis was moving, and those in state 0x18 (OP with a lost
    /// slave).
    pub gaps: Vec<Span>,
}

/// Builds the curves while the frames of a recording are read.
pub struct Series {
    window: Window,
    board: Option<(u16, u8)>,
    axes: Vec<Axis>,
    ios: Vec<(u8, Lanes)>,
    plane: Option<Plane>,
    fifo_free: Line,
    full: Line,
    full_reports: u64,
    full_count: Option<u16>,
    gaps: States,
    in_op: bool,
    /// The time at which state 0x18 began, and the time of the last report with it; `None` in any other state.
    failed_ns: Option<(i64, i64)>,
    kinds: Kinds,
    execution: Execution,
    damage_before: u64,
}

struct Plane {
    /// The indexes in [`Series::axes`] of the two axes whose path is drawn: the horizontal one, the vertical one.
    of: [usize; 2],
    /// The commanded and the actual path.
    paths: [Path; 2],
}

impl Series {
    /// Starts with empty curves, before the first frame.
    pub fn new(subject: &Subject<'_>) -> Self {
        let (window, columns) = (subject.window, subject.columns);
        let axes = subject.axes.iter();
        let place = |axis: u8| subject.axes.iter().position(|(number, _)| *number == axis);
        let plane = subject.plane.and_then(|[x, y]| Some([place(x)?, place(y)?]));
        Self {
            window,
            board: subject.board,
            axes: axes
                .map(|(number, scale)| Axis::new(*number, *scale, window, columns, subject.commands.clone()))
                .collect(),
            ios: subject.ios.iter().map(|number| (*number, Lanes::new(window, columns))).collect(),
            plane: plane.map(|of| Plane { of, paths: Default::default() }),
            fifo_free: Line::new(window, columns),
            full: Line::new(window, columns),
            full_reports: 0,
            full_count: None,
            gaps: States::new(window, columns),
            in_op: false,
            failed_ns: None,
            kinds: Kinds::new(None),
            execution: Execution::new(subject.cycle_ns),
            damage_before: 0,
        }
    }

    /// Adds the next frame; frames are sorted by time.
    pub fn frame(&mut self, framed: &Framed) {
        if self.board.is_some_and(|board| board != framed.board()) {
            return;
        }
        if framed.recorded.damage_before > self.damage_before {
            self.damage_before = framed.recorded.damage_before;
            self.execution.lost();
            self.axes.iter_mut().for_each(|axis| axis.forget_target(framed.time_ns));
        }
        match framed.recorded.dir {
            Dir::Write => self.command(framed),
            Dir::Read if survey::is_op(framed) => self.report(framed),
            Dir::Read => self.outside_op(framed),
        }
    }

    /// Completes the curves and returns them.
    pub fn finish(mut self) -> Lines {
        self.note_failed(self.failed_ns.map_or(0, |(_, last_ns)| last_ns), false);
        Lines {
            axes: self.axes.into_iter().map(Axis::finish).collect(),
            ios: self.ios.into_iter().map(|(number, lanes)| (number, lanes.finish())).collect(),
            plane: self.plane.map(|plane| plane.paths.map(Path::finish)),
            fifo_free: self.fifo_free.finish(),
            full: self.full.finish().into_iter().flatten().map(|(seconds, _)| seconds).collect(),
            full_reports: self.full_reports,
            gaps: self.gaps.finish(),
        }
    }

    fn command(&mut self, framed: &Framed) {
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        self.kinds.command(frame, size);
        if !self.in_op {
            return;
        }
        let slaves = self.axes.iter().map(|axis| axis.number).chain(self.ios.iter().map(|(number, _)| *number));
        let command = |(place, number): (usize, u8)| {
            let slot = SlotCommand::decode(&frame.slot(size, number.into()), size).ok()?;
            Some((place, slot.command))
        };
        let orders: Orders = slaves.enumerate().filter_map(command).collect();
        for (place, order) in &orders {
            if let Some(axis) = self.axes.get_mut(*place) {
                axis.sent(order);
            }
        }
        let master = MasterCommand::decode(&frame.slot(size, 0), size);
        self.execution.command(at_ns, orders, master == Ok(MasterCommand::SetFifo(FifoAction::Clear)));
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
        let failed = master.state.is_failed();
        self.note_failed(at_ns, failed);
        for axis in &mut self.axes {
            axis.look(at_ns, &frame.slot(size, axis.number.into()), failed);
        }
        let certain = self.execute(at_ns, &master);
        let aborted = answers_abort_home(frame, size);
        for axis in &mut self.axes {
            let number = usize::from(axis.number);
            let drive = DriveResponse::decode(&frame.slot(size, number));
            // Only a drive has a torque and an error code. An HSP has its inputs where a drive has the torque, and has
            // no error code.
            let is_drive = self.kinds.of(number) != Some(SlaveKind::Hsp);
            axis.report(at_ns, &drive, aborted, is_drive, certain);
        }
        for (number, lanes) in &mut self.ios {
            lanes.report(at_ns, &IoResponse::decode(&frame.slot(size, usize::from(*number))));
        }
        if let Some(Plane { of, paths }) = self.plane.as_mut().filter(|_| self.window.contains(at_ns)) {
            let [x, y] = of.map(|place| &self.axes[place]);
            for (path, point) in paths.iter_mut().zip([x.commanded().zip(y.commanded()), x.stands().zip(y.stands())]) {
                match point {
                    Some(point) => path.push(point),
                    None => path.interrupt(),
                }
            }
        }
    }

    /// Processes from a report in OP whether the board is in state 0x18 (OP with a lost slave).
    fn note_failed(&mut self, at_ns: i64, failed: bool) {
        match (failed, self.failed_ns) {
            (true, since) => self.failed_ns = Some((since.map_or(at_ns, |(since_ns, _)| since_ns), at_ns)),
            (false, Some((since_ns, _))) => {
                self.gaps.failed(since_ns, at_ns);
                self.failed_ns = None;
            }
            (false, None) => {}
        }
    }

    /// Draws the commands that were executed up to this report. Returns false if it is not yet known which commands
    /// were executed.
    fn execute(&mut self, at_ns: i64, master: &MasterResponse) -> bool {
        let (entries, idle_since_ns) = match self.execution.report(at_ns, master) {
            ExecutionReport::Executed { entries, idle_since_ns } => (entries, idle_since_ns),
            ExecutionReport::Later => return false,
            ExecutionReport::Unknown => {
                self.axes.iter_mut().for_each(|axis| axis.forget_target(at_ns));
                return true;
            }
        };
        if let Some(idle_since_ns) = idle_since_ns {
            self.axes.iter_mut().for_each(|axis| axis.idle(idle_since_ns));
        }
        for entry in entries {
            for (place, order) in &entry.orders {
                let Some(axis) = self.axes.get_mut(*place) else {
                    self.ios[place - self.axes.len()].1.executed(entry.at_ns, order);
                    continue;
                };
                if let Some(since_ns) = axis.executed(entry.at_ns, order) {
                    self.gaps.gap(since_ns, entry.at_ns);
                }
            }
        }
        true
    }

    fn outside_op(&mut self, framed: &Framed) {
        self.kinds.response(&framed.recorded.frame, framed.size);
        if !std::mem::replace(&mut self.in_op, false) {
            return;
        }
        let at_ns = framed.time_ns;
        self.note_failed(at_ns, false);
        self.fifo_free.interrupt(at_ns);
        self.execution.reset();
        self.axes.iter_mut().for_each(|axis| axis.interrupt(at_ns));
        self.ios.iter_mut().for_each(|(_, lanes)| lanes.interrupt(at_ns));
        if let Some(plane) = &mut self.plane {
            plane.paths.iter_mut().for_each(Path::interrupt);
        }
    }
}

impl Lines {
    /// Whether nothing of any slave is drawn.
    pub fn is_empty(&self) -> bool {
        self.axes.iter().all(AxisLines::is_empty) && self.ios.iter().all(|(_, lanes)| lanes.is_empty())
    }
}

/// Whether any slot of a report answers ABORT_HOME, which ends the homing of all slaves.
pub fn answers_abort_home(frame: &Frame, size: SlotSize) -> bool {
    (1..=size.max_slaves()).any(|n| CommandId::from_code(frame.slot(size, n).id) == CommandId::AbortHome)
}
