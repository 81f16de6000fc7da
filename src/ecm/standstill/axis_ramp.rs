//! The ramp of one axis to a standstill.
//!
//! In CSP the axis holds the last target that the board has accepted: the program has not asked for any point beyond.
//! In CSV the velocity falls linearly to 0. In CST a torque that holds a stationary axis stays, and a torque that moves
//! an axis falls to 0: only the program that commanded the torque could know a better stop. \[OURS]
//!
//! However late a frame of a ramp is, it does not take the axis beyond its last command, reverse it or make it faster:
//! this process may stall before any of them.

use super::LeftBehind;
use super::movement::{self, Observation};
use crate::ecm::config::Slave;
use crate::ecm::exchange::Session;
use crate::ethercat::cia402::Mode;
use crate::sk::{AxisTarget, DriveResponse, Motion, SlaveCommand};

/// \[OURS] An axis counts as stationary if its targets differ by at most this from step to step, counts.
const STANDSTILL_COUNTS: f64 = 2.0;

/// The ramp of the axes of one slave.
#[derive(Clone, Copy, Debug)]
pub(super) enum AxisRamp {
    /// Positions: from these targets, which come before the last commanded ones, with these initial speeds, counts per
    /// frame.
    Position(Motion, [f64; 2]),
    /// Velocities: from these to 0.
    Velocity(Motion),
    /// A torque: from this to 0.
    Torque(i16),
}

impl AxisRamp {
    pub(super) const fn is_of_position(&self) -> bool {
        matches!(self, Self::Position(..))
    }

    /// The command of frame `k` (from 1) of `n`.
    pub(super) fn at(&self, k: u32, n: u32) -> SlaveCommand {
        let left = f64::from(n - k) / f64::from(n);
        let scaled = |value: i32| (f64::from(value) * left).round() as i32;
        match self {
            Self::Position(last, speed) => {
                // The sum of the speeds so far, which fall linearly.
                let k = f64::from(k);
                let frames = k - k * (k + 1.0) / (2.0 * f64::from(n));
                let to = |axis: AxisTarget, speed: f64| AxisTarget {
                    // The target wraps around, as all targets do.
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

/// Whether a slave's axes must be observed to know if they need a ramp: their last target is unknown, or says nothing
/// about motion. Behind entries that another program has left in the FIFO, reports do not show where an axis will be.
pub(super) fn needs_observation(session: &Session, slave: u8, config: &Slave, left: &LeftBehind) -> bool {
    let is_unknown = match (config.axis().map(|axis| axis.mode), last(session, slave, left)) {
        (Some(Mode::Csv), Some(SlaveCommand::Csv(_))) | (Some(Mode::Csp), _) => false,
        (_, Some(_)) => true,
        (_, None) => session.credit.ahead() == 0,
    };
    is_unknown && movement::may_move(session, slave, config)
}

/// The last command to a slave; `None`: not known.
fn last(session: &Session, slave: u8, left: &LeftBehind) -> Option<SlaveCommand> {
    // The board ignores commands to an axis that is homing.
    if left.homing.contains(slave) { None } else { session.targets.last(slave) }
}

/// The ramp that a slave's axes need; `None` if they are stationary, off or being homed.
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
            // A stationary axis has not executed its velocity, or hardly moves: a ramp must not set it going.
            let stands = fifo_is_empty && !movement::may_move(session, slave, config);
            Some(if stands { velocities([0; 2]) } else { AxisRamp::Velocity(motion) })
        }
        (Mode::Csv, Some(SlaveCommand::Csv(_))) => None,
        // Another program has set the axis going. SK-4 `[OURS]`: 0x60FF is taken for counts per second.
        (Mode::Csv, _) if fifo_is_empty && is_moving && !left.homing.contains(slave) => {
            let (moved, seconds) = (observed.moved(session, slave, config), observed.seconds(session));
            Some(velocities(moved.map(|counts| (f64::from(counts) / seconds) as i32)))
        }
        // Velocity 0 for axes that move too slowly for reports to show it, which would go on for ever, and for homed
        // ones.
        (Mode::Csv, _) if fifo_is_empty && left.is_foreign => Some(velocities([0; 2])),
        (Mode::Cst, Some(SlaveCommand::Cst(torque))) if is_moving => Some(AxisRamp::Torque(torque)),
        (Mode::Cst, None) if fifo_is_empty && is_moving => {
            Some(AxisRamp::Torque(DriveResponse::decode(&session.slot(slave.into())).torque))
        }
        // A position is held without a ramp.
        _ => None,
    }
}

/// The ramp of an axis in CSP that cannot reach its target within `cycles`: lost frames have turned its path into a
/// jump, and a drive goes on to its last target by itself. The ramp begins at the actual position and ends before the
/// target, which the axis would reach only after the time of the ramp. `None` for an axis that is stationary or reaches
/// its target. If the target is not known, `overdue` says whether it counts as too far.
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
        // The position of the axis when the first frame is executed. An axis at its target stays there.
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
