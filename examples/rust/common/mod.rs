//! What the examples share: a board that is on, and a smooth way for its axes.
#![allow(dead_code, reason = "every example takes its part")]

use ecmsk::ecm::{Close, Config, Ecm, EcmError, Options, Stream};
use ecmsk::sk::MasterState;

/// Frames that a program may be ahead of the board, so that a stutter of its own does no harm.
pub const AHEAD: u16 = 20;

/// The board that the first argument names, or that of `link`, in OP with all axes on. However the program ends, axes that
/// move are ramped to a standstill and switched off.
pub fn board(link: &str, config: &Config) -> Result<Ecm, EcmError> {
    let link = std::env::args().nth(1).unwrap_or_else(|| link.to_owned());
    let ecm = Ecm::open_with(&link, Options { close: Close::ServoOff, ..Options::default() })?;
    ecm.set_state(MasterState::PreOp)?;
    ecm.configure(config)?;
    ecm.set_state(MasterState::Op)?;
    let axes: Vec<u8> = (1..).zip(&config.slaves).filter(|(_, slave)| slave.axis().is_some()).map(|(n, _)| n).collect();
    ecm.servo_on(&axes)?;
    Ok(ecm)
}

/// Share of a way after `n` of `cycles`: 0 to 1, without a step in speed or acceleration.
pub fn smooth(n: u32, cycles: u32) -> f64 {
    let t = f64::from(n) / f64::from(cycles);
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

/// Moves axes 1, 2, .. from where they are to `goal`, all at once, and waits until the last target is executed.
pub fn go(stream: &mut Stream<'_>, goal: &[i32], cycles: u32) -> Result<(), EcmError> {
    let from = stream.snapshot()?;
    for n in 1..=cycles + u32::from(AHEAD) + 100 {
        for (slave, goal) in (1..).zip(goal) {
            let start = from.position(slave).unwrap_or_default();
            let way = f64::from(goal - start) * smooth(n.min(cycles), cycles);
            stream.csp(slave, start + way.round() as i32)?;
        }
        stream.step()?;
    }
    Ok(())
}

/// Actual positions of axes 1 and 2.
pub fn positions(ecm: &Ecm) -> Result<[i32; 2], EcmError> {
    let snapshot = ecm.snapshot()?;
    Ok([1, 2].map(|slave| snapshot.position(slave).unwrap_or_default()))
}
