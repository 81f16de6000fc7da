//! Follows a recorded run frame by frame: what each axis did in OP, as columns, and what went wrong.

use ecmsk::link::Dir;
use ecmsk::recording::{Entry, ExecutionReport, RunExecution};
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, Frame, SlaveCommand, SlaveKind, SlotSize, TargetEffect};
use ecmsk::summary::{FrameWatch, Summary};

/// What an axis did, one value for each report in OP.
#[derive(Default)]
pub struct Columns {
    pub time_ns: Vec<i64>,
    pub position: Vec<i32>,
    pub torque: Vec<i16>,
    pub statusword: Vec<u16>,
    pub error_code: Vec<u16>,
    /// The executed target, counts; NaN while none is in force.
    pub target: Vec<f64>,
    /// The target of the last CSP command, counts. `None`: none is in force, because there was no such command, another command
    /// for axes came after it, or the axis is off or was homed.
    in_force: Option<i32>,
    /// Whether a command for axes was sent to the slave. It then counts as an axis even if the recording has no SET_AXIS
    /// for it.
    is_axis: bool,
}

impl Columns {
    fn executed(&mut self, order: &SlaveCommand) {
        match order {
            SlaveCommand::Csp(motion) => {
                self.is_axis = true;
                self.in_force = Some(motion.first.target);
            }
            _ if order.id().target_effect() == TargetEffect::Keeps => {}
            order => {
                self.is_axis |= order.id().is_for_axes();
                self.in_force = None;
            }
        }
    }

    fn report(&mut self, at_ns: i64, drive: &DriveResponse, is_hsp: bool, is_certain: bool) {
        // No target is in force after homing, which moves the zero of the position, and while the axis is off, since it
        // does not follow.
        if CommandId::from_code(drive.head.id) == CommandId::GoHome || !drive.statusword.is_enabled() {
            self.in_force = None;
        }
        self.time_ns.push(at_ns);
        self.position.push(drive.position);
        self.statusword.push(drive.statusword.0);
        // In the report of a pulse module inputs are in the place of torque and error code, so these columns get 0.
        self.torque.push(if is_hsp { 0 } else { drive.torque });
        self.error_code.push(if is_hsp { 0 } else { drive.error_code });
        self.target.push(self.in_force.filter(|_| is_certain).map_or(f64::NAN, f64::from));
    }
}

/// Follows a run frame by frame, in the order of time.
pub struct Reader {
    pub axes: Vec<Columns>,
    run: RunExecution,
    pub watch: FrameWatch,
    pub summary: Summary,
    size: SlotSize,
    pub last_ns: i64,
}

impl Reader {
    pub fn new(size: SlotSize) -> Self {
        Self {
            axes: (0..MAX_SLAVES).map(|_| Columns::default()).collect(),
            run: RunExecution::new(),
            watch: FrameWatch::new(size),
            summary: Summary::default(),
            size,
            last_ns: 0,
        }
    }

    /// Adds the next frame. `damage_before`: see `Recorded`.
    pub fn frame(&mut self, at_ns: i64, damage_before: u64, dir: Dir, frame: &Frame) {
        self.watch.damage(damage_before);
        if self.run.damage(damage_before) {
            self.axes.iter_mut().for_each(|axis| axis.in_force = None);
        }
        self.last_ns = self.last_ns.max(at_ns);
        match dir {
            Dir::Write => {
                self.watch.command(at_ns, frame);
                self.run.command(at_ns, frame, self.size);
            }
            Dir::Read => {
                let summary = &mut self.summary;
                self.watch.report(at_ns, frame, &mut |event| summary.add_event(event));
                self.report(at_ns, frame);
            }
        }
    }

    fn report(&mut self, at_ns: i64, frame: &Frame) {
        let is_certain = match self.run.report(at_ns, frame, self.size) {
            None => {
                self.axes.iter_mut().for_each(|axis| axis.in_force = None);
                return;
            }
            Some(ExecutionReport::Executed { entries, .. }) => {
                entries.iter().for_each(|entry| self.execute(entry));
                true
            }
            Some(ExecutionReport::Later) => false,
            Some(ExecutionReport::Unknown) => {
                self.axes.iter_mut().for_each(|axis| axis.in_force = None);
                false
            }
        };
        for (slave, axis) in (1..=self.size.max_slaves()).zip(&mut self.axes) {
            let kind = self.run.kind(slave);
            if axis.is_axis || matches!(kind, Some(SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp)) {
                let drive = DriveResponse::decode(&frame.slot(self.size, slave));
                axis.report(at_ns, &drive, kind == Some(SlaveKind::Hsp), is_certain);
            }
        }
    }

    fn execute(&mut self, Entry { orders, .. }: &Entry) {
        for (slave, order) in orders {
            self.axes[slave - 1].executed(order);
        }
    }
}
