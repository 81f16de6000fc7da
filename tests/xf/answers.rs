//! Every answer byte by byte, as the manuals print it, both ways.

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::xf::packet::AnswerError;
use ecmsk::xf::request::*;
use ecmsk::xf::response::{
    DriveStateByte, EepromAnswer, Emergencies, Emergency, FirmwareIdentity, FirmwareVersion, MdioAnswer, PdoExchange,
    RawAnswer, Series, SlaveInfo,
};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CrcCoverage, DataSize, Interrupts, MAX_PACKET, NetworkState, Received,
    Status, write_answer,
};

use crate::codes::{check_all, note_checked};
use crate::{bytes, crc32, motor, slave};

const SIZE: DataSize = DataSize::NEWER;

/// An answer packet as in the manual, with a CRC-32 computed here as its check word.
fn packet(code: u8, ret: u8, len: u16, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xA4, 0xA3, 0xA2, 0xA1, 0, 0, 0, 0, 0, 0, 3, 9, code, ret];
    bytes.extend(len.to_le_bytes());
    bytes.extend([0; 8]);
    bytes.extend(data);
    bytes.resize(24 + SIZE.bytes(), 0);
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes.extend([0x59, 0x58, 0x57, 0x56]);
    bytes
}

/// Decodes an answer to `call` with the library.
fn read<'d, 'a, C: Call<'d>>(call: &C, bytes: &'a [u8]) -> Result<C::Answer<'a>, AnswerError> {
    match AnswerPacket::parse(bytes, SIZE, CrcCoverage::All) {
        Ok(Received::Answer(packet)) => packet.answer_to(call),
        other => panic!("{other:?}"),
    }
}

/// Checks that the answer to `call` is encoded to the printed bytes, and that these are decoded to it.
fn case<'d, 'a, C: Call<'d>>(call: C, answer: C::Answer<'a>, ret: u8, data: &'a [u8]) {
    let code = C::CODE.code();
    let wanted = packet(code, ret, data.len() as u16, data);
    let mut buffer = [0xA5; MAX_PACKET];
    let header = AnswerHeader { index: 9, code: C::CODE, status: Status::NONE, ..AnswerHeader::default() };
    let made = write_answer(&mut buffer, SIZE, CheckRule::CRC32, header, &answer).expect("it fits");
    assert_eq!(made, wanted, "{answer:?}");
    let decoded = read(&call, &wanted).expect("a result");
    assert_eq!(format!("{decoded:?}"), format!("{answer:?}"));
    note_checked(code, C::FUNCTION);
}

/// The error text for a wrong answer.
fn refused<'d, C: Call<'d>>(call: C, len: u16, data: &[u8]) -> String {
    match read(&call, &packet(C::CODE.code(), 0, len, data)) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("an answer of {len} bytes was read"),
    }
}

/// XF EN 1580: @0 operation, @2 n, @4 ADP, @6 ADO, @8 logical, @12 time limit, @16 working counter, @20 data.
const RAW: &[u8] = &[5, 0, 2, 0, 1, 0x10, 0x20, 1, 0xDD, 0xCC, 0xBB, 0xAA, 100, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF, 8, 9];

fn raw_answer() -> RawAnswer<'static> {
    let (adp, ado, logical) = (0x1001, 0x0120, 0xAABB_CCDD);
    RawAnswer { operation: 5, adp, ado, logical, timeout_us: 100, working_counter: -1, data: &[8, 9] }
}

/// XF-4.1 These tests check the bytes of the answer to every function of the manuals.
#[test]
fn the_answer_to_every_function_is_checked_byte_by_byte() {
    check_all(&[
        answers_about_slaves,
        answers_with_configured_pdos,
        answers_with_process_data,
        answers_of_slaves,
        answers_of_the_chip,
        answers_of_the_helper,
        answers_of_inputs,
    ]);
}

