//! Two drives from nothing to OP with distributed clocks: EEPROM, SDOs, aborts, and a path in CSP.

use ethercrab::error::{CoeAbortCode, Error, MailboxError};

use crate::rig::{
    Master, OPERATION_ENABLED, STATE, cycle, cycles, drive, enable, put, scan, to_op_with_clocks, wait_for,
};

pub async fn run(master: &Master) {
    let group = scan(master, 2).await;
    for slave in group.iter(master) {
        let identity = slave.identity();
        let mut by_sdo = [0_u32; 3];
        for (value, sub) in by_sdo.iter_mut().zip(1_u8..) {
            *value = slave.sdo_read(0x1018, sub).await.expect("0x1018");
        }
        assert_eq!([identity.vendor_id, identity.product_id, identity.revision], by_sdo, "EEPROM and 0x1018");
        // Values of 1, 2 and 4 bytes, there and back.
        slave.sdo_write(0x6060, 0, 8_u8).await.expect("CSP");
        assert_eq!(slave.sdo_read::<u8>(0x6060, 0).await, Ok(8));
        slave.sdo_write(0x6072, 0, 900_u16).await.expect("0x6072");
        assert_eq!(slave.sdo_read::<u16>(0x6072, 0).await, Ok(900));
        slave.sdo_write(0x6065, 0, 123_456_u32).await.expect("0x6065");
        assert_eq!(slave.sdo_read::<u32>(0x6065, 0).await, Ok(123_456));
        let aborted = |code, address, sub_index| Error::Mailbox(MailboxError::Aborted { code, address, sub_index });
        let missing = slave.sdo_read::<u32>(0x5123, 0).await;
        assert_eq!(missing, Err(aborted(CoeAbortCode::NotFound, 0x5123, 0)));
        let read_only = slave.sdo_write(0x1018, 1, 0_u32).await;
        assert_eq!(read_only, Err(aborted(CoeAbortCode::ReadOnlyWrite, 0x1018, 1)));
    }
    let group = to_op_with_clocks(master, group).await;
    let stand = [enable(master, &group, 0).await, enable(master, &group, 1).await];
    for step in 1..=500 {
        put(master, &group, 0, 0x0F, stand[0] + 20 * step);
        put(master, &group, 1, 0x0F, stand[1] - 10 * step);
        assert_eq!(cycle(master, &group).await.working_counter, 6);
    }
    let ends = [stand[0] + 10_000, stand[1] - 5_000];
    let arrived = async || {
        cycle(master, &group).await;
        [0, 1].iter().all(|n| (drive(master, &group, *n).1 - ends[*n]).abs() <= 1)
    };
    wait_for("the ends of the paths", arrived).await;
    cycles(master, &group, 10).await;
    assert!([0, 1].iter().all(|n| drive(master, &group, *n).0 & STATE == OPERATION_ENABLED));
    let group = group.into_safe_op(master).await.expect("SafeOP");
    let group = group.into_pre_op(master).await.expect("PreOP");
    group.into_init(master).await.expect("Init");
}
