//! Collects the curves of one axis from frames.

use ecmsk::cia402::Statusword;
use ecmsk::ecm::Scale;
use ecmsk::sk::{CommandId, DriveResponse, RawSlot, SlaveCommand};
use ecmsk::summary::GapFinder;

use super::Window;
use super::decimate::{Line, Pieces};
use super::speed::Speed;
use super::states::{Change, Span, States};

/// The curves of an axis. A target is drawn at the cycle in which the board executed it.
pub struct AxisLines {
    /// The number of the slave.
    pub axis: u8,
    /// The number of counts per position unit.
    pub scale: Scale,
    /// The executed targets, in units.
    pub target: Pieces,
    /// The actual positions, in units.
    pub position: Pieces,
    /// The executed target minus the actual position, in units; only while the drive is in Operation enabled.
    pub difference: Pieces,
    /// The actual velocity, computed from the positions, in units per second.
    pub velocity: Pieces,
    /// The commanded velocity, computed from the CSP targets, in units per second.
    pub commanded_velocity: Pieces,
    /// The target velocity of CSV, in the drive's own unit.
    pub target_velocity: Pieces,
    /// The target torque in percent of the rated torque.
    pub target_torque: Pieces,
    /// The actual torque in percent of the rated torque.
    pub torque: Pieces,
    /// The time spans in which the drive was not enabled, homing, lost or in fault, and the gaps: spans in which the
    /// axis was moving and the FIFO was empty.
    pub states: Vec<Span>,
    /// The time at which homing last gave the position a new zero, in seconds.
    pub zeroed: Option<f64>,
}

impl AxisLines {
    /// Whether nothing of the axis is drawn.
    pub fn is_empty(&self) -> bool {
        let lines = [&self.target, &self.position, &self.target_velocity, &self.target_torque, &self.torque];
        lines.iter().all(|line| line.is_empty())
    }
}

/// Builds the curves of an axis while the frames of a recording are read.
pub struct Axis {
    /// The number of the slave.
    pub number: u8,
    scale: Scale,
    /// The command ids of `--commands`: the axis is drawn only while its slot has one of these ids. If empty, it is
    /// always drawn.
    commands: Vec<u8>,
    target: Line,
    position: Line,
    difference: Line,
    velocity: Line,
    commanded_velocity: Line,
    target_velocity: Line,
    target_torque: Line,
    torque: Line,
    states: States,
    gaps: GapFinder,
    speeds: [Speed; 2],
    /// The target that was executed last, in counts.
    in_force: Option<i32>,
    /// The last reported position in counts, and whether the drive is in Operation enabled and so follows targets;
    /// `None` while the axis is not drawn.
    stands: Option<(i32, bool)>,
    /// The slot of the axis in the first report with state 0x18 (OP with a lost slave). `None` once that state ends or
    /// the slot changes, since the slave is not lost then.
    frozen: Option<Frozen>,
    /// The last slot, and the time at which it last changed.
    before: Option<(RawSlot, i64)>,
    /// Whether the last report had state 0x18 (OP with a lost slave).
    failed_before: bool,
    ignores: Option<Ignores>,
    zeroed_ns: Option<i64>,
}

/// The slot of an axis that may be lost: the slot has not changed since state 0x18 began.
#[derive(Debug)]
struct Frozen {
    slot: RawSlot,
    /// Whether the slave is certainly lost. The slot of a connected slave would have changed, because the axis moved
    /// just before state 0x18 or has received a new target since.
    is_lost: bool,
}

/// \[OURS] An axis whose slot changed within this time counts as moving, nanoseconds.
const MOVED_NS: i64 = 20_000_000;

/// A phase in which the board ignores the targets of an axis: from GO_HOME until homing has ended and the mode is
/// restored (SK-7.26, SK-7.37). After this phase the slot answers motion commands again.
#[derive(Clone, Copy, Debug, Default)]
struct Ignores {
    /// Whether a report has answered GO_HOME.
    answered: bool,
    /// The number of reports that answered a motion command while no report has answered GO_HOME yet.
    reports: u8,
}

/// \[OURS] If more reports than this answer motion commands before any report answers GO_HOME, the board has not
/// executed GO_HOME.
const UNANSWERED_MAX: u8 = 3;

impl Axis {
    /// Creates empty curves. They will be thinned to `columns` pixel columns. `number` is the number of the slave.
    pub fn new(number: u8, scale: Scale, window: Window, columns: u32, commands: Vec<u8>) -> Self {
        let line = || Line::new(window, columns);
        let held = || Line::holding(window, columns);
        Self {
            number,
            scale,
            commands,
            target: held(),
            position: line(),
            difference: line(),
            velocity: line(),
            commanded_velocity: line(),
            target_velocity: held(),
            target_torque: held(),
            torque: line(),
            states: States::new(window, columns),
            gaps: GapFinder::default(),
            speeds: Default::default(),
            in_force: None,
            stands: None,
            frozen: None,
            before: None,
            failed_before: false,
            ignores: None,
            zeroed_ns: None,
        }
    }

