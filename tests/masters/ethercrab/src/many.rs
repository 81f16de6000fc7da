//! 40 drives, whose process data take several frames.

use crate::rig::{DATA_MAX, InPreOp, Master, STATE, cycle, cycles, inputs, put, scan, to_op};

const COUNT: usize = 40;
/// Room for slaves: a power of two.
const ROOM: usize = 64;
const IMAGE: usize = 4096;
/// As many objects as a PDO takes, some of them twice: 46 bytes.
const INPUTS: [u32; 12] = {
    let each = [0x6064_0020, 0x606C_0020, 0x60F4_0020, 0x6062_0020, 0x60FD_0020];
    let [a, b, c, d, e] = each;
    [0x6041_0010, a, b, c, d, e, a, b, c, d, e, a]
};
const INPUT_BYTES: usize = 46;
/// The data of the first LRW, which comes after the time. ethercrab divides the image where a frame is full, in the
/// middle of a slave, which counts in both.
const FIRST_LRW: usize = DATA_MAX - 20;

pub async fn run(master: &Master) {
    let group: InPreOp<ROOM, IMAGE> = scan(master, COUNT).await;
    for slave in group.iter(master) {
        slave.sdo_write(0x1C13, 0, 0_u8).await.expect("no TxPDO");
        slave.sdo_write_array(0x1A00, INPUTS).await.expect("a mapping");
        slave.sdo_write(0x1C13, 0, 1_u8).await.expect("a TxPDO");
    }
    let group = to_op(master, group).await;
    assert!((0..COUNT).all(|n| inputs(master, &group, n).len() == INPUT_BYTES));
    let cut = u16::from(!FIRST_LRW.is_multiple_of(INPUT_BYTES));
    for _ in 0..200 {
        assert_eq!(cycle(master, &group).await.working_counter, 3 * COUNT as u16 + cut);
    }
    // Each slave has its own image.
    for n in 0..COUNT {
        put(master, &group, n, if n % 2 == 0 { 0x06 } else { 0x00 }, n as i32);
    }
    cycles(master, &group, 20).await;
    for n in 0..COUNT {
        let inputs = inputs(master, &group, n);
        let state = u16::from_le_bytes([inputs[0], inputs[1]]) & STATE;
        assert_eq!(state, if n % 2 == 0 { 0x21 } else { 0x40 }, "drive {n}");
    }
}
