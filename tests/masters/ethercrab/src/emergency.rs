//! A drive with a fault sends an emergency: ethercrab reads and drops waiting mail before a request.

use crate::rig::{
    FAULT, InPreOp, Master, OPERATION_ENABLED, STATE, cycle, cycles, drive, enable, fault, scan, to_op, wait_for,
};

pub async fn run(master: &Master) {
    let group: InPreOp = scan(master, 2).await;
    for slave in group.iter(master) {
        slave.sdo_write(0x6060, 0, 8_u8).await.expect("CSP");
    }
    let group = to_op(master, group).await;
    for n in [0, 1] {
        enable(master, &group, n).await;
    }
    fault("alarm 2 0x7500");
    let is_in_fault = async || {
        cycle(master, &group).await;
        drive(master, &group, 1).0 & FAULT != 0
    };
    wait_for("the fault", is_in_fault).await;
    // The emergency waits in the mailbox by then; if it came as the answer, ethercrab 0.7.1 would panic.
    cycles(master, &group, 50).await;
    let slave = group.subdevice(master, 1).expect("a slave");
    assert_eq!(slave.register_read::<u8>(0x080D_u16).await.map(|status| status & 0x08), Ok(0x08), "a full mailbox");
    assert_eq!(slave.sdo_read::<u16>(0x603F, 0).await, Ok(0x7500));
    assert_eq!(drive(master, &group, 0).0 & STATE, OPERATION_ENABLED, "the other drive goes on");
    enable(master, &group, 1).await;
    cycles(master, &group, 50).await;
    assert_eq!(slave.sdo_read::<u16>(0x603F, 0).await, Ok(0));
}
