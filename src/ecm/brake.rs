//! How one axis is braked: a straight ramp of what was commanded last.
//!
//! CSP: the speed of the last targets falls to 0, the axis then holds. CSV: the velocity falls to 0. CST: a torque
//! that holds a standing axis stays, one that moves it falls to 0: a host that gave the torque is the only one to know
//! how to stop it better. \[OURS]

use super::config::{Guard, Slave};
use super::leftover::Left;
use super::session::Session;
use super::still::{self, Since};
use crate::cia402::Mode;
use crate::sk::{AxisTarget, DriveResponse, Motion, SlaveCommand};

/// \[OURS] An axis that is told to go no further than that in a step is told to stand, counts.
const STILL: f64 = 2.0;

/// How one axis is braked.
#[derive(Clone, Copy, Debug)]
pub(super) enum Brake {
    /// Last targets, and how far they went in a frame.
    Position(Motion, [f64; 2]),
    Velocity(Motion),
    Torque(i16),
}

impl Brake {
    /// The command of frame `k` of `n`.
    pub(super) fn at(&self, k: u32, n: u32) -> SlaveCommand {
        let left = f64::from(n - k) / f64::from(n);
        let scaled = |value: i32| (f64::from(value) * left).round() as i32;
        match self {
            Self::Position(last, speed) => {
                // The sum of the speeds so far, which fall in a straight line.
                let k = f64::from(k);
                let frames = k - k * (k + 1.0) / (2.0 * f64::from(n));
                let to = |axis: AxisTarget, speed: f64| AxisTarget {
                    // It wraps, as targets do.
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

/// Whether only reports can tell if a slave's axis has to be braked, and one cycle does not. While entries are ahead reports
/// tell nothing of where an axis will be that others have commanded.
pub(super) fn is_strange(session: &Session, slave: u8, config: &Slave, left: &Left) -> bool {
    let strange = match (config.axis().map(|axis| axis.mode), last(session, slave, left)) {
        (Some(Mode::Csv), Some(SlaveCommand::Csv(_))) | (Some(Mode::Csp), _) => false,
        (_, Some(_)) => true,
        (_, None) => session.credit.ahead() == 0,
    };
    strange && still::may_move(session, slave, config)
}

/// What a slave was told last, as far as that is known.
fn last(session: &Session, slave: u8, left: &Left) -> Option<SlaveCommand> {
    // While an axis homes the board ignores what it is told.
    if left.homing & 1 << slave != 0 { None } else { session.targets.last(slave) }
}

/// How an axis has to be braked; `None` if it stands, is off or is homing.
pub(super) fn brake(session: &Session, since: &Since, slave: u8, config: &Slave, left: &Left) -> Option<Brake> {
    let axis = config.axis()?;
    if !still::may_be_on(session, slave, config) || session.homing & 1 << slave != 0 {
        return None;
    }
    let is_moving = since.moves(session, slave, config);
    let dry = session.credit.ahead() == 0;
    let velocities = |velocities: [i32; 2]| {
        let outputs = session.targets.outputs()[usize::from(slave)];
        let [first, second] = [0, 1].map(|i| AxisTarget { target: velocities[i], outputs: outputs[i] });
        Brake::Velocity(Motion { first, second })
    };
    match (axis.mode, last(session, slave, left)) {
        (Mode::Csv, Some(SlaveCommand::Csv(motion))) if motion.first.target != 0 || motion.second.target != 0 => {
            // One that stands all the same has not executed it, or hardly moves: it must not be set going by a ramp.
            let stands = dry && !still::may_move(session, slave, config);
            Some(if stands { velocities([0; 2]) } else { Brake::Velocity(motion) })
        }
        (Mode::Csv, Some(SlaveCommand::Csv(_))) => None,
        // Somebody else has set it going. SK-4 `[OURS]`: 0x60FF is counts a second then.
        (Mode::Csv, _) if dry && is_moving && left.homing & 1 << slave == 0 => {
            let (way, seconds) = (since.way(session, slave, config), since.seconds(session));
            Some(velocities(way.map(|counts| (f64::from(counts) / seconds) as i32)))
        }
        // So slow that reports do not tell, it would go on for ever; and after its homing it has no velocity.
        (Mode::Csv, _) if dry && left.is_foreign => Some(velocities([0; 2])),
        (Mode::Cst, Some(SlaveCommand::Cst(torque))) if is_moving => Some(Brake::Torque(torque)),
        (Mode::Cst, None) if dry && is_moving => {
            Some(Brake::Torque(DriveResponse::decode(&session.slot(slave.into())).torque))
        }
        (Mode::Csp, Some(SlaveCommand::Csp(last))) => {
            let commanded = session.targets.speeds(slave);
            let mut speed = commanded;
            if dry {
                // A board that ran dry has stopped already: it must not move again because of a ramp, and not jump to a
                // target that it has never executed.
                let moved = still::last_cycle(session, slave, config);
                speed = [0, 1].map(|i| slower(commanded[i], f64::from(moved[i])));
                let position = session.slot(slave.into()).data1 as i32;
                let away = last.first.target.wrapping_sub(position).unsigned_abs();
                if matches!(axis.guard, Guard::Within(limit) if away > limit) {
                    return None;
                }
            }
            let moves = speed.iter().any(|counts| counts.abs() > STILL);
            moves.then_some(Brake::Position(last, speed))
        }
        // A position of somebody else's is held once its FIFO is empty.
        _ => None,
    }
}

/// How an axis in CSP is stopped that goes after a target so far away that it is not there within `cycles`: frames that
/// were lost have made the way a jump, and a drive goes on to the last target by itself. It is ramped from where it is.
/// `None` for one that stands, or that will be there. Where its target is not known it is `overdue` that decides.
pub(super) fn brake_chase(
    session: &Session,
    since: &Since,
    slave: u8,
    config: &Slave,
    cycles: f64,
    overdue: bool,
) -> Option<Brake> {
    if config.axis()?.mode != Mode::Csp || session.credit.ahead() > 0 || !since.moves(session, slave, config) {
        return None;
    }
    let a_cycle = session.plan.cycle().as_secs_f64() / since.seconds(session);
    let speed = since.way(session, slave, config).map(|counts| f64::from(counts) * a_cycle);
    let positions = still::positions(session, slave, config);
    let outputs = session.targets.outputs()[usize::from(slave)];
    let cycles = cycles.max(still::lag_cycles(session));
    let targets = match session.targets.last(slave) {
        Some(SlaveCommand::Csp(last)) => Some([last.first.target, last.second.target]),
        _ => None,
    };
    let chases = [0, 1].map(|i| {
        let is_far = targets.map_or(overdue, |targets| {
            f64::from(targets[i].wrapping_sub(positions[i]).unsigned_abs()) > speed[i].abs() * cycles
        });
        is_far && speed[i].abs() > STILL
    });
    let [first, second] = [0, 1].map(|i| {
        // Where it will be when the first frame is executed. One that is where it should be stays there.
        let ahead = (speed[i] * f64::from(still::LATENCY)).round() as i64 as i32;
        let target = match targets {
            Some(targets) if !chases[i] => targets[i],
            _ => positions[i].wrapping_add(ahead),
        };
        AxisTarget { target, outputs: outputs[i] }
    });
    let speed = [0, 1].map(|i| if chases[i] { speed[i] } else { 0.0 });
    (chases != [false; 2]).then_some(Brake::Position(Motion { first, second }, speed))
}

/// The slower of two speeds; 0 if they point in opposite ways.
fn slower(a: f64, b: f64) -> f64 {
    if a * b <= 0.0 {
        0.0
    } else if a.abs() < b.abs() {
        a
    } else {
        b
    }
}
