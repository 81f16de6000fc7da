//! Objects, EEPROMs, datagrams, files, mailboxes.

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::xf::Request;
use ecmsk::xf::request::{
    CoeEmergency, EepromGet, EepromOperation, EepromRequest, EmergencyCount, FlashAddress, FlashBytes, FoeFile, FoeGet,
    FoeRequest, MailboxPart, MailboxStatus, RawGet, RawOperation, RawRequest, ReceiveMailbox, SdoAbortCodeGet, SdoGet,
    SdoOperation, SdoRequest, SlaveBits,
};

use super::{case, long, short};
use crate::{Printed, bytes, slave};

/// XF-7.1 SDO_REQ; XF-7.2 which bytes are the data of a write; XF-4.3 a read is one whatever its length says.
/// XF EN 579: @0 operation, @1 slave, @2 index, @4 sub-index, @6 bytes, @8 time limit, @12 data.
#[test]
pub fn sdo_requests() {
    let request = SdoRequest {
        slave: slave(2),
        object: ObjectAddress::new(0x6060, 3),
        scope: SdoScope::Entry,
        timeout_us: 100_000,
        operation: SdoOperation::Read { bytes: 0x0104 },
    };
    let most = [0x5A; 256];
    let written = |data: &[u8]| {
        let head = bytes![0_u8, 2_u8, 0x6060_u16, 3_u8, 0_u8, data.len() as u16, 100_000_u32];
        long(10, 0, [&head, data].concat())
    };
    case(request, long(10, 0, bytes![1_u8, 2_u8, 0x6060_u16, 3_u8, 0_u8, 0x0104_u16, 100_000_u32]));
    case(
        SdoRequest { scope: SdoScope::Complete, ..request },
        long(10, 0, bytes![1_u8, 2_u8, 0x6060_u16, 3_u8, 1_u8, 0x0104_u16, 100_000_u32]),
    );
    case(SdoRequest { operation: SdoOperation::Write(&[8, 9]), ..request }, written(&[8, 9]));
    case(SdoRequest { operation: SdoOperation::Write(&most), ..request }, written(&most));
    case(SdoGet, short(11, 0, [0; 4]));
    case(SdoAbortCodeGet, short(69, 0, [0; 4]));
    let write = |bytes: u16, len: u16| {
        let data = bytes![0_u8, 2_u8, 0x6060_u16, 0_u8, 0_u8, bytes, 100_u32, 0x0403_0201_u32];
        Printed { len, ..long(10, 0, data) }
    };
    write(2, 16).read(|read| match read {
        Ok(Request::SdoRequest(request)) => assert_eq!(request.operation, SdoOperation::Write(&[1, 2])),
        other => panic!("{other:?}"),
    });
    for (printed, said) in [
        (write(4, 15), "SDO_REQ valid data length is 15 (0xF), allowed is at least 16"),
        (write(257, 400), "SDO_REQ data length is 257 (0x101), allowed is at most 256"),
    ] {
        printed.read(|read| assert_eq!(read.expect_err("no request").to_string(), said));
    }
    let read = bytes![1_u8, 2_u8, 0x6060_u16, 0_u8, 7_u8, 4_u16, 100_u32];
    Printed { len: 0, ..long(10, 0, read) }.read(|read| match read {
        Ok(Request::SdoRequest(request)) => assert_eq!(request.scope, SdoScope::Complete),
        other => panic!("{other:?}"),
    });
}

/// XF-7.4 The EEPROM's 0 is to read. XF ZH 1096: @0 0 read, 1 write, @2 slave, @4 position, @6 data, @8 time limit.
#[test]
pub fn eeprom_requests() {
    let request =
        EepromRequest { slave: slave(100), position: 0x0102, timeout_us: 20_000, operation: EepromOperation::Read };
    case(request, long(38, 0, bytes![0_u16, 100_u16, 0x0102_u16, 0_u16, 20_000_u32]));
    case(
        EepromRequest { operation: EepromOperation::Write(0xABCD), ..request },
        long(38, 0, bytes![1_u16, 100_u16, 0x0102_u16, 0xABCD_u16, 20_000_u32]),
    );
    case(EepromGet, short(39, 0, [0; 4]));
}

/// XF-7.5 Datagrams; XF-4.3 drivers send 137 with length 276, so that byte 2 says how many data there are.
/// XF EN 1560: @0 operation, @2 n, @4 ADP, @6 ADO, @8 logical, @12 time limit, @20 data.
#[test]
pub fn raw_requests() {
    use RawOperation::*;
    let numbered = [
        (Aprd, 1),
        (Apwr, 2),
        (Fprd, 4),
        (Fpwr, 5),
        (Brd, 7),
        (Bwr, 8),
        (Lrd, 10),
        (Lwr, 11),
        (Lrw, 12),
        (Armw, 13),
        (Frmw, 14),
    ];
    case(RawGet, short(138, 0, [0; 4]));
    for (operation, code) in numbered {
        let (adp, ado, logical) = (0x1001, 0x0130, 0xAABB_CCDD);
        let request = RawRequest { operation, adp, ado, logical, timeout_us: -2, data: &[7, 8, 9] };
        let head = bytes![code as u8, 0_u8, 3_u16, 0x1001_u16, 0x0130_u16, 0xAABB_CCDD_u32, -2_i32, 0_u32];
        case(request, long(137, 0, [&head[..], &[7, 8, 9]].concat()));
    }
    let data = bytes![1_u16, 2_u16, 3_u16, 4_u16, 5_u32, 6_i32, 0_u32, 0x0807_u16];
    Printed { len: 276, ..long(137, 0, data) }.read(|read| match read {
        Ok(Request::RawRequest(request)) => assert_eq!(request.data, [7, 8]),
        other => panic!("{other:?}"),
    });
    long(137, 0, bytes![1_u16, 257_u16]).read(|read| {
        let said = "RAW_ECAT_FUNC_REQ data length is 257 (0x101), allowed is at most 256";
        assert_eq!(read.expect_err("too many").to_string(), said);
    });
}

