//! Moves one axis, by 10,000 counts: `cargo run --example move_axis -- 'sim:?slaves=drive'`, or any other link.

use ecmsk::ecm::{Close, Config, Ecm, Failure};
use ecmsk::sk::MasterState;

fn main() -> Result<(), Failure> {
    let link = std::env::args().nth(1).unwrap_or("sim:?slaves=drive".to_owned());
    let ecm = Ecm::open(&link)?;
    ecm.set_state(MasterState::PreOp)?;
    ecm.configure(&Config::drives(1))?;
    ecm.set_state(MasterState::Op)?;
    ecm.servo_on(&[1])?;
    let mut stream = ecm.stream(20)?;
    let start = stream.snapshot()?.position(1).unwrap_or_default();
    for n in 1..=1000 {
        stream.csp(1, start + 10 * n)?; // however the stream ends, no frame leads beyond the last one
        stream.step()?;
    }
    println!("{:?}", stream.finish()?);
    Ok(ecm.close(Close::ServoOff)?)
}
