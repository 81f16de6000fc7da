//! Values that the manuals do not allow, and the error text for each.

use ecmsk::xf::packet::WriteError;
use ecmsk::xf::request::{
    AllPins, Analog, Arguments, DacDelay, EmergencyCount, FlashAddress, FlashBytes, FoeFile, FoeRequest, GpioChannel,
    InfoUpdate, MotorNumber, PdoDataFifo, PdoOperation, RawOperation, RawRequest, SdoOperation, SdoRequest,
    SlaveNumber, Slaves, StateSet, UpperPins,
};
use ecmsk::xf::{CheckRule, CommandCode, CommandHeader, DataSize, EtherCatState, MAX_PACKET, Request, write_request};

use crate::{Printed, bytes, slave};

/// The error text.
fn said(printed: Printed) -> String {
    printed.read(|read| read.expect_err("not allowed").to_string())
}

fn short(code: u8, par: u8, info: [u8; 4]) -> String {
    said(Printed { code, par, info, ..Printed::default() })
}

fn long(code: u8, par: u8, data: Vec<u8>) -> String {
    said(Printed { code, par, len: data.len() as u16, data, ..Printed::default() })
}

/// XF-4.4 Fields of the header: the error names the field, the value and what is allowed.
#[test]
fn values_in_the_header() {
    let off_on = "allowed is 0 off, 1 on";
    let states = "allowed is 1 Init, 2 PreOP, 3 Boot, 4 SafeOP, 8 OP";
    let pins = "mask of GPIO 16 to 19 is 16 (0x10), allowed is 0 to 15";
    let all_pins = "bits of GPIO 0 to 19 is 1048576 (0x100000), allowed is 0 to 1048575";
    let state = "402_STATE_SET state is 97 (0x61), allowed is 0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F or 0x08";
    let cases = [
        (short(12, 128, [1, 0, 0, 0]), "slave number is 128 (0x80), allowed is 0 to 127, or 255 for all"),
        (short(12, 0, [5, 0, 0, 0]), &format!("EtherCAT state is 5 (0x5), {states}")),
        (short(41, 254, [1, 0, 0, 0]), "slave number is 254 (0xFE), allowed is 0 to 127, or 255 for all"),
        (short(13, 200, [0; 4]), "slave number is 200 (0xC8), allowed is 0 to 127, or 255 for all"),
        (short(15, 255, [0; 4]), "slave number is 255 (0xFF), allowed is 0 to 127"),
        (short(15, 0, [14, 0, 0, 0]), "SLV_INFO_GET item is 14 (0xE), allowed is 0 to 13"),
        (
            short(4, 0, [0; 4]),
            "PDO_WC_GET item is 0 (0x0), allowed is 1 slaves with inputs, 2 slaves with outputs, 3 working counter",
        ),
        (short(18, 2, [0; 4]), &format!("switch is 2 (0x2), {off_on}")),
        (short(142, 2, [0; 4]), &format!("switch is 2 (0x2), {off_on}")),
        (short(19, 2, [0; 4]), "FIFO_PACK_SIZE_GET FIFO is 2 (0x2), allowed is 0 RxPDO, 1 TxPDO"),
        (short(51, 3, [0; 4]), "FIFO_CLR_OP FIFOs is 3 (0x3), allowed is 0 both, 1 TxFIFO, 2 RxFIFO"),
        (short(25, 1, [0; 4]), "CRC_TYPE_SET type is 1 (0x1), allowed is 0 fixed, 3 CRC-32"),
        (short(25, 2, [0; 4]), "CRC_TYPE_SET type is 2 (0x2), allowed is 0 fixed, 3 CRC-32"),
        (
            said(Printed { code: 23, len: 31, ..Printed::default() }),
            "SPI_RECONFIG_OP size is 31 (0x1F), allowed is 32 to 1408",
        ),
        (
            said(Printed { code: 23, len: 1409, ..Printed::default() }),
            "SPI_RECONFIG_OP size is 1409 (0x581), allowed is 32 to 1408",
        ),
        (short(26, 128, [0; 4]), "motor number is 128 (0x80), allowed is 0 to 127"),
        (short(26, 0, [0, 0, 0, 128]), "slave number is 128 (0x80), allowed is 0 to 127"),
        (short(27, 0, [0x61, 0, 0, 0]), state),
        (short(29, 0, [0, 0x5B, 0, 0]), "402_CTL_SET i1 is 91 (0x5B), allowed is 0x5A"),
        (
            short(31, 0, [0, 0, 4, 0]),
            "GPIO mode is 4 (0x4), allowed is 0 input, 1 output, 2 open drain, 3 quasi-bidirectional",
        ),
        (short(31, 8, [0, 0, 0, 3]), "GPIO pull is 3 (0x3), allowed is 0 none, 1 up, 2 down"),
        (short(31, 8, [0x10, 0, 0, 0]), pins),
        (short(31, 9, [0x10, 0, 0, 0]), pins),
        (short(31, 2, [0, 0, 2, 0]), &format!("switch is 2 (0x2), {off_on}")),
        (short(31, 3, [0x20, 0, 0, 0]), "debounce clock source is 2 (0x2), allowed is 0 192 MHz, 1 10 kHz"),
        (short(31, 1, [20, 0, 0, 0]), "GPIO channel is 20 (0x14), allowed is 0 to 19"),
        (
            short(31, 1, [0, 6, 0, 0]),
            "GPIO interrupt type is 6 (0x6), allowed is 0 off, 1 both edges, 2 falling, 3 rising, or 4, 5 of the vendor's driver",
        ),
        (short(31, 6, [0, 0, 0x10, 0]), all_pins),
        (short(32, 2, [0, 0, 0x10, 0]), all_pins),
        (
            short(75, 8, [0; 4]),
            "ASYNCCMD_RESET action is 8 (0x8), allowed is 1 clear busy, 2 skip the port's wait, 4 give up the command, or a sum of them",
        ),
        (
            short(75, 0, [0; 4]),
            "ASYNCCMD_RESET action is 0 (0x0), allowed is 1 clear busy, 2 skip the port's wait, 4 give up the command, or a sum of them",
        ),
        (short(81, 2, [0; 4]), "operation is 2 (0x2), allowed is 0 write, 1 read"),
        (short(82, 2, [0; 4]), "DIRECT_ASSIGN operation is 2 (0x2), allowed is 0 switch, 1 length"),
        (short(82, 1, [0, 2, 0, 0]), "DIRECT_ASSIGN direction is 2 (0x2), allowed is 0 output, 1 input"),
        (short(83, 0, [0; 4]), "COE_EMERGENCY count is 0 (0x0), allowed is 1 to 8"),
        (short(83, 9, [0; 4]), "COE_EMERGENCY count is 9 (0x9), allowed is 1 to 8"),
        (short(132, 0, [0; 4]), "working counter error limit is 0 (0x0), allowed is 1 to 254, or 255 for none"),
        (short(143, 2, [0; 4]), "RECV_MAILBOX operation is 2 (0x2), allowed is 0 request, 1 read"),
        (short(143, 0, [0, 1, 0, 0]), "slave number is 256 (0x100), allowed is 0 to 127"),
        (
            short(144, 3, [0; 4]),
            "MBX_STAT operation is 3 (0x3), allowed is 0 read flags, 1 set polling, 2 read polling",
        ),
    ];
    for (said, wanted) in cases {
        assert_eq!(said, wanted);
    }
}

