//! `master_virtual`: a virtual cycle of the modelled board with 40 drives in CSP behind slave controllers that our own master
//! reaches by frames, as over `nic:`; the baseline is the same program on the board over the simulated bus of `sim:`.

#[path = "common/board.rs"]
mod board;
mod common;

use board::Program;

const DRIVES: usize = 40;

fn main() {
    let (mut on_wires, mut simulated) = (board::drives_in_op_on_wires(DRIVES), board::drives_in_op(DRIVES));
    let (mut ours, mut baseline) = (Program::new(&mut on_wires, DRIVES), Program::new(&mut simulated, DRIVES));
    let against = Some("the same program on sim:");
    let demand = common::Demand { name: "master_virtual", target: Some(5.0), allowance: None, against };
    common::pair_of_calls(demand, || ours.cycle(), || baseline.cycle());
    ours.assert_well();
    baseline.assert_well();
}
