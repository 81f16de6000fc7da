//! Functions that slave models do not have: the driver's error says that the chip refused the command.

use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{
    ConfigSyncManager, EepromGet, EepromOperation, EepromRequest, MailboxPart, MailboxStatus, RawGet, RawOperation,
    RawRequest, ReceiveMailbox, SlaveBits,
};

use super::Pair;
use crate::slave;

/// XF-13.2 EEPROM_REQ and EEPROM_GET (XF EN 1144, 1168).
#[test]
pub fn eeproms() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    for operation in [EepromOperation::Read, EepromOperation::Write(1)] {
        pair.is_refused(&EepromRequest { slave: slave(0), position: 8, timeout_us: 1000, operation });
    }
    pair.is_refused(&EepromGet);
}

/// XF-13.2 CONFIG_SM (XF ZH 1297).
#[test]
pub fn sync_managers() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    let sm = ConfigSyncManager { slave: slave(0), number: 2, start: 0x1100, length: 6, control: 0x64, activate: 1 };
    pair.is_refused(&sm);
}

/// XF-13.2 RAW_ECAT_FUNC_REQ and _GET (XF EN 1560, 1580).
#[test]
pub fn datagrams() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    let raw =
        RawRequest { operation: RawOperation::Brd, adp: 0, ado: 0x130, logical: 0, timeout_us: 1000, data: &[0; 2] };
    pair.is_refused(&raw);
    pair.is_refused(&RawGet);
}

/// XF-13.2 RECV_MAILBOX and MBX_STAT (XF EN 1646, 1663).
#[test]
pub fn mailboxes() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.is_refused(&ReceiveMailbox::Request { slave: slave(0) });
    pair.is_refused(&ReceiveMailbox::Read(MailboxPart::new(0, 16).expect("below 64")));
    pair.is_refused(&MailboxStatus::ReadFlags);
    pair.is_refused(&MailboxStatus::SetPolling(SlaveBits::for_slaves(3)));
    pair.is_refused(&MailboxStatus::ReadPolling);
}