/// XF-4.4 Fields of the data segment.
#[test]
fn values_in_the_data() {
    let numbers = |numbers: &[u32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let sdo = |operation: u8, slave: u8| long(10, 0, bytes![operation, slave, 0_u16, 0_u16, 0_u16, 0_u32]);
    let foe = |slave: u8, operation: u8, n: u32, start: u32| {
        long(139, 0, bytes![slave, 0_u8, operation, 0_u8, 0_u32, n, 0_u32, start])
    };
    let analog = "analog value is 4096 (0x1000), allowed is 0 to 4095";
    let cases = [
        (sdo(2, 0), "operation is 2 (0x2), allowed is 0 write, 1 read"),
        (sdo(1, 255), "slave number is 255 (0xFF), allowed is 0 to 127"),
        (long(50, 0, vec![128]), "slave number is 128 (0x80), allowed is 0 to 127, or 255 for all"),
        (long(8, 0, vec![0, 0, 0x14, 0x1C]), "PDO assignment is 7188 (0x1C14), allowed is 0x1C12 or 0x1C13"),
        (long(7, 0, vec![0, 4, 0x12, 0x1C]), "PDO count is 4 (0x4), allowed is at most 3"),
        (long(71, 0, vec![128]), "slave number is 128 (0x80), allowed is 0 to 127"),
        (long(72, 0, vec![128]), "slave number is 128 (0x80), allowed is 0 to 127"),
        (long(38, 0, bytes![2_u16]), "EEPROM_REQ operation is 2 (0x2), allowed is 0 read, 1 write"),
        (long(38, 0, bytes![0_u16, 128_u16]), "slave number is 128 (0x80), allowed is 0 to 127"),
        (
            long(33, 4, numbers(&[0x400])),
            "ECM_EncOpen mode is 1024 (0x400), allowed is 0x000 x4 free, 0x100 x2 free, 0x200 x4 compare, 0x300 x2 compare",
        ),
        (
            long(34, 20, numbers(&[0x20])),
            "ECM_DacOpen trigger is 32 (0x20), allowed is 0x0000, 0x0010, 0x0030, 0x1030, 0x2030 or 0x3030",
        ),
        (long(34, 22, numbers(&[1024])), "DAC delay is 1024 (0x400), allowed is 0 to 1023"),
        (long(34, 11, numbers(&[4096])), analog),
        (long(35, 40, numbers(&[1])), "ECM_AdcOpen mode is 1 (0x1), allowed is 0x000 single ended, 0x100 differential"),
        (long(35, 42, numbers(&[0, 1, 0])), "ECM_AdcConfigSampleModule trigger is 1 (0x1), allowed is 0 software"),
        (
            long(35, 17, numbers(&[0x0FFF])),
            "ECM_AdcGetDataValidFlag number is 4095 (0xFFF), allowed is 0x1000, or more bits beside it",
        ),
        (long(35, 12, numbers(&[0])), "ECM_AdcStartConv number is 0 (0x0), allowed is 0x1000, or more bits beside it"),
        (long(35, 15, numbers(&[13])), "ECM_AdcGetConvData number is 13 (0xD), allowed is 12"),
        (
            long(137, 0, bytes![3_u16]),
            "RAW_ECAT_FUNC_REQ operation is 3 (0x3), allowed is 1, 2, 4, 5, 7, 8 or 10 to 14",
        ),
        (
            foe(0, 5, 0, 0),
            "FOE_FUNC_REQ operation is 5 (0x5), allowed is 1 upload, 2 download, 3 read flash, 4 write flash",
        ),
        (foe(128, 1, 0, 0), "slave number is 128 (0x80), allowed is 0 to 127"),
        (foe(0, 3, 257, 0), "FOE_FUNC_REQ flash bytes is 257 (0x101), allowed is 0 to 256"),
        (foe(0, 4, 1, 0x4_0000), "flash address is 262144 (0x40000), allowed is 0 to 262143"),
    ];
    for (said, wanted) in cases {
        assert_eq!(said, wanted);
    }
}

/// XF-4.4 Types for numbers in a range do not accept others.
#[test]
fn numbers_stay_in_their_range() {
    assert_eq!((SlaveNumber::new(128), SlaveNumber::MAX.get()), (None, 127));
    assert_eq!((MotorNumber::new(128), MotorNumber::MAX.get()), (None, 127));
    assert_eq!((GpioChannel::new(20), GpioChannel::MAX.get()), (None, 19));
    assert_eq!((UpperPins::new(16), UpperPins::MAX.get()), (None, 15));
    assert_eq!((AllPins::new(1 << 20), AllPins::MAX.get()), (None, 0xF_FFFF));
    assert_eq!((Analog::new(4096), Analog::MAX.get()), (None, 4095));
    assert_eq!((DacDelay::new(1024), DacDelay::MAX.get()), (None, 1023));
    assert_eq!((FlashBytes::new(257), FlashBytes::MAX.get()), (None, 256));
    assert_eq!((FlashAddress::new(0x4_0000), FlashAddress::MAX.get()), (None, 0x3_FFFF));
    assert_eq!([0, 1, 8, 9].map(|n| EmergencyCount::new(n).map(EmergencyCount::get)), [None, Some(1), Some(8), None]);
    assert_eq!((Slaves::All.code(), Slaves::from(slave(7)).code()), (255, 7));
}

fn written<'d>(size: DataSize, request: impl Into<Request<'d>>) -> Result<usize, String> {
    let mut buffer = [0xA5; MAX_PACKET];
    let header = CommandHeader::with_index(1);
    match write_request(&mut buffer, size, CheckRule::CRC32, header, &request.into()) {
        Ok(packet) => Ok(packet.len()),
        Err(WriteError::Malformed(malformed)) => Err(malformed.to_string()),
        Err(other) => panic!("{other}"),
    }
}