/// XF-5.4, XF-5.6 States and numbers; XF-5.5 items about slaves by the length of the answer, a name of 4 bytes too.
#[test]
fn answers_about_slaves() {
    let (one, item) = (slave(1), SlaveInfoItem::Vendor);
    let info = |item| SlaveInfoGet { slave: one, item };
    case(InfoUpdate, (), 0, &[]);
    case(
        EcatInit {
            special_slaves: false,
            reference_clock: ReferenceClock::Chip,
            lrw: true,
            fifo_on: false,
            dc: DcTiming::default(),
        },
        (),
        0,
        &[],
    );
    case(Reconfig, (), 0, &[]);
    case(InitDc, (), 0, &[]);
    case(StateUpdate, (), 0, &[]);
    case(ConfigMap, (), 0, &[]);
    case(EnableLrw { lrw: true }, (), 0, &[]);
    case(DcSync { slaves: Slaves::All, dc: DcTiming::default() }, (), 0, &[]);
    case(DirectAssign::Switch { slave: one, on: true }, (), 0, &[]);
    case(ConfigFmmu { slave: one, functions: [0; 4] }, (), 0, &[]);
    case(ConfigSyncManager { slave: one, number: 0, start: 0, length: 0, control: 0, activate: 0 }, (), 0, &[]);
    case(PdoWorkingCounterGet { which: WorkingCounterItem::Counter }, 0x0102_0304, 0, &[4, 3, 2, 1]);
    case(StateGet { slaves: Slaves::All }, NetworkState(0x14), 0x14, &[]);
    case(SlaveCountGet, 128, 128, &[]);
    case(info(item), SlaveInfo::U32(0x0000_0539), 0, &[0x39, 5, 0, 0]);
    case(info(SlaveInfoItem::Alias), SlaveInfo::U16(0x0201), 0, &[1, 2]);
    case(info(SlaveInfoItem::HasDc), SlaveInfo::U8(1), 0, &[1]);
    case(info(SlaveInfoItem::Name), SlaveInfo::Text(b"EL10"), 0, b"EL10");
    case(info(SlaveInfoItem::Product), SlaveInfo::Text(&[1, 2, 3]), 0, &[1, 2, 3]);
    for state in [ecmsk::xf::EtherCatState::Op, ecmsk::xf::EtherCatState::Boot] {
        case(StateSet { slaves: Slaves::All, state }, (), 0, &[]);
        case(StateCheck { slaves: Slaves::All, state }, (), 0, &[]);
    }
    assert_eq!([SlaveInfo::U8(1), SlaveInfo::U16(2), SlaveInfo::U32(3)].map(SlaveInfo::number), [1, 2, 3].map(Some));
    assert_eq!(SlaveInfo::Text(b"EL10").number(), None);
    let said = "valid data length is 3 (0x3), allowed is at least 4";
    assert_eq!(refused(PdoWorkingCounterGet { which: WorkingCounterItem::Inputs }, 3, &[1, 2, 3]), said);
}

/// XF-6.4 The configuration of PDOs in both lengths.
/// XF EN 533: the layout of 7 in 112 bytes; with 4 PDOs mappings @4, counts @12, objects @20 in 148 bytes (OBS).
#[test]
fn answers_with_configured_pdos() {
    let map = |index, sub| {
        let object = MappedObject::new(ObjectAddress::new(0x6040, sub), 16);
        PdoMap::new(index, &[object]).expect("an object")
    };
    let maps = [map(0x1600, 0), map(0x1601, 1), map(0x1602, 2), map(0x1603, 3)];
    let config = |form, maps| PdoConfig::new(slave(3), PdoAssignment::Rx, form, maps).expect("it has room");
    let (three, four) = (PdoConfigForm::Three, PdoConfigForm::Four);
    let mut short = bytes![3_u8, 3_u8, 0x1C12_u16, 0x1600_u16, 0x1601_u16, 0x1602_u16, 1_u16, 1_u16, 1_u16];
    let mut long =
        bytes![3_u8, 4_u8, 0x1C12_u16, 0x1600_u16, 0x1601_u16, 0x1602_u16, 0x1603_u16, 1_u16, 1_u16, 1_u16, 1_u16,];
    for sub in 0..4 {
        let object = [16, sub, 0x40, 0x60];
        for (bytes, head, maps) in [(&mut short, 16, 3), (&mut long, 20, 4)] {
            if usize::from(sub) < maps {
                bytes.resize(head + 32 * usize::from(sub), 0);
                bytes.extend(object);
            }
        }
    }
    short.resize(112, 0);
    long.resize(148, 0);
    let (short, long): (&[u8], &[u8]) = (short.leak(), long.leak());
    assert_eq!(PdoConfig::new(slave(3), PdoAssignment::Rx, three, &maps), None, "3 PDOs at most");
    case(PdoConfigGet, config(three, &maps[..3]), 0, short);
    case(PdoConfigGet, config(four, &maps), 0, long);
    case(PdoConfigRequest { slave: slave(3), assignment: PdoAssignment::Tx }, (), 0, &[]);
    case(PdoConfigSet::new(slave(3), PdoAssignment::Rx, &maps[..3]).expect("3"), (), 0, &[]);
    let said = "PDO_CONFIG_GET valid data length is 111 (0x6F), allowed is 112 or 148";
    assert_eq!(refused(PdoConfigGet, 111, &[]), said);
    let many = bytes![0_u8, 1_u8, 0x1C12_u16, 0x1600_u16, 0_u16, 0_u16, 9_u16];
    assert_eq!(refused(PdoConfigGet, 112, &many), "PDO object count is 9 (0x9), allowed is at most 8");
    assert_eq!(refused(PdoConfigGet, 112, &[0, 4, 0x12, 0x1C]), "PDO count is 4 (0x4), allowed is at most 3");
}