    /// Processes a command for the axis at the time when the host sends it.
    pub fn sent(&mut self, order: &SlaveCommand) {
        if *order == SlaveCommand::GoHome {
            self.states.go_home();
        }
    }

    /// Processes a cycle in which the board found the FIFO empty.
    pub const fn idle(&mut self, at_ns: i64) {
        self.gaps.idle(at_ns);
    }

    /// Draws a command for the axis at the time when the board executes it. If the command ends a gap in the motion
    /// (cycles in which the FIFO was empty), returns the time at which the gap began.
    pub fn executed(&mut self, at_ns: i64, order: &SlaveCommand) -> Option<i64> {
        let shown = self.shows(order.id().code()) && self.frozen.is_none();
        let is_motion = order.id().is_motion();
        if let Some(Frozen { slot, is_lost }) = self.frozen.as_mut().filter(|_| is_motion) {
            *is_lost |= match order {
                SlaveCommand::Csp(motion) => motion.first.target != slot.data1.cast_signed(),
                SlaveCommand::Csv(motion) => motion.first.target != 0,
                _ => false,
            };
            return None;
        }
        if is_motion && self.ignores.is_some() {
            return None;
        }
        match order {
            SlaveCommand::GoHome => {
                self.ignores = Some(Ignores::default());
                self.forget_target(at_ns);
                None
            }
            SlaveCommand::Csp(motion) => {
                let target = motion.first.target;
                self.in_force = Some(target);
                let gap = self.gaps.target(at_ns, target);
                if let Some(since_ns) = gap {
                    self.states.gap(since_ns, at_ns);
                }
                if shown {
                    self.target.push(at_ns, self.scale.to_units(target));
                }
                gap
            }
            SlaveCommand::Csv(motion) if shown => {
                self.target_velocity.push(at_ns, motion.first.target.into());
                None
            }
            SlaveCommand::Cst(torque) if shown => {
                self.target_torque.push(at_ns, percent(*torque));
                None
            }
            _ => None,
        }
    }

    /// Checks a report in OP for signs that the slave of this axis is lost: its slot does not change while the board is
    /// in state 0x18 (`failed`). Must be called before [`Self::executed`] for the commands of the same cycle.
    pub fn look(&mut self, at_ns: i64, slot: &RawSlot, failed: bool) {
        let changed_ns = match self.before {
            Some((before, changed_ns)) if before == *slot => changed_ns,
            _ => at_ns,
        };
        self.before = Some((*slot, changed_ns));
        match (failed, &self.frozen) {
            (false, None) => {}
            (false, Some(_)) => self.is_there(at_ns, true),
            (true, Some(frozen)) if frozen.slot != *slot => self.is_there(at_ns, false),
            (true, Some(_)) => return,
            (true, None) if self.failed_before => {}
            (true, None) => {
                self.forget_target(at_ns);
                self.frozen = Some(Frozen { slot: *slot, is_lost: at_ns.saturating_sub(changed_ns) < MOVED_NS });
                self.states.may_be_lost(at_ns);
            }
        }
        self.failed_before = failed;
        let id = CommandId::from_code(slot.id);
        if let Some(ignores) = &mut self.ignores {
            let is_motion = id.is_motion();
            ignores.answered |= id == CommandId::GoHome;
            ignores.reports += u8::from(is_motion && !ignores.answered);
            let goes_on = is_motion && !self.states.is_homing();
            if goes_on && (ignores.answered || ignores.reports > UNANSWERED_MAX) {
                self.ignores = None;
            }
        }
    }

    /// Ends the suspicion that the slave is lost. `was_lost`: state 0x18 has ended, so the slave was lost and is back.
    /// Otherwise its slot has changed during state 0x18, so the slave was never lost.
    fn is_there(&mut self, at_ns: i64, was_lost: bool) {
        if was_lost {
            return self.interrupt(at_ns);
        }
        self.states.is_there(at_ns, None);
        self.frozen = None;
    }

