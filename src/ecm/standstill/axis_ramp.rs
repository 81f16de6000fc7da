//! How one axis is brought to a standstill.
//!
//! In CSP it holds the last target that the board has accepted: it is the furthest point that the program has asked for, and what
//! lies beyond it nobody knows. In CSV the velocity falls to 0 in a straight line. In CST a torque that holds a standing axis stays,
//! and one that moves it falls to 0: only the program that commanded the torque could know how to stop the axis better. \[OURS]
//!
//! No frame of a brake goes beyond what the axis was told, turns it round or makes it faster, however late the frame is: this process
//! may stand still before each of them.

use super::LeftBehind;
use super::movement::{self, Observation};
use crate::ecm::config::Slave;
use crate::ecm::exchange::Session;
use crate::ethercat::cia402::Mode;
use crate::sk::{AxisTarget, DriveResponse, Motion, SlaveCommand};

/// \[OURS] Targets that go no further than that in a step are those of an axis that stands, counts.
const STANDSTILL_COUNTS: f64 = 2.0;

/// The ramp of one slave's axes.
#[derive(Clone, Copy, Debug)]
pub(super) enum AxisRamp {
    /// From these targets on, short of those that the axis is on its way to, with speeds that begin with so many counts in a frame.
    Position(Motion, [f64; 2]),
    /// From these velocities to 0.
    Velocity(Motion),
    /// From that torque to 0.
    Torque(i16),
}

impl AxisRamp {
    pub(super) const fn is_of_position(&self) -> bool {
        matches!(self, Self::Position(..))
    }

    /// The command of frame `k` of `n`, from 1.
    pub(super) fn at(&self, k: u32, n: u32) -> SlaveCommand {
        let left = f64::from(n - k) / f64::from(n);
        let scaled = |value: i32| (f64::from(value) * left).round() as i32;
        match self {
            Self::Position(last, speed) => {
                // The sum of the speeds so far, which fall linearly.
                let k = f64::from(k);
                let frames = k - k * (k + 1.0) / (2.0 * f64::from(n));
                let to = |axis: AxisTarget, speed: f64| AxisTarget {
                    // It wraps around, as targets do.
                    target: axis.target.wrapping_add((speed * frames).round() as i64 as i32),
                    ..axis
                };
                SlaveCommand::Csp(Motion { first: to(last.first, speed[0]), second: to(last.second, speed[1]) })
            }
            Self::Velocity(last) => {
                let to = |axis: AxisTarget| AxisTarget { target: scaled(axis.target), ..axis };
                SlaveCommand::Csv(Motion { first: to(last.first), second: to(last.second) })
            }
            Self::Torque(torque) => SlaveCommand::Cst(scaled((*torque).into()) as i16),
        }
    }
}

/// Whether a slave's axis has to be observed to know if it needs a ramp: its last target is not known, or does not tell. While
/// entries are ahead of the board reports do not tell where an axis will be that another program has commanded.
pub(super) fn needs_observation(session: &Session, slave: u8, config: &Slave, left: &LeftBehind) -> bool {
    let is_unknown = match (config.axis().map(|axis| axis.mode), last(session, slave, left)) {
        (Some(Mode::Csv), Some(SlaveCommand::Csv(_))) | (Some(Mode::Csp), _) => false,
        (_, Some(_)) => true,
        (_, None) => session.credit.ahead() == 0,
    };
    is_unknown && movement::may_move(session, slave, config)
}

/// What a slave was told last, as far as that is known.
fn last(session: &Session, slave: u8, left: &LeftBehind) -> Option<SlaveCommand> {
    // The board ignores what an axis is told while it is homing.
    if left.homing.contains(slave) { None } else { session.targets.last(slave) }
}

