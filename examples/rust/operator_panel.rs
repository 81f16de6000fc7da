//! An operator's panel: buttons for on, off, jog, home and reset. A button at the wrong moment does no harm: the call says
//! why it does not go, and what to do.

mod common;

use ecmsk::ecm::{Config, Ecm, EcmError, Failure, Homing, Stream};

/// Counts a cycle, and how much that may change in a cycle.
const SPEED: i32 = 80;
const RAMP: i32 = 2;
/// Cycles at the end of a jog.
const SETTLING: usize = 50;
/// Cycles of a tick.
const TICK: usize = 100;

#[derive(Clone, Copy, Debug)]
enum Button {
    On,
    Off,
    Jog(u8, i32),
    Home,
    Reset,
}
use Button::{Home, Jog, Off, On, Reset};

fn main() -> Result<(), Failure> {
    let ecm = common::board("sim:?slaves=drive*2&clock=virtual", &Config::drives(2))?;
    ecm.servo_off(&[1, 2])?;
    let buttons =
        [Jog(1, 5), On, Jog(1, 8), Jog(2, -6), Jog(1, 9), On, Reset, On, Jog(2, 4), Home, Jog(1, 3), Off, Home];
    for button in buttons {
        match press(&ecm, button) {
            Ok(()) => println!("{button:?}: at {:?}", common::positions(&ecm)?),
            Err(error @ EcmError::Link(_)) => return Err(error.into()),
            Err(error) => println!("{button:?}: {error}"),
        }
    }
    Ok(())
}

fn press(ecm: &Ecm, button: Button) -> Result<(), EcmError> {
    match button {
        On => ecm.servo_on(&[1, 2]),
        Off => ecm.servo_off(&[1, 2]),
        Reset => ecm.clear_alarm(&[1, 2]),
        Home => ecm.home_all(&[(1, Homing::method(17)), (2, Homing::method(17))], |_| {}),
        Jog(slave, ticks) => jog(&mut ecm.stream(common::AHEAD)?, slave, ticks),
    }
}

/// As long as the button is held the axis moves; then it slows down. If a call fails it holds its last target.
fn jog(stream: &mut Stream<'_>, slave: u8, ticks: i32) -> Result<(), EcmError> {
    let mut target = stream.snapshot()?.position(slave).unwrap_or_default();
    let mut speed = 0;
    let mut ticks_left = ticks.unsigned_abs() as usize * TICK;
    while ticks_left > 0 || speed != 0 {
        let wanted = if ticks_left > 0 { SPEED * ticks.signum() } else { 0 };
        ticks_left = ticks_left.saturating_sub(1);
        speed += (wanted - speed).clamp(-RAMP, RAMP);
        target += speed;
        stream.csp(slave, target)?;
        stream.step()?;
    }
    // The drive makes up for its lag.
    (0..SETTLING).try_for_each(|_| stream.step().map(drop))
}