/// XF-7.7 Files and flash memory; XF-7.8 where the name of a file ends.
/// XF EN 1598: @0 slave, @2 operation, @4 password, @8 bytes, @12 time limit, @16 start, @20 name or data.
#[test]
pub fn foe_requests() {
    let start = FlashAddress::new(0x3_FFFF).expect("in range");
    let file = FoeFile {
        slave: slave(6),
        password: 0x1234_5678,
        bytes: 70_000,
        timeout_us: 5_000_000,
        start,
        name: b"firmware.bin",
    };
    let file_bytes = |operation: u8| {
        let head = bytes![6_u8, 0_u8, operation, 0_u8, 0x1234_5678_u32, 70_000_u32, 5_000_000_u32, 0x3_FFFF_u32];
        [&head[..], b"firmware.bin"].concat()
    };
    let most = [0xC3; 256];
    let head = |operation: u8, n: u32| bytes![0_u16, operation, 0_u8, 0_u32, n, 0_u32, 0x3_FFFF_u32];
    case(FoeRequest::Upload(file), long(139, 0, file_bytes(1)));
    case(FoeRequest::Download(file), long(139, 0, file_bytes(2)));
    case(FoeRequest::ReadFlash { start, bytes: FlashBytes::MAX }, long(139, 0, head(3, 256)));
    case(FoeRequest::WriteFlash { start, data: &most }, long(139, 0, [&head(4, 256)[..], &most].concat()));
    case(FoeGet, short(140, 0, [0; 4]));
    let data = [&bytes![6_u16, 1_u16, 0_u32, 0_u32, 0_u32, 0_u32][..], b"a.bin\0rest"].concat();
    for (len, name) in [(20 + 10, &b"a.bin"[..]), (22, b"a."), (20, b"a.bin"), (0, b"a.bin"), (2000, b"a.bin")] {
        Printed { len, ..long(139, 0, data.clone()) }.read(|read| match read {
            Ok(Request::FoeRequest(FoeRequest::Upload(file))) => assert_eq!(file.name, name, "length {len}"),
            other => panic!("{other:?}"),
        });
    }
}

/// XF-7.9 Emergencies, XF-7.10 mailboxes and the parts of them that can be asked for. XF EN 1490, 1646.
#[test]
pub fn mailbox_requests() {
    let part = MailboxPart::new(63, 17).expect("below 64");
    let count = EmergencyCount::new(8).expect("1 to 8");
    case(ReceiveMailbox::Request { slave: slave(127) }, short(143, 0, [127, 0, 0, 0]));
    case(ReceiveMailbox::Read(part), short(143, 1, [63, 0, 17, 0]));
    case(CoeEmergency { count }, short(83, 8, [0; 4]));
    assert_eq!((MailboxPart::new(64, 1), MailboxPart::new(0, 64)), (None, None));
    short(143, 1, [1, 2, 3, 4]).read(|read| match read {
        Ok(Request::ReceiveMailbox(ReceiveMailbox::Read(part))) => {
            assert_eq!((part.start(), part.length()), (2 * 64 + 1, 4 * 64 + 3));
        }
        other => panic!("{other:?}"),
    });
}

/// XF-7.11 Sets of slaves; XF-4.3 all bits are read whatever the length says.
/// XF EN 1663: par 1: ceil(slaves / 8) bytes, bit b of byte k is slave 8 k + b.
#[test]
pub fn mailbox_status_requests() {
    let slaves = SlaveBits::for_slaves(20).with(slave(0)).with(slave(9)).with(slave(19));
    assert!(slaves.contains(slave(9)) && !slaves.contains(slave(8)) && slaves.bytes() == 3);
    case(MailboxStatus::ReadFlags, short(144, 0, [0; 4]));
    case(MailboxStatus::SetPolling(slaves), long(144, 1, vec![0b0000_0001, 0b0000_0010, 0b0000_1000]));
    case(MailboxStatus::ReadPolling, short(144, 2, [0; 4]));
    Printed { len: 0, ..long(144, 1, vec![0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x80]) }.read(
        |read| match read {
            Ok(Request::MailboxStatus(MailboxStatus::SetPolling(slaves))) => assert!(slaves.contains(slave(127))),
            other => panic!("{other:?}"),
        },
    );
    assert_eq!([0, 1, 8, 9, 128, 255].map(|n| SlaveBits::for_slaves(n).bytes()), [0, 1, 1, 2, 16, 16]);
}
