//! Bringing axes to a standstill from the host: a straight ramp of what was commanded last. The axes stay enabled.
//!
//! CSP: the speed of the last targets falls to 0, the axis then holds. CSV: the velocity falls to 0. CST: a torque
//! that holds a standing axis stays, one that moves it falls to 0: a host that gave the torque is the only one to know
//! how to stop it better. \[OURS]

use std::sync::Arc;
use std::time::Duration;

use parking_lot::MutexGuard;

use super::config::Slave;
use super::session::Session;
use super::still::{self, Since};
use super::{Ecm, EcmError};
use crate::cia402::Mode;
use crate::sk::{AxisTarget, DriveResponse, Motion, SlaveCommand, SlotSize};

/// \[OURS] An axis that is told to go no further than that in a step is told to stand, counts.
const STILL: f64 = 2.0;
/// \[OURS] Frames of the ramp that are ahead of the board at most.
const DEPTH: u16 = 64;
/// \[OURS] What of the limit is left for standing still after the ramp.
const SETTLE: Duration = Duration::from_millis(200);
/// \[OURS] The same in cycles, where they are long.
const SETTLE_CYCLES: u32 = 3;

/// \[OURS] A ramp has at least that many frames, where the cycle is long.
pub(super) const MIN_FRAMES: u32 = 4;

/// What is left of a limit for standing still after the ramp.
pub(super) fn settle(cycle: Duration) -> Duration {
    SETTLE.max(cycle * SETTLE_CYCLES)
}

/// How one axis is braked.
#[derive(Clone, Copy, Debug)]
enum Brake {
    /// Last targets, and how far they went in a frame.
    Position(Motion, [f64; 2]),
    Velocity(Motion),
    Torque(i16),
}

impl Brake {
    /// The command of frame `k` of `n`.
    fn at(&self, k: u32, n: u32) -> SlaveCommand {
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

/// Ramps what moves to a standstill, by `deadline`.
pub(super) fn to_standstill(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
) -> Result<(), EcmError> {
    let began = ecm.core.now();
    ecm.core.catch_up(session)?;
    if !session.in_op() || session.plan.count == 0 {
        return Ok(());
    }
    let mut brakes = [None; SlotSize::Bytes12.slots()];
    let plan = Arc::clone(&session.plan);
    let mut since = Since::now(session);
    // Whether one moves that this program has not set going.
    while !since.is_over(session)
        && session.in_op()
        && plan.slaves().any(|(slave, config)| is_strange(session, slave, config))
    {
        read(ecm, session, deadline, began)?;
    }
    for (slave, config) in plan.slaves() {
        brakes[usize::from(slave)] = brake(session, &since, slave, config);
    }
    if brakes.iter().any(Option::is_some) {
        let frames = frames(ecm, session, deadline.saturating_sub(began));
        for k in 1..=frames {
            for (slave, brake) in brakes.iter().enumerate() {
                let Some(brake) = brake else { continue };
                // An axis that went off meanwhile gets none.
                let is_on = session.is_on(slave as u8);
                session.targets.set(slave, is_on.then(|| brake.at(k, frames)));
            }
            room(ecm, session, deadline, began)?;
            ecm.core.write(session, deadline)?;
        }
    }
    // What is in the FIFO still moves the axes.
    loop {
        let stand = || plan.slaves().all(|(slave, config)| !still::may_move(session, slave, config));
        let stood =
            || since.is_over(session) && plan.slaves().all(|(slave, config)| !since.moves(session, slave, config));
        if session.credit.ahead() == 0 && (stand() || stood()) || !session.in_op() {
            return Ok(());
        }
        if since.is_over(session) {
            since = Since::now(session);
        }
        read(ecm, session, deadline, began)?;
    }
}

fn room(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration, began: Duration) -> Result<(), EcmError> {
    while session.in_op() && session.credit.ahead() >= DEPTH {
        read(ecm, session, deadline, began)?;
    }
    Ok(())
}

fn read(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration, began: Duration) -> Result<(), EcmError> {
    if !ecm.core.read(session, deadline)? {
        ecm.core.check_silence(session, began, "a standstill")?;
    }
    let waited = ecm.core.now().saturating_sub(began);
    if ecm.core.now() < deadline {
        return Ok(());
    }
    Err(EcmError::Timeout {
        what: "a standstill",
        waited,
        seen: format!("{} entries are ahead of the board", session.credit.ahead()),
        hint: "use the emergency stop if axes move",
    })
}

/// Frames of the ramp: those of its time, as many as end before the limit.
fn frames(ecm: &Ecm, session: &Session, left: Duration) -> u32 {
    let cycle = session.plan.cycle_ns.unwrap_or(1_000_000).max(1);
    let of = |time: Duration| (time.as_nanos() as u64).div_ceil(cycle) as u32;
    let left = left.saturating_sub(settle(Duration::from_nanos(cycle)));
    let possible = (left.as_nanos() as u64 / cycle) as u32;
    let possible = possible.saturating_sub(session.credit.ahead().into());
    of(ecm.core.options.ramp).max(MIN_FRAMES).min(possible).max(1)
}

/// Whether only reports can tell if a slave's axis has to be braked, and one cycle does not.
fn is_strange(session: &Session, slave: u8, config: &Slave) -> bool {
    let by_targets = matches!(
        (config.axis().map(|axis| axis.mode), session.targets.last(slave)),
        (Some(Mode::Csv), Some(SlaveCommand::Csv(_))) | (Some(Mode::Csp), _)
    );
    !by_targets && still::may_move(session, slave, config)
}

/// How an axis has to be braked; `None` if it stands, is off or is homing.
fn brake(session: &Session, since: &Since, slave: u8, config: &Slave) -> Option<Brake> {
    let axis = config.axis()?;
    if !session.statusword(slave).is_enabled() || session.homing & 1 << slave != 0 {
        return None;
    }
    let last = session.targets.last(slave);
    let is_moving = since.moves(session, slave, config);
    match (axis.mode, last) {
        (Mode::Csv, Some(SlaveCommand::Csv(motion))) => {
            (motion.first.target != 0 || motion.second.target != 0).then_some(Brake::Velocity(motion))
        }
        // Somebody else has set it going. SK-4 `[OURS]`: 0x60FF is counts a second then.
        (Mode::Csv, _) if is_moving => {
            let (way, seconds) = (since.way(session, slave, config), since.seconds(session));
            let outputs = session.targets.outputs()[usize::from(slave)];
            let [first, second] =
                [0, 1].map(|i| AxisTarget { target: (f64::from(way[i]) / seconds) as i32, outputs: outputs[i] });
            Some(Brake::Velocity(Motion { first, second }))
        }
        (Mode::Cst, Some(SlaveCommand::Cst(torque))) if is_moving => Some(Brake::Torque(torque)),
        (Mode::Cst, None) if is_moving => {
            Some(Brake::Torque(DriveResponse::decode(&session.slot(slave.into())).torque))
        }
        (Mode::Csp, Some(SlaveCommand::Csp(last))) => {
            let commanded = session.targets.speeds(slave);
            // A board that ran dry has stopped already: it must not move again because of a ramp.
            let moved = still::last_cycle(session, slave, config);
            let dry = session.credit.ahead() == 0;
            let speed = [0, 1].map(|i| if dry { slower(commanded[i], f64::from(moved[i])) } else { commanded[i] });
            let moves = speed.iter().any(|counts| counts.abs() > STILL);
            moves.then_some(Brake::Position(last, speed))
        }
        // A position of somebody else's is held once its FIFO is empty.
        _ => None,
    }
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