/// XF-6.1, XF-6.2 Process data; XF-6.5 sizes and entries.
#[test]
fn answers_with_process_data() {
    let data = &[1, 2, 3, 4, 5, 6];
    let both = PdoOperation::WRITE | PdoOperation::READ;
    let fifo = PdoDataFifo { count: 1, operation: both, data };
    let failed = PdoExchange { done: PdoOperation::FAILED, data: &[] };
    case(fifo, PdoExchange { done: both, data }, 3, data);
    case(fifo, failed, 0x80, &[]);
    case(PdoData { operation: both, data }, PdoExchange { done: PdoOperation(7), data }, 7, data);
    case(FifoPackSizeGet { fifo: Fifo::Tx }, 0x0102, 0, &[2, 1]);
    case(FifoGetTxCount, 64, 64, &[]);
    case(FifoGetRxCount, 255, 255, &[]);
    case(FifoSetTxCount { entries: 1 }, (), 0, &[]);
    case(FifoSetRxCount { entries: 1 }, (), 0, &[]);
    case(FifoClear { fifos: Fifos::Both }, (), 0, &[]);
    case(FifoEnable { on: true }, (), 0, &[]);
    case(FifoInit, (), 0, &[]);
    case(FifoThresholdSet { tx_high: None, rx_low: None }, (), 0, &[]);
}