    /// Draws the slot of the axis from a report in OP. `aborted`: the report answers ABORT_HOME. `is_drive`: the slot
    /// has a torque and an error code. `certain`: it is known which target the board has executed.
    pub fn report(&mut self, at_ns: i64, drive: &DriveResponse, aborted: bool, is_drive: bool, certain: bool) {
        if self.frozen.is_some() {
            // The slot only repeats old values, so nothing is drawn.
            return self.break_lines(at_ns);
        }
        let was_homing = self.states.is_homing();
        let change = self.states.report(at_ns, drive, aborted, is_drive);
        if was_homing && !self.states.is_homing() {
            // Homing may have given the position a new zero, so the curve must not connect the positions before and
            // after it.
            self.position.break_off(at_ns);
            let word = drive.statusword.0;
            if word & Statusword::BIT13 == 0 && word & Statusword::TARGET_REACHED != 0 {
                self.zeroed_ns = Some(at_ns);
            }
        }
        if change == Change::FollowsNot {
            self.forget_target(at_ns);
        }
        if change != Change::None {
            self.velocity.interrupt(at_ns);
            self.speeds[0].reset();
        }
        if !self.shows(drive.head.id) {
            // `--commands` does not list this command, so the curves have a gap here.
            return self.break_lines(at_ns);
        }
        let follows = drive.statusword.is_enabled();
        self.stands = Some((drive.position, follows));
        let position = self.scale.to_units(drive.position);
        self.position.push(at_ns, position);
        if is_drive {
            self.torque.push(at_ns, percent(drive.torque));
        }
        if let Some((at_ns, velocity)) = self.speeds[0].position(at_ns, position) {
            self.velocity.push(at_ns, velocity);
        }
        if !certain {
            return;
        }
        match self.in_force.filter(|_| follows) {
            Some(target) => {
                let target = self.scale.to_units(target);
                self.difference.push(at_ns, target - position);
                if let Some((at_ns, velocity)) = self.speeds[1].position(at_ns, target) {
                    self.commanded_velocity.push(at_ns, velocity);
                }
            }
            None => {
                self.difference.interrupt(at_ns);
                self.commanded_velocity.interrupt(at_ns);
                self.speeds[1].reset();
            }
        }
    }

    /// Forgets the last executed target, because it is no longer valid or it is not known which target was executed
    /// last.
    pub fn forget_target(&mut self, at_ns: i64) {
        self.in_force = None;
        self.gaps.reset();
        self.speeds[1].reset();
        let targets = [&mut self.target, &mut self.target_velocity, &mut self.target_torque];
        targets.into_iter().for_each(|line| line.interrupt(at_ns));
    }

    /// Interrupts all curves, because the state of the axis is unknown from `at_ns` on.
    pub fn interrupt(&mut self, at_ns: i64) {
        self.forget_target(at_ns);
        self.speeds[0].reset();
        self.stands = None;
        let is_lost = self.frozen.as_ref().map(|frozen| frozen.is_lost);
        self.states.is_there(at_ns, is_lost);
        (self.frozen, self.failed_before, self.ignores) = (None, false, None);
        self.interrupt_lines(at_ns);
        self.states.interrupt(at_ns);
    }

    /// Interrupts the curves of reported values, and forgets the positions from which velocities are computed.
    fn break_lines(&mut self, at_ns: i64) {
        self.interrupt_lines(at_ns);
        self.speeds.iter_mut().for_each(Speed::reset);
        self.stands = None;
    }

    fn interrupt_lines(&mut self, at_ns: i64) {
        let lines = [&mut self.position, &mut self.difference, &mut self.torque];
        let more = [&mut self.velocity, &mut self.commanded_velocity];
        lines.into_iter().chain(more).for_each(|line| line.interrupt(at_ns));
    }

    /// The executed target, in units, while the drive follows it.
    pub fn commanded(&self) -> Option<f64> {
        self.stands.filter(|(_, follows)| *follows).and(self.in_force).map(|target| self.scale.to_units(target))
    }

    /// The position in units; `None` during homing, since homing moves the zero.
    pub fn stands(&self) -> Option<f64> {
        self.stands.filter(|_| !self.states.is_homing()).map(|(position, _)| self.scale.to_units(position))
    }

    /// Completes the curves and returns them.
    pub fn finish(mut self) -> AxisLines {
        if let Some(Frozen { is_lost, .. }) = self.frozen {
            self.states.is_there(i64::MAX, Some(is_lost));
        }
        AxisLines {
            axis: self.number,
            scale: self.scale,
            target: self.target.finish(),
            position: self.position.finish(),
            difference: self.difference.finish(),
            velocity: self.velocity.finish(),
            commanded_velocity: self.commanded_velocity.finish(),
            target_velocity: self.target_velocity.finish(),
            target_torque: self.target_torque.finish(),
            torque: self.torque.finish(),
            states: self.states.finish(),
            zeroed: self.zeroed_ns.map(super::seconds),
        }
    }

    fn shows(&self, id: u8) -> bool {
        self.commands.is_empty() || self.commands.contains(&id)
    }
}

/// Converts 0.1 % of the rated torque to percent.
fn percent(torque: i16) -> f64 {
    f64::from(torque) / 10.0
}