/// XF-4.8 Requests whose data do not fit into the segment, or are more than the chip takes, are not sent.
#[test]
fn requests_that_do_not_fit() {
    let operation = PdoOperation::WRITE;
    let fifo = |data| PdoDataFifo { count: 1, operation, data };
    assert_eq!(written(DataSize::MIN, fifo(&[0; 32])), Ok(64));
    let said = "bytes of the data segment is 32 (0x20), allowed is at least 33";
    assert_eq!(written(DataSize::MIN, fifo(&[0; 33])), Err(said.to_owned()));

    let sdo = |data| SdoRequest {
        slave: slave(0),
        object: ecmsk::coe::ObjectAddress::new(0x2000, 0),
        scope: ecmsk::coe::SdoScope::Entry,
        timeout_us: 1,
        operation: SdoOperation::Write(data),
    };
    assert_eq!(written(DataSize::MANUAL, sdo(&[0; 100])), Ok(144));
    let said = "bytes of the data segment is 112 (0x70), allowed is at least 113";
    assert_eq!(written(DataSize::MANUAL, sdo(&[0; 101])), Err(said.to_owned()));
    let said = "SDO_REQ data length is 257 (0x101), allowed is at most 256";
    assert_eq!(written(DataSize::NEWER, sdo(&[0; 257])), Err(said.to_owned()));

    let raw = |data| RawRequest { operation: RawOperation::Brd, adp: 0, ado: 0, logical: 0, timeout_us: 1, data };
    assert_eq!(written(DataSize::NEWER, raw(&[0; 256])), Ok(1056));
    let said = "RAW_ECAT_FUNC_REQ data length is 257 (0x101), allowed is at most 256";
    assert_eq!(written(DataSize::NEWER, raw(&[0; 257])), Err(said.to_owned()));

    let start = FlashAddress::default();
    let said = "FOE_FUNC_REQ flash bytes is 257 (0x101), allowed is 0 to 256";
    assert_eq!(written(DataSize::NEWER, FoeRequest::WriteFlash { start, data: &[0; 257] }), Err(said.to_owned()));
    let name = b"a\0b";
    let file = FoeFile { slave: slave(0), password: 0, bytes: 0, timeout_us: 0, start, name };
    let said = "a byte of the file name is 0 (0x0), allowed is 1 to 255";
    assert_eq!(written(DataSize::NEWER, FoeRequest::Download(file)), Err(said.to_owned()));
}

