//! The ramp of one axis to a standstill.
//!
//! In CSP the axis holds the last target that the board has accepted, because the program has not commanded any point
//! beyond it. In CSV the velocity falls linearly to 0. In CST a torque that holds a stationary axis stays, and a torque
//! that moves an axis falls to 0: only the program that commanded the torque could know a better stop. \[OURS]
//!
//! This process may stall before any frame of a ramp. However late a frame is, it does not take the axis beyond its
//! last command, reverse it or make it faster.

use super::LeftBehind;
use super::movement::{self, Observation};
use crate::ecm::config::Slave;
use crate::ecm::exchange::Session;
use crate::ethercat::cia402::Mode;
use crate::sk::{AxisTarget, DriveResponse, Motion, SlaveCommand};

/// \[OURS] An axis that moves at most this many counts per cycle, on average over an observation, is stationary and gets
/// no position ramp.
const STANDSTILL_COUNTS: f64 = 2.0;

/// The ramp with which the axes of one slave are brought to a standstill, by the mode of the slave.
#[derive(Clone, Copy, Debug)]
pub(super) enum AxisRamp {
    /// In CSP: the positions of both axes at which the ramp begins, and the speeds there in counts per frame. The speeds
    /// fall to 0.
    Position(Motion, [f64; 2]),
    /// In CSV: the velocities at which the ramp begins. They fall to 0.
    Velocity(Motion),
    /// In CST: the torque at which the ramp begins, 0.1 %. It falls to 0.
    Torque(i16),
}

impl AxisRamp {
    pub(super) const fn is_of_position(&self) -> bool {
        matches!(self, Self::Position(..))
    }

