//! Follows the axes in the frames of a run: their following error, the step of the target, velocity and torque at each report.
//! `summary` keeps the largest of these values, and `find` compares them.

use ecmsk::link::Dir;
use ecmsk::recording::{Entry, ExecutionReport, RunExecution};
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, SlaveCommand, SlaveKind, TargetEffect};
use ecmsk::summary::GapFinder;

use super::recording::Framed;

/// \[OURS] No velocity is computed between two reports that are more than this many cycles apart: the mean over a longer
/// time says little about the largest velocity.
const CYCLES_APART_MAX: i64 = 8;

/// A quantity of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The executed target minus the actual position of an enabled axis, in counts.
    FollowingError,
    /// The change of the target from one executed command to the next, in counts.
    TargetStep,
    /// The change of the actual position, in counts per second.
    Velocity,
    /// The actual torque, in 0.1 % of the rated torque.
    Torque,
}

impl Quantity {
    pub const ALL: [Self; 4] = [Self::FollowingError, Self::TargetStep, Self::Velocity, Self::Torque];

    /// The name of the quantity on the command line; in JSON and in the expressions of `find` `-` is replaced by `_`.
    pub const fn word(self) -> &'static str {
        match self {
            Self::FollowingError => "following-error",
            Self::TargetStep => "target-step",
            Self::Velocity => "velocity",
            Self::Torque => "torque",
        }
    }
}

/// A value of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Value {
    /// The slave, from 1.
    pub slave: usize,
    pub quantity: Quantity,
    /// The value with its sign, in the unit of the [`Quantity`].
    pub value: i64,
    /// Time of the recording in nanoseconds: of the report, or of the execution of a target.
    pub at_ns: i64,
}

/// What a report shows about the execution of commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Execution {
    /// Whether only a later report shows which commands were executed. The target in force is not known then.
    pub is_later: bool,
    /// Whether commands were executed since the previous report.
    pub goes_on: bool,
    /// The time at which a gap in a motion began that ends with these commands, nanoseconds of the recording's time.
    pub gap_since_ns: Option<i64>,
}

/// The last values of an axis, while frames are read.
#[derive(Debug, Default)]
struct Axis {
    /// Whether the slave was sent a command that only axes have. Reports alone do not distinguish an axis from other
    /// slaves.
    is_moved: bool,
    /// The target that was executed last; `None` if no target is in force.
    target: Option<i32>,
    /// The time in nanoseconds and the position in counts of the last report.
    position: Option<(i64, i32)>,
    /// The id of the command that the last report answered.
    answered: Option<u8>,
    gaps: GapFinder,
}

impl Axis {
    fn forget_target(&mut self) {
        self.target = None;
        self.gaps.reset();
    }

    /// Processes an executed command. Returns the step of the target, and the time at which a gap began that this
    /// target ends.
    fn executed(&mut self, at_ns: i64, order: &SlaveCommand) -> (Option<i64>, Option<i64>) {
        match order {
            SlaveCommand::Csp(motion) => {
                self.is_moved = true;
                let target = motion.first.target;
                let before = self.target.replace(target);
                (before.map(|before| way(before, target)), self.gaps.target(at_ns, target))
            }
            _ if order.id().target_effect() == TargetEffect::Keeps => (None, None),
            order => {
                self.is_moved |= order.id().is_for_axes();
                self.forget_target();
                (None, None)
            }
        }
    }

    /// Processes the slot of a report. `take` is called with the velocity, with the torque if `is_drive`, and with the
    /// following error if `is_certain`, that is if the target in force is known.
    fn report(
        &mut self,
        at_ns: i64,
        cycle_ns: i64,
        drive: &DriveResponse,
        is_drive: bool,
        is_certain: bool,
        mut take: impl FnMut(Quantity, i64),
    ) {
        // Homing moves the zero of the position, so positions before and after it are not compared.
        let is_homing = CommandId::from_code(drive.head.id) == CommandId::GoHome;
        if is_homing || self.answered.replace(drive.head.id) != Some(drive.head.id) {
            self.position = None;
        }
        if is_homing {
            self.forget_target();
        }
        let before = self.position.replace((at_ns, drive.position));
        if let Some((then_ns, position)) = before {
            let passed = at_ns.saturating_sub(then_ns);
            if passed > 0 && passed <= CYCLES_APART_MAX.saturating_mul(cycle_ns) {
                let counts = way(position, drive.position);
                take(Quantity::Velocity, counts.saturating_mul(1_000_000_000) / passed.max(cycle_ns));
            }
        }
        if is_drive {
            take(Quantity::Torque, drive.torque.into());
        }
        if !drive.statusword.is_enabled() {
            self.forget_target();
        } else if let Some(target) = self.target.filter(|_| is_certain) {
            take(Quantity::FollowingError, way(drive.position, target));
        }
    }
}