/// XF-4.8 A layout that is longer than the data segment that was received is an error and no panic.
#[test]
fn segments_that_are_too_short() {
    let code = CommandCode::PdoConfigSet;
    let error = Request::decode(code, &Arguments::NONE, &[0; 32]).expect_err("112 bytes are needed");
    assert_eq!(error.to_string(), "bytes of the data segment is 32 (0x20), allowed is at least 112");
    for code in 0..=255 {
        for len in 0..32 {
            // Whether it is an error or not: no panic.
            let _ = Request::decode(CommandCode::from_code(code), &Arguments::NONE, &[0; 32][..len]);
        }
    }
}

/// XF-4.5 A request knows whether it is done at once: RECV_MAILBOX by its parameter, the others by their code.
#[test]
fn requests_know_whether_they_are_done_at_once() {
    use ecmsk::xf::request::{MailboxPart, ReceiveMailbox};
    assert!(Request::from(InfoUpdate).is_immediate());
    assert!(!Request::from(StateSet { slaves: Slaves::All, state: EtherCatState::Op }).is_immediate());
    assert!(!Request::from(ReceiveMailbox::Request { slave: slave(0) }).is_immediate());
    let part = MailboxPart::new(0, 1).expect("below 64");
    assert!(Request::from(ReceiveMailbox::Read(part)).is_immediate());
}
