//! Velocity and torque instead of positions: axis 1 in CSV, axis 2 in CST, both along ramps. An axis in CSV runs on for
//! ever when nothing more is written, one in CST gets faster and faster: the stream's end brings axis 1 to a standstill,
//! and axis 2, whose torque nobody can know better, is braked by the program.

mod common;

use ecmsk::ecm::{Axis, Config, EcmError, Failure, Slave, Stream};

/// Counts a cycle, at which the torque on axis 2 is taken back.
const FAST: i32 = 400;

fn main() -> Result<(), Failure> {
    let slaves = vec![Slave::Drive(Axis::CSV), Slave::Drive(Axis::CST)];
    let ecm = common::board("sim:?slaves=drive*2&clock=virtual", &Config { slaves, ..Config::default() })?;
    let mut stream = ecm.stream(4)?;
    let mut velocity = 0;
    for wanted in [500_000, -250_000] {
        while velocity != wanted {
            velocity += (wanted - velocity).clamp(-2000, 2000);
            stream.csv(1, velocity)?;
            stream.step()?;
        }
        (0..200).try_for_each(|_| stream.step().map(drop))?;
        println!("axis 1 at velocity {velocity}: position {}", position(&stream, 1)?);
    }
    for torque in [60, -60] {
        let fastest = push(&mut stream, torque)?;
        println!("axis 2 pushed by {torque} per mille: {fastest} counts a cycle, stands at {}", position(&stream, 2)?);
    }
    let stats = stream.finish()?;
    println!("axis 1 ramped to a standstill at {}; {stats:?}", common::positions(&ecm)?[0]);
    Ok(())
}

/// Torque until axis 2 is fast, then against its motion until it stands; the slower, the softer.
fn push(stream: &mut Stream<'_>, torque: i16) -> Result<i32, EcmError> {
    let (mut speed, mut fastest) = (0, 0_i32);
    let mut accelerates = true;
    while accelerates || speed * i32::from(torque.signum()) > 1 {
        let brake = if speed.abs() > 40 { -torque } else { -torque / 4 };
        stream.cst(2, if accelerates { torque } else { brake })?;
        let from = position(stream, 2)?;
        (0..8).try_for_each(|_| stream.step().map(drop))?;
        speed = (position(stream, 2)? - from) / 8;
        accelerates &= speed.abs() < FAST;
        fastest = if speed.abs() > fastest.abs() { speed } else { fastest };
    }
    stream.cst(2, 0)?;
    Ok(fastest)
}

fn position(stream: &Stream<'_>, slave: u8) -> Result<i32, EcmError> {
    Ok(stream.snapshot()?.position(slave).unwrap_or_default())
}