/// The ramp that a slave's axes need; `None` if they stand, are off or are being homed.
pub(super) fn ramp_of(
    session: &Session,
    observed: &Observation,
    slave: u8,
    config: &Slave,
    left: &LeftBehind,
) -> Option<AxisRamp> {
    let mode = config.axis()?.mode;
    if !movement::may_be_on(session, slave, config) || session.homing.active.contains(slave) {
        return None;
    }
    let is_moving = observed.moves(session, slave, config);
    let fifo_is_empty = session.credit.ahead() == 0;
    let velocities = |velocities: [i32; 2]| {
        let outputs = session.targets.outputs()[usize::from(slave)];
        let [first, second] = [0, 1].map(|i| AxisTarget { target: velocities[i], outputs: outputs[i] });
        AxisRamp::Velocity(Motion { first, second })
    };
    match (mode, last(session, slave, left)) {
        (Mode::Csv, Some(SlaveCommand::Csv(motion))) if motion.first.target != 0 || motion.second.target != 0 => {
            // An axis that stands all the same has not executed its velocity, or hardly moves: a ramp must not set it going.
            let stands = fifo_is_empty && !movement::may_move(session, slave, config);
            Some(if stands { velocities([0; 2]) } else { AxisRamp::Velocity(motion) })
        }
        (Mode::Csv, Some(SlaveCommand::Csv(_))) => None,
        // Another program has set it going. SK-4 `[OURS]`: 0x60FF is taken for counts per second.
        (Mode::Csv, _) if fifo_is_empty && is_moving && !left.homing.contains(slave) => {
            let (moved, seconds) = (observed.moved(session, slave, config), observed.seconds(session));
            Some(velocities(moved.map(|counts| (f64::from(counts) / seconds) as i32)))
        }
        // An axis so slow that reports do not show it would go on for ever; and one that was homed has no velocity.
        (Mode::Csv, _) if fifo_is_empty && left.is_foreign => Some(velocities([0; 2])),
        (Mode::Cst, Some(SlaveCommand::Cst(torque))) if is_moving => Some(AxisRamp::Torque(torque)),
        (Mode::Cst, None) if fifo_is_empty && is_moving => {
            Some(AxisRamp::Torque(DriveResponse::decode(&session.slot(slave.into())).torque))
        }
        // A position is held.
        _ => None,
    }
}

/// The ramp of an axis in CSP whose target is so far away that it does not reach it within `cycles`: lost frames have made its
/// way a jump, and a drive goes on to its last target by itself. It is ramped from its actual position; the ramp ends before that
/// target, since the axis would take longer to it than the ramp does. `None` for an axis that stands, or that will reach its target. If the target is not known `overdue` says whether it is too far.
pub(super) fn ramp_from_position(
    session: &Session,
    observed: &Observation,
    slave: u8,
    config: &Slave,
    cycles: f64,
    overdue: bool,
) -> Option<AxisRamp> {
    if config.axis()?.mode != Mode::Csp || session.credit.ahead() > 0 || !observed.moves(session, slave, config) {
        return None;
    }
    let cycle = session.network.cycle().as_secs_f64() / observed.seconds(session);
    let speed = observed.moved(session, slave, config).map(|counts| f64::from(counts) * cycle);
    let positions = movement::positions(session, slave, config);
    let outputs = session.targets.outputs()[usize::from(slave)];
    let cycles = cycles.max(movement::lag_cycles(session));
    let targets = match session.targets.last(slave) {
        Some(SlaveCommand::Csp(last)) => Some([last.first.target, last.second.target]),
        _ => None,
    };
    let is_ramped = [0, 1].map(|i| {
        let is_far = targets.map_or(overdue, |targets| {
            f64::from(targets[i].wrapping_sub(positions[i]).unsigned_abs()) > speed[i].abs() * cycles
        });
        is_far && speed[i].abs() > STANDSTILL_COUNTS
    });
    let [first, second] = [0, 1].map(|i| {
        // Where the axis will be when the first frame is executed. One that is at its target stays there.
        let ahead = (speed[i] * f64::from(movement::LATENCY_CYCLES)).round() as i64 as i32;
        let target = match targets {
            Some(targets) if !is_ramped[i] => targets[i],
            _ => positions[i].wrapping_add(ahead),
        };
        AxisTarget { target, outputs: outputs[i] }
    });
    let speed = [0, 1].map(|i| if is_ramped[i] { speed[i] } else { 0.0 });
    (is_ramped != [false; 2]).then_some(AxisRamp::Position(Motion { first, second }, speed))
}
