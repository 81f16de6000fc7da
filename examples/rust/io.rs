//! An IO slave and the board's own inputs and outputs: a light runs along the 16 outputs of the slave, and what its inputs
//! show is read back.

mod common;

use std::time::Duration;

use ecmsk::ecm::{Config, Failure, Slave};
use ecmsk::sk::MasterState;

/// How long a report may take.
const LIMIT: Duration = Duration::from_secs(1);

fn main() -> Result<(), Failure> {
    let config = Config { slaves: vec![Slave::Io], ..Config::default() };
    let ecm = common::board("sim:?slaves=io&clock=virtual", &config)?;
    println!("OP with an IO slave");

    for output in 0..16 {
        ecm.set_outputs(1, 1 << output)?;
        let now = ecm.snapshot()?.meta.at;
        // Outputs hold while nothing is written: 20 ms.
        while ecm.next_cycle(LIMIT)?.meta.at.0 < now.0 + 20_000_000 {}
        println!("output {output:2} on: inputs 0x{:04X}", ecm.inputs(1)?);
    }
    ecm.set_outputs(1, 0)?;
    println!("outputs off: inputs 0x{:04X}", ecm.inputs(1)?);

    ecm.set_local_outputs(0x15)?;
    println!("the board's outputs 0, 2 and 4 on; its inputs: 0x{:02X}", ecm.local_inputs()?);
    ecm.set_local_outputs(0)?;

    ecm.set_state(MasterState::PreOp)?;
    println!("all outputs off, PreOP, closed");
    Ok(())
}
