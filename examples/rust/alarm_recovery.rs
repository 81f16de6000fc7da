//! Two axes go round a square. A drive has an alarm on the way: the other axis is stopped, the alarm is
//! cleared, the axis switched on, and the way goes on. An alarm that stays ends the program, with all axes off.
//!
//! `cargo run --example alarm_recovery -- 'sim:?slaves=drive*2&script=examples/scripts/alarm_on_the_way.ecmscript'`

mod common;

use ecmsk::ecm::{Config, Ecm, EcmError, Failure};

const SIDE: i32 = 1_000_000;
const PATH: [[i32; 2]; 5] = [[0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE], [0, 0]];

fn main() -> Result<(), Failure> {
    let ecm = common::board("sim:?slaves=drive*2&clock=virtual", &Config::drives(2))?;
    for corner in PATH {
        while let Err(error) = go(&ecm, corner) {
            let EcmError::Alarm { slave, code } = error else { return Err(error.into()) };
            let at = common::positions(&ecm)?;
            println!("  axis {slave}: alarm 0x{code:04X}, stopped at {at:?}");
            ecm.clear_alarm(&[slave])?;
            ecm.servo_on(&[slave])?;
            println!("  cleared, on again");
        }
        println!("corner {corner:?}: at {:?}", common::positions(&ecm)?);
    }
    println!("losses: {}", ecm.stats()?.losses);
    Ok(())
}

/// However it ends, the axes hold their last targets.
fn go(ecm: &Ecm, corner: [i32; 2]) -> Result<(), EcmError> {
    let mut stream = ecm.stream(common::AHEAD)?;
    common::go(&mut stream, &corner, 1000)?;
    stream.finish().map(drop)
}
