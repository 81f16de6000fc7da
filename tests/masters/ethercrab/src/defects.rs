//! Functions that ethercrab 0.7.1 lacks, whatever the slave. With a newer version that has them this fails, and the
//! page on slaves is wrong.

use ethercrab::error::Error;

use crate::rig::{InPreOp, Master, scan};

pub async fn run(master: &Master) {
    let group: InPreOp = scan(master, 1).await;
    let slave = group.iter(master).next().expect("a slave");
    // 0x4FFF takes up to 512 bytes.
    slave.sdo_write(0x4FFF, 0, [1_u8, 2, 3, 4]).await.expect("4 bytes");
    assert_eq!(slave.sdo_read::<[u8; 4]>(0x4FFF, 0).await, Ok([1, 2, 3, 4]));
    assert_eq!(slave.sdo_write(0x4FFF, 0, [0_u8; 5]).await, Err(Error::Internal), "nothing longer is sent");
    assert_eq!(slave.sdo_read::<[u8; 4]>(0x4FFF, 0).await, Ok([1, 2, 3, 4]), "nothing was sent");
}
