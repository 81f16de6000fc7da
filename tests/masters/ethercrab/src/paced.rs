//! 40 drives, switched on, that get a target in each cycle of 1 ms, for `benches/nic`. It prints `begin` before the
//! measured cycles, and `end` after them.

use std::time::Duration;

use async_io::Timer;
use futures_lite::StreamExt;

use crate::rig::{InOp, InPreOp, Master, OPERATION_ENABLED, STATE, drive, put, scan, to_op};

const COUNT: usize = 40;
/// Room for slaves: a power of two.
const ROOM: usize = 64;
const IMAGE: usize = 1024;
const CYCLE: Duration = Duration::from_millis(1);
const WARM_UP: usize = 500;
const MEASURED: usize = 2000;
/// Cycles for each step of switching on: the brake takes its time.
const SWITCHING: usize = 300;
/// The distance between two targets, and the cycles after which the axes turn back.
const STEP: i32 = 20;
const STROKE: usize = 1000;

pub async fn run(master: &Master) {
    let group: InPreOp<ROOM, IMAGE> = scan(master, COUNT).await;
    let group = to_op(master, group).await;
    let mut timer = Timer::interval(CYCLE);
    let mut target = 0;
    for controlword in [0x06, 0x07, 0x0F] {
        for _ in 0..SWITCHING {
            cycle(master, &group, &mut timer, controlword, target).await;
        }
    }
    for n in 0..COUNT {
        assert_eq!(drive(master, &group, n).0 & STATE, OPERATION_ENABLED, "drive {n} is on");
    }
    for n in 0..WARM_UP + MEASURED {
        if n == WARM_UP {
            println!("begin");
        }
        target += if n % (2 * STROKE) < STROKE { STEP } else { -STEP };
        cycle(master, &group, &mut timer, 0x0F, target).await;
    }
    println!("end");
}

async fn cycle<D>(master: &Master, group: &InOp<D, ROOM, IMAGE>, timer: &mut Timer, controlword: u16, target: i32) {
    timer.next().await;
    (0..COUNT).for_each(|n| put(master, group, n, controlword, target));
    let answer = group.tx_rx_sync_system_time(master).await.expect("process data");
    assert_eq!(answer.working_counter, 3 * COUNT as u16, "all drives answer");
}