/// The distance from one position to another, with its sign, in counts. The 32-bit positions wrap around, since an axis
/// may turn without end.
fn way(from: i32, to: i32) -> i64 {
    to.wrapping_sub(from).into()
}

/// Follows the axes in the frames of a run, sorted by time.
pub struct Axes {
    axes: Vec<Axis>,
    run: RunExecution,
}

impl Axes {
    /// A value to which no frame was added yet.
    pub fn new() -> Self {
        Self { axes: (0..MAX_SLAVES).map(|_| Axis::default()).collect(), run: RunExecution::new() }
    }

    /// Whether a slave, from 1, was moved: it was sent a command that only axes have.
    pub fn is_moved(&self, slave: usize) -> bool {
        self.of(slave).is_some_and(|axis| axis.is_moved)
    }

    /// The target in force of a slave, from 1, in counts; `None` if none is, or it is not known.
    pub fn target(&self, slave: usize) -> Option<i32> {
        self.of(slave)?.target
    }

    /// The kind of a slave, from 1; `None`: it is not known.
    pub fn kind(&self, slave: usize) -> Option<SlaveKind> {
        self.run.kind(slave)
    }

    fn of(&self, slave: usize) -> Option<&Axis> {
        self.axes.get(slave.checked_sub(1)?)
    }

    /// Processes the next frame. `take` is called with each value that the frame shows of the axes that were moved.
    pub fn frame(&mut self, framed: &Framed, take: &mut dyn FnMut(Value)) -> Execution {
        if self.run.damage(framed.recorded.damage_before) {
            self.forget();
        }
        match framed.recorded.dir {
            Dir::Write => {
                self.run.command(framed.time_ns, &framed.recorded.frame, framed.size);
                Execution::default()
            }
            Dir::Read => self.report(framed, take),
        }
    }

    fn report(&mut self, framed: &Framed, take: &mut dyn FnMut(Value)) -> Execution {
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        let mut shown = Execution::default();
        let is_certain = match self.run.report(at_ns, frame, size) {
            None => {
                self.forget();
                return shown;
            }
            Some(ExecutionReport::Executed { entries, idle_since_ns }) => {
                if let Some(idle_since_ns) = idle_since_ns {
                    self.axes.iter_mut().for_each(|axis| axis.gaps.idle(idle_since_ns));
                }
                shown.goes_on = !entries.is_empty();
                for entry in &entries {
                    let gap = self.execute(entry, take);
                    shown.gap_since_ns = shown.gap_since_ns.or(gap);
                }
                true
            }
            Some(ExecutionReport::Later) => {
                shown.is_later = true;
                false
            }
            Some(ExecutionReport::Unknown) => {
                self.axes.iter_mut().for_each(Axis::forget_target);
                false
            }
        };
        let cycle_ns = self.run.cycle_ns();
        for (slave, axis) in (1..=size.max_slaves()).zip(&mut self.axes).filter(|(_, axis)| axis.is_moved) {
            // An HSP (a pulse module) has inputs where a drive has its torque.
            let is_drive = self.run.kind(slave) != Some(SlaveKind::Hsp);
            let drive = DriveResponse::decode(&frame.slot(size, slave));
            axis.report(at_ns, cycle_ns, &drive, is_drive, is_certain, |quantity, value| {
                take(Value { slave, quantity, value, at_ns });
            });
        }
        shown
    }

    /// Forgets the targets and the last positions of all axes.
    fn forget(&mut self) {
        for axis in &mut self.axes {
            axis.forget_target();
            axis.position = None;
        }
    }

    /// Executes the commands of a frame. Returns the time at which a gap began that these commands end.
    fn execute(&mut self, Entry { at_ns, orders }: &Entry, take: &mut dyn FnMut(Value)) -> Option<i64> {
        let mut gap = None;
        for (slave, order) in orders {
            let slave = *slave;
            let (step, since_ns) = self.axes[slave - 1].executed(*at_ns, order);
            if let Some(value) = step {
                take(Value { slave, quantity: Quantity::TargetStep, value, at_ns: *at_ns });
            }
            gap = gap.or(since_ns);
        }
        gap
    }
}
