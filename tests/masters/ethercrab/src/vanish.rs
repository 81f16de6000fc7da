//! Slaves that vanish and come back: behind a cut they go on; one that has lost its power is found by a new scan, since ethercrab
//! 0.7.1 configures no single slave.

use ethercrab::SubDeviceState;
use ethercrab::subdevice_group::NoDc;

use crate::rig::{InOp, InPreOp, Master, cycle, fault, scan, to_op, wait_for};

const ALL: [SubDeviceState; 3] = [SubDeviceState::Op; 3];

async fn counts(master: &Master, group: &InOp<NoDc>, counter: u16) {
    let what = format!("the working counter {counter}");
    wait_for(&what, async || cycle(master, group).await.working_counter == counter).await;
}

pub async fn run(master: &Master) {
    let group: InPreOp = scan(master, 3).await;
    let group = to_op(master, group).await;
    counts(master, &group, 9).await;

    fault("cut 3");
    counts(master, &group, 6).await;
    let states = cycle(master, &group).await.subdevice_states;
    assert_eq!(states[..], [SubDeviceState::Op, SubDeviceState::Op, SubDeviceState::None], "states behind the cut");
    fault("heal");
    // It is in OP, since its watchdog time is long and has not expired.
    counts(master, &group, 9).await;
    assert_eq!(cycle(master, &group).await.subdevice_states[..], ALL);

    fault("lose 2");
    counts(master, &group, 6).await;
    fault("find 2");
    let states = cycle(master, &group).await.subdevice_states;
    assert_eq!(
        states[..],
        [SubDeviceState::Op, SubDeviceState::None, SubDeviceState::Op],
        "it has no address any more"
    );
    drop(group);
    let group: InPreOp = scan(master, 3).await;
    let group = to_op(master, group).await;
    counts(master, &group, 9).await;
    assert_eq!(cycle(master, &group).await.subdevice_states[..], ALL);
}
