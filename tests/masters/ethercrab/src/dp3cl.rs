//! A DP3CL is homed and moved by profiles and in CSP, with distributed clocks and the process data of power-on; another
//! one is at rest meanwhile.

use ethercrab::subdevice_group::HasDc;

use crate::rig::{
    InOp, Master, OPERATION_ENABLED, STATE, cycle, cycles, inputs, put, scan, to_op_with_clocks, wait_for,
};

const HOMING: i8 = 6;
const PROFILE_POSITION: i8 = 1;
const CSP: i8 = 8;
/// Bits of the statusword: target reached; homing attained, or the set-point is taken; homing error.
const REACHED: u16 = 1 << 10;
const ATTAINED: u16 = 1 << 12;
const HOMING_ERROR: u16 = 1 << 13;

/// The inputs of a DP3CL.
struct Seen {
    status: u16,
    mode: i8,
    position: i32,
}

fn seen(master: &Master, group: &InOp<HasDc>, n: usize) -> Seen {
    let inputs = inputs(master, group, n);
    assert_eq!(inputs.len(), 19, "inputs of a DP3CL");
    let word = |at| u16::from_le_bytes([inputs[at], inputs[at + 1]]);
    let position = i32::from_le_bytes([inputs[5], inputs[6], inputs[7], inputs[8]]);
    Seen { status: word(2), mode: inputs[4] as i8, position }
}

async fn until(master: &Master, group: &InOp<HasDc>, what: &str, is_so: impl Fn(Seen) -> bool) {
    let asked = async || {
        cycle(master, group).await;
        is_so(seen(master, group, 0))
    };
    wait_for(what, asked).await;
}

async fn choose(master: &Master, group: &InOp<HasDc>, mode: i8) {
    let slave = group.subdevice(master, 0).expect("a slave");
    slave.sdo_write(0x6060, 0, mode).await.expect("a mode");
    until(master, group, &format!("mode {mode}"), |seen| seen.mode == mode).await;
}

pub async fn run(master: &Master) {
    let group = scan(master, 2).await;
    assert!(group.iter(master).all(|slave| slave.identity().vendor_id == 0x0556), "Xinje");
    let group = to_op_with_clocks(master, group).await;
    let slave = group.subdevice(master, 0).expect("a slave");

    // Home on the negative limit switch, then at the present position.
    for method in [17_i8, 37] {
        put(master, &group, 0, 0x00, 0);
        choose(master, &group, HOMING).await;
        slave.sdo_write(0x6098, 0, method).await.expect("a method");
        for sub in [1_u8, 2] {
            slave.sdo_write(0x6099, sub, 20_000_u32).await.expect("a speed");
        }
        for (control, state) in [(0x06, 0x21), (0x07, 0x23), (0x0F, OPERATION_ENABLED)] {
            put(master, &group, 0, control, 0);
            until(master, &group, "Operation enabled", |seen| seen.status & STATE == state).await;
        }
        put(master, &group, 0, 0x1F, 0);
        // The result of the previous homing clears first.
        cycles(master, &group, 10).await;
        until(master, &group, "homing", |seen| seen.status & ATTAINED != 0).await;
        assert_eq!(seen(master, &group, 0).status & HOMING_ERROR, 0, "homing error with method {method}");
    }
    assert_eq!(seen(master, &group, 0).position, 0, "where it stands is home");

    put(master, &group, 0, 0x0F, 0);
    cycles(master, &group, 5).await;
    choose(master, &group, PROFILE_POSITION).await;
    slave.sdo_write(0x6081, 0, 20_000_u32).await.expect("a speed");
    for ramp in [0x6083, 0x6084] {
        slave.sdo_write(ramp, 0, 200_000_u32).await.expect("a ramp");
    }
    for target in [5_000, 12_000, 3_000] {
        put(master, &group, 0, 0x2F, target);
        cycles(master, &group, 5).await;
        put(master, &group, 0, 0x3F, target);
        until(master, &group, "the set-point is taken", |seen| seen.status & ATTAINED != 0).await;
        put(master, &group, 0, 0x2F, target);
        until(master, &group, "the target", |seen| seen.position == target && seen.status & REACHED != 0).await;
    }

    let begin = seen(master, &group, 0).position;
    put(master, &group, 0, 0x0F, begin);
    choose(master, &group, CSP).await;
    for step in 1..=200 {
        put(master, &group, 0, 0x0F, begin + 10 * step);
        assert_eq!(cycle(master, &group).await.working_counter, 6);
    }
    until(master, &group, "the end of the path", |seen| seen.position == begin + 2_000).await;
    assert_eq!(seen(master, &group, 0).status & STATE, OPERATION_ENABLED);
    assert_eq!(seen(master, &group, 1).position, 0, "the other one has stood");
}