/// XF-7.3 Objects and why they failed; XF-7.4 EEPROM; XF-7.6 datagrams, by byte 2 whatever the length; XF-7.7 flash
/// memory; XF-7.9 emergencies; XF-7.10, XF-7.11 mailboxes.
#[test]
fn answers_of_slaves() {
    let sdo = SdoRequest {
        slave: slave(0),
        object: ObjectAddress::new(0x1000, 0),
        scope: ecmsk::coe::SdoScope::Entry,
        timeout_us: 0,
        operation: SdoOperation::Read { bytes: 4 },
    };
    let raw = RawRequest { operation: RawOperation::Brd, adp: 0, ado: 0, logical: 0, timeout_us: 0, data: &[0] };
    let eeprom = EepromRequest { slave: slave(0), position: 0, timeout_us: 0, operation: EepromOperation::Read };
    let start = FlashAddress::default();
    let emergency =
        Emergency { number: 0, slave: 3, running_number: 0x0102, code: 0xFF10, register: 0x20, data: [1, 2, 3, 4, 5] };
    let list = Emergencies::new(&[Some(emergency), None]).expect("2 of 8");
    assert_eq!((list.places().len(), list.iter().copied().collect::<Vec<_>>()), (2, vec![emergency]));
    let count = EmergencyCount::new(2).expect("1 to 8");
    let listed = &[0, 3, 2, 1, 0x10, 0xFF, 0x20, 1, 2, 3, 4, 5, 0xFF, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let full = SlaveBits::for_slaves(16).with(slave(0)).with(slave(15));
    case(sdo, (), 0, &[]);
    case(SdoGet, &[1, 2, 3][..], 0, &[1, 2, 3]);
    case(SdoAbortCodeGet, AbortCode::NO_OBJECT, 0, &[0, 0, 2, 6]);
    case(eeprom, (), 0, &[]);
    case(EepromGet, EepromAnswer { error: 7, data: &[1; 8] }, 7, &[1; 8]);
    case(raw, (), 0, &[]);
    case(RawGet, raw_answer(), 0, RAW);
    case(FoeRequest::ReadFlash { start, bytes: FlashBytes::MAX }, (), 0, &[]);
    case(FoeGet, &[9; 256][..], 0, &[9; 256]);
    case(CoeEmergency { count }, list, 0, listed);
    case(ReceiveMailbox::Read(MailboxPart::new(0, 3).expect("below 64")), &[5, 6, 7][..], 0, &[5, 6, 7]);
    case(MailboxStatus::ReadFlags, full, 0, &[1, 0x80]);
    for len in [4 + 2, 20 + 2, 2, 0] {
        assert_eq!(read(&RawGet, &packet(138, 0, len, RAW)), Ok(raw_answer()), "length {len}");
    }
    assert_eq!(raw_answer().operation(), Some(RawOperation::Fpwr));
    assert_eq!(RawAnswer { operation: 3, ..raw_answer() }.operation(), None);
    let count = EmergencyCount::new(1).expect("1 to 8");
    let said = "COE_EMERGENCY valid data length is 13 (0xD), allowed is a multiple of 12, at most 96";
    assert_eq!(refused(CoeEmergency { count }, 13, &[]), said);
    assert!(refused(CoeEmergency { count }, 108, &[]).starts_with("COE_EMERGENCY valid data length is 108"));
    assert_eq!(Emergencies::new(&[None; 9]), None);
}

/// XF-8.1 Sizes; XF-8.3 the version in both lengths; XF-8.4 interrupts; XF-8.6 limits; XF-8.7 registers.
#[test]
fn answers_of_the_chip() {
    let enable = InterruptEnable {
        polarity: Polarity::INT0_HIGH,
        sources: Interrupts::ETHERCAT,
        gpio: 1,
        peripherals: PeripheralInterrupts::GPIO_11,
    };
    // XF EN 1285: @0 extended version, @3 series, @4 identification.
    let identified = &[1, 2, 0, 3, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25];
    let identification = std::array::from_fn(|i| 10 + i as u8);
    let identity = FirmwareIdentity { extended: 0x0201, series: Series(3), identification };
    case(SpiPackSizeGet, DataSize::XFU, 0, &[0xE0, 0x03]);
    case(SpiReconfig { size: DataSize::MIN }, (), 0, &[]);
    case(CrcErrorCountClear, 5, 5, &[]);
    case(CrcTypeSet { kind: ecmsk::xf::CheckType::Crc32 }, (), 0, &[]);
    case(FirmwareVersionGet, FirmwareVersion { version: 0x1A, identity: None }, 0x1A, &[]);
    case(FirmwareVersionGet, FirmwareVersion { version: 0x22, identity: Some(identity) }, 0x22, identified);
    case(InterruptSetEnable { enable }, (), 0, &[]);
    case(InterruptGetEnable, enable, 2, &[0, 0, 0, 0x80, 1, 8]);
    case(AsyncReset::new(AsyncResetActions::GIVE_UP).expect("a known bit"), (), 0, &[]);
    case(WarmReset, (), 0, &[]);
    case(WkcErrorCountGet, 17, 17, &[]);
    case(WkcErrorMaxGet, WkcErrorLimit::from_code(0), 0, &[]);
    case(WkcErrorMaxGet, WkcErrorLimit::NONE, 255, &[]);
    case(WkcErrorMaxSet::new(WkcErrorLimit::NONE).expect("not 0"), (), 0, &[]);
    case(Mdio::Write { phy: 0, register: 0, value: 0 }, MdioAnswer(None), 0, &[]);
    case(Mdio::Read { phy: 0, register: 0 }, MdioAnswer(Some(0x7849)), 0, &[0x49, 0x78]);
    let said = "FW_VERSION_GET valid data length is 19 (0x13), allowed is 0 or 20";
    assert_eq!(refused(FirmwareVersionGet, 19, &[]), said);
    assert_eq!(refused(SpiPackSizeGet, 2, &[31, 0]), "SPI_PACK_SIZE_GET size is 31 (0x1F), allowed is 32 to 1408");
}

/// XF-9.4 The readable values of an axis; XF-9.3 bit 5 does not matter where CiA 402 ignores it.
#[test]
fn answers_of_the_helper() {
    let (motor, slave) = (motor(0), slave(0));
    let (controlword_offset, statusword_offset, control) = (0, 0, HelperControl::ON);
    case(HelperConfigSet { motor, controlword_offset, statusword_offset, control, slave }, (), 0, &[]);
    case(HelperStateSet { motor, state: DriveState::OperationEnabled }, (), 0, &[]);
    case(HelperStateGet { motor }, DriveStateByte(0x27), 0x27, &[]);
    case(HelperControlSet { motor, control, motors: 1, slave }, (), 0, &[]);
    case(HelperControlGet { motor }, control, 0x10, &[]);
    case(HelperStatuswordGet { motor }, Statusword(0x1637), 0, &[0x37, 0x16]);
    use DriveState::*;
    for (code, state) in [
        (0x00, NotReadyToSwitchOn),
        (0x20, NotReadyToSwitchOn),
        (0x40, SwitchOnDisabled),
        (0x60, SwitchOnDisabled),
        (0x0F, FaultReactionActive),
        (0x2F, FaultReactionActive),
        (0x08, Fault),
        (0x28, Fault),
        (0x21, ReadyToSwitchOn),
        (0x23, SwitchedOn),
        (0x27, OperationEnabled),
        (0x07, QuickStopActive),
    ] {
        assert_eq!(DriveStateByte(code).state(), Some(state), "0x{code:02X}");
    }
    assert_eq!(DriveStateByte(0x01).state(), None);
    assert_eq!(DriveStateByte::from(Fault), DriveStateByte(8));
}

/// XF-10.3 Inputs and flags; XF-10.4 counts; XF-10.6 values of the ADC.
#[test]
fn answers_of_inputs() {
    let (mode, pull, on) = (GpioMode::Input, GpioPull::None, true);
    let (upper, pins) = (UpperPins::default(), AllPins::default());
    let clock = DebounceClock::new(0, DebounceSource::Khz10).expect("0 to 15");
    let channel = GpioChannel::default();
    case(GpioSetMode { pins: 0, mode, pull }, (), 0, &[]);
    case(GpioSetModeExt { pins: upper, mode, pull }, (), 0, &[]);
    case(GpioEnableDebounce { pins: 0, on }, (), 0, &[]);
    case(GpioEnableDebounceExt { pins: upper, on }, (), 0, &[]);
    case(GpioSetDebounceClock { clock }, (), 0, &[]);
    case(GpioIntEnable { channel, trigger: GpioTrigger::Off }, (), 0, &[]);
    case(GpioIntClear { pins: 0 }, (), 0, &[]);
    case(GpioIntClearExt { pins }, (), 0, &[]);
    case(GpioSetValue { values: 0 }, (), 0, &[]);
    case(GpioExtSetValue { values: pins }, (), 0, &[]);
    case(GpioGetValue, 0x8001, 0, &[0x01, 0x80]);
    case(GpioExtGetValue, 0x000F_8001, 0, &[0x01, 0x80, 0x0F, 0]);
    case(GpioGetIntFlag, 0x4002, 0, &[0x02, 0x40]);
    case(GpioExtGetIntFlag, 0x0001_4002, 0, &[0x02, 0x40, 0x01, 0]);
    case(EncOpen { mode: EncoderMode::X4Free }, (), 0, &[]);
    case(EncStart, (), 0, &[]);
    case(EncStop, (), 0, &[]);
    case(EncGetCount, 0x0102_0304, 0, &[4, 3, 2, 1]);
    case(DacOpen { trigger: DacTrigger::SetData }, (), 0, &[]);
    case(DacClose, (), 0, &[]);
    case(DacSetDelayTime { delay: DacDelay::MAX }, (), 0, &[]);
    case(DacSetData { value: Analog::MAX }, (), 0, &[]);
    case(DacStartConv, (), 0, &[]);
    case(AdcOpen { mode: AdcMode::Differential }, (), 0, &[]);
    case(AdcClose, (), 0, &[]);
    case(AdcConfigSampleModule, (), 0, &[]);
    case(AdcGetDataValidFlag, 0x1000, 0, &[0, 0x10, 0, 0]);
    case(AdcStartConv, (), 0, &[]);
    case(AdcGetConvData, Analog::MAX, 0, &[0xFF, 0x0F, 0, 0]);
    let said = "analog value is 4096 (0x1000), allowed is 0 to 4095";
    assert_eq!(refused(AdcGetConvData, 4, &[0, 0x10, 0, 0]), said);
}