    /// The command in frame `k` (1 to `n`) of a ramp of `n` frames.
    pub(super) fn at(&self, k: u32, n: u32) -> SlaveCommand {
        let left = f64::from(n - k) / f64::from(n);
        let scaled = |value: i32| (f64::from(value) * left).round() as i32;
        match self {
            Self::Position(last, speed) => {
                // The distance from the beginning to frame `k`, in units of the initial speed per frame: the sum of the
                // linearly falling speeds.
                let k = f64::from(k);
                let frames = k - k * (k + 1.0) / (2.0 * f64::from(n));
                let to = |axis: AxisTarget, speed: f64| AxisTarget {
                    // Positions wrap around at 32 bits.
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

/// Whether a slave's axes must be observed over some cycles to know if they need a ramp: their last command is unknown,
/// or does not show whether they move, or the frame of a ramp would switch off outputs that are not known. While the
/// FIFO has entries of another program, an observation is useless, since these entries will change the motion.
pub(super) fn needs_observation(session: &Session, slave: u8, config: &Slave, left: &LeftBehind) -> bool {
    let is_unknown = match (config.axis().map(|axis| axis.mode), last(session, slave, left)) {
        (Some(Mode::Csv), Some(SlaveCommand::Csv(_))) | (Some(Mode::Csp), _) => false,
        (_, Some(_)) => true,
        (_, None) => session.credit.ahead() == 0,
    };
    is_unknown && (movement::may_move(session, slave, config) || has_unknown_outputs(config, left))
}

const fn has_unknown_outputs(config: &Slave, left: &LeftBehind) -> bool {
    left.outputs_unknown && matches!(config, Slave::Hsp(_))
}

/// Whether a stop sends no target to an HSP: its digital outputs are not known, so that a target would switch them off,
/// and its axes have not moved in the observation.
pub(super) fn keeps_outputs(
    session: &Session,
    observed: &Observation,
    slave: u8,
    config: &Slave,
    left: &LeftBehind,
) -> bool {
    has_unknown_outputs(config, left) && observed.moved(session, slave, config) == [0; 2]
}

/// The last command to a slave; `None` if it is not known.
fn last(session: &Session, slave: u8, left: &LeftBehind) -> Option<SlaveCommand> {
    // The board ignores commands to an axis that is homing, so the last command was not executed.
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
    if keeps_outputs(session, observed, slave, config, left) {
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
            // The axis is stationary although its last commanded velocity is not 0: the command was not executed, or
            // hardly moves the axis. A ramp from that velocity would start a motion.
            let stands = fifo_is_empty && !movement::may_move(session, slave, config);
            Some(if stands { velocities([0; 2]) } else { AxisRamp::Velocity(motion) })
        }
        (Mode::Csv, Some(SlaveCommand::Csv(_))) => None,
        // The last command is unknown, since another program has started the motion. SK-4 `[OURS]`: the ramp begins at
        // the observed speed, with 0x60FF taken as counts per second.
        (Mode::Csv, _) if fifo_is_empty && is_moving && !left.homing.contains(slave) => {
            let (moved, seconds) = (observed.moved(session, slave, config), observed.seconds(session));
            Some(velocities(moved.map(|counts| (f64::from(counts) / seconds) as i32)))
        }
        // An axis that another program has started may move too slowly to be noticed in an observation, and would never
        // stop. Velocity 0 stops it. An axis whose homing was ended also gets velocity 0, since its motion is not
        // known.
        (Mode::Csv, _) if fifo_is_empty && left.is_foreign => Some(velocities([0; 2])),
        (Mode::Cst, Some(SlaveCommand::Cst(torque))) if is_moving => Some(AxisRamp::Torque(torque)),
        (Mode::Cst, None) if fifo_is_empty && is_moving => {
            Some(AxisRamp::Torque(DriveResponse::decode(&session.slot(slave.into())).torque))
        }
        // No ramp: in CSP the axis holds its last target, in CST a stationary axis keeps its torque. Or the motion is
        // unknown until the entries in the FIFO are executed.
        _ => None,
    }
}

/// The ramp of an axis in CSP that cannot reach its last target within `cycles`: because frames were lost, that target
/// is far away, and the drive goes there by itself. The ramp begins at the actual position, and ends before the target.
/// `None` for an axis that is stationary or reaches its target in time.
///
/// An axis with an unknown last target may still reach it in time. So it is ramped only if `overdue` is set: little
/// time is left for the stop. The target of an axis that was homing is unknown, too: the board has ignored its targets,
/// and holds it where its drive comes to rest. A ramp could set it in motion again.
///
/// An axis may also move away from its last target, for example because it springs back when its drive stops pushing.
/// It gets no ramp, which would drive it away from everything that was commanded. Only if no cycle is left, it is held
/// at its actual position.
pub(super) fn ramp_from_position(
    session: &Session,
    observed: &Observation,
    slave: u8,
    config: &Slave,
    left: &LeftBehind,
    (cycles, overdue): (f64, bool),
) -> Option<AxisRamp> {
    if config.axis()?.mode != Mode::Csp || session.credit.ahead() > 0 || !observed.moves(session, slave, config) {
        return None;
    }
    let cycle = session.network.cycle().as_secs_f64() / observed.seconds(session);
    let speed = observed.moved(session, slave, config).map(|counts| f64::from(counts) * cycle);
    let positions = movement::positions(session, slave, config);
    let outputs = session.targets.outputs()[usize::from(slave)];
    let is_last_frame = cycles <= 0.0;
    let cycles = cycles.max(movement::lag_cycles(session));
    let targets = match last(session, slave, left) {
        Some(SlaveCommand::Csp(last)) => Some([last.first.target, last.second.target]),
        _ => None,
    };
    let is_ramped = [0, 1].map(|i| {
        let is_far = targets.map_or(overdue, |targets| {
            let way = f64::from(targets[i].wrapping_sub(positions[i]));
            way.abs() > speed[i].abs() * cycles && (way * speed[i] > 0.0 || is_last_frame)
        });
        is_far && speed[i].abs() > STANDSTILL_COUNTS
    });
    let [first, second] = [0, 1].map(|i| {
        // The ramp begins where the axis will be when the first frame is executed, so that the axis does not go back. An
        // axis that is not ramped keeps its target.
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
