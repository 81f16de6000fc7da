//! Homing: axis 1 by its home switch and index pulse, axis 2 by its limit switch, both at once; then to 0 by CSP; then a
//! homing that fails, because the drive does not know the method, and 0 is still where it was.

mod common;

use ecmsk::ecm::{Config, EcmError, Failure, Homing};

fn main() -> Result<(), Failure> {
    let ecm = common::board("sim:?slaves=drive*2&clock=virtual", &Config::drives(2))?;

    let speeds = |method, switch, zero, offset| Homing {
        switch_speed: Some(switch),
        zero_speed: Some(zero),
        acceleration: Some(10_000_000),
        offset: Some(offset),
        ..Homing::method(method)
    };
    // By the home switch, its edge on the positive side, and the index pulse before it; by the negative limit switch,
    // which shall be at -20000.
    let axes = [(1, speeds(7, 300_000, 30_000, 0)), (2, speeds(17, 1_500_000, 50_000, -20_000))];
    let mut phases = [None; 3];
    ecm.home_all(&axes, |progress| {
        if phases[usize::from(progress.slave)].replace(progress.phase) != Some(progress.phase) {
            println!("axis {}: {:?}, at {}", progress.slave, progress.phase, progress.position);
        }
    })?;
    println!("home found: at {:?}", common::positions(&ecm)?);

    let mut stream = ecm.stream(common::AHEAD)?;
    common::go(&mut stream, &[0, 0], 500)?;
    stream.finish()?;
    println!("by CSP to 0: at {:?}", common::positions(&ecm)?);

    match ecm.home(1, &Homing::method(36), |_| {}) {
        Err(error @ EcmError::HomingFailed { .. }) => println!("{error}"),
        other => println!("a drive that homes by method 36: {other:?}"),
    }
    let mut stream = ecm.stream(common::AHEAD)?;
    common::go(&mut stream, &[1000, 0], 500)?;
    println!("{:?}", stream.finish()?);
    println!("axis 1 still knows where 0 is: at {:?}", common::positions(&ecm)?);
    Ok(())
}
