//! The golden packets, both ways: bytes from types and types from bytes.

use ecmsk::cia402::Statusword;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::xf::packet::write_not_ready;
use ecmsk::xf::request::{
    DcTiming, EcatInit, FirmwareVersionGet, InfoUpdate, InterruptEnable, InterruptSetEnable, MappedObject,
    PdoAssignment, PdoConfigSet, PdoDataFifo, PdoMap, PdoOperation, PeripheralInterrupts, Polarity, ReferenceClock,
    SdoOperation, SdoRequest, Slaves, SpiReconfig, StateGet, StateSet,
};
use ecmsk::xf::response::{FirmwareIdentity, FirmwareVersion, PdoExchange, Series};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckType, CommandCode, CommandHeader, CommandPacket, Control, DataSize, Errors,
    EtherCatState, Interrupts, MAX_PACKET, NetworkState, Received, Request, Reserve, Status, write_answer,
    write_request,
};
use vectors::xf::{Packet, packet_named, packets};

use crate::slave;

/// The request of a golden command. Its data are those of the vector's file.
fn request<'d>(name: &str, data: &'d [u8]) -> Request<'d> {
    let all_op = StateSet { slaves: Slaves::All, state: EtherCatState::Op };
    let dc = |sync0_ns, shift_ns| DcTiming { assign_activate: 0x0300, sync0_ns, sync1_ns: 0, shift_ns };
    let init = |reference_clock, lrw, dc| EcatInit { special_slaves: false, reference_clock, lrw, fifo_on: false, dc };
    match name {
        "info-update-fixed" | "info-update-crc32" | "header-gpio" => InfoUpdate.into(),
        "ecat-init-1ms" => init(ReferenceClock::Chip, false, dc(1_000_000, 250_000)).into(),
        "ecat-init-lrw-master-shift" => init(ReferenceClock::FirstSlave, true, dc(2_000_000, -125_000)).into(),
        "state-set-op" => all_op.into(),
        "sdo-req-write" => sdo(2, 0x6060, SdoOperation::Write(&[8])).into(),
        "crc-valid-only" => sdo(0, 0x6041, SdoOperation::Read { bytes: 2 }).into(),
        "pdo-fifo-rw" => PdoDataFifo { count: 1, operation: PdoOperation::WRITE | PdoOperation::READ, data }.into(),
        "pdo-fifo-two" => PdoDataFifo { count: 2, operation: PdoOperation::WRITE, data }.into(),
        "pdo-config-set" => {
            let objects = [(0x6040, 16), (0x607A, 32)];
            let objects = objects.map(|(index, bits)| MappedObject::new(ObjectAddress::new(index, 0), bits));
            let map = PdoMap::new(0x1600, &objects).expect("2 objects");
            PdoConfigSet::new(slave(1), PdoAssignment::Rx, &[map]).expect("1 PDO").into()
        }
        "int-set-enable" => {
            let enable = InterruptEnable {
                polarity: Polarity::INT0_HIGH,
                sources: Interrupts::ETHERCAT | Interrupts::TX_FIFO_HIGH,
                gpio: 0x0F,
                peripherals: PeripheralInterrupts::ENCODER_INDEX,
            };
            InterruptSetEnable { enable }.into()
        }
        "spi-reconfig-1024" => SpiReconfig { size: DataSize::NEWER }.into(),
        other => panic!("say what {other} means"),
    }
}

fn sdo(n: u8, index: u16, operation: SdoOperation<'_>) -> SdoRequest<'_> {
    let object = ObjectAddress::new(index, 0);
    SdoRequest { slave: slave(n), object, scope: SdoScope::Entry, timeout_us: 100_000, operation }
}

/// The fields of a golden command's header that do not belong to the request.
fn beside(packet: &Packet) -> CommandHeader {
    CommandHeader {
        control: Control(packet.field("control") as u8),
        reserve: Reserve(packet.field("reserve") as u16 & 0x8000),
        interrupt_clear: Interrupts(packet.field("interrupt_clear")),
        gpio_interrupt_clear: u16::from_le_bytes(packet.field_bytes("gpio_interrupt_clear")),
        gpio_outputs: u16::from_le_bytes(packet.field_bytes("gpio_out")),
        ..CommandHeader::with_index(packet.field("index") as u8)
    }
}

/// XF-1.4 Every golden command is encoded to its bytes; XF-1.5 whatever was in the buffer; XF-2.6 SPI_RECONFIG_OP has
/// the fixed check word although a CRC-32 is set.
#[test]
fn golden_commands_encode_to_their_bytes() {
    for packet in packets().iter().filter(|packet| !packet.is_answer) {
        let data = packet.data();
        let request = request(&packet.name, &data);
        let mut rule = packet.rule;
        if packet.name == "spi-reconfig-1024" {
            rule.kind = CheckType::Crc32;
        }
        let mut buffer = [0xA5; MAX_PACKET];
        let made = write_request(&mut buffer, packet.size, rule, beside(packet), &request).expect("it fits");
        assert_eq!(made, packet.bytes, "{}", packet.name);
        assert!(buffer[packet.bytes.len()..].iter().all(|byte| *byte == 0xA5), "{}", packet.name);
    }
}

/// XF-1.4 Every golden command is decoded to the fields and the meaning it was made from.
#[test]
fn golden_commands_decode_to_their_fields() {
    for vector in packets().iter().filter(|packet| !packet.is_answer) {
        let packet = CommandPacket::parse(&vector.bytes, vector.size, vector.rule).expect("a right packet");
        let wanted = CommandHeader {
            info: vector.field_bytes("info"),
            code: CommandCode::from_code(vector.field("cmd") as u8),
            parameter: vector.field("param") as u8,
            len: vector.field("size") as u16,
            reserve: Reserve(vector.field("reserve") as u16),
            ..beside(vector)
        };
        assert_eq!(packet.header, wanted, "{}", vector.name);
        let data = vector.data();
        assert_eq!(packet.data.len(), vector.size.bytes());
        assert_eq!(&packet.data[..data.len()], data, "{}", vector.name);
        assert_eq!(packet.request(), Ok(request(&vector.name, &data)), "{}", vector.name);
    }
}

/// The header of a golden answer.
fn answer_header(packet: &Packet) -> AnswerHeader {
    AnswerHeader {
        crc_errors: packet.field("crc_errors") as u8,
        wkc_errors: packet.field("wkc_errors") as u8,
        tx_fifo: packet.field("tx_fifo") as u8,
        rx_fifo: packet.field("rx_fifo") as u8,
        state: NetworkState(packet.field("state") as u8),
        errors: Errors(packet.field("error") as u8),
        status: Status(packet.field("status") as u8),
        index: packet.field("index") as u8,
        code: CommandCode::from_code(packet.field("cmd") as u8),
        ret: packet.field("ret") as u8,
        len: packet.field("size") as u16,
        interrupts: Interrupts(packet.field("interrupts")),
        gpio_interrupts: 0,
        gpio_inputs: 0,
    }
}

/// XF-1.4 Every golden answer is encoded to its bytes, XF-1.5 whatever was in the buffer.
#[test]
fn golden_answers_encode_to_their_bytes() {
    for packet in packets().iter().filter(|packet| packet.is_answer) {
        let (header, data) = (answer_header(packet), packet.data());
        let mut buffer = [0xA5; MAX_PACKET];
        let (size, rule) = (packet.size, packet.rule);
        let made = match packet.name.as_str() {
            "answer-state-get" => write_answer(&mut buffer, size, rule, header, &NetworkState::from(EtherCatState::Op)),
            "answer-fifo-read" => {
                let done = PdoOperation::WRITE | PdoOperation::READ;
                write_answer(&mut buffer, size, rule, header, &PdoExchange { done, data: &data })
            }
            "answer-nop" | "answer-busy-command-error" => write_answer(&mut buffer, size, rule, header, &()),
            "answer-fw-0" | "answer-fw-20" => write_answer(&mut buffer, size, rule, header, &version(&packet.name)),
            "answer-not-ready" => write_not_ready(&mut buffer, size, header),
            other => panic!("say what {other} means"),
        };
        assert_eq!(made.expect("it fits"), packet.bytes, "{}", packet.name);
    }
}

fn version(name: &str) -> FirmwareVersion {
    if name == "answer-fw-0" {
        return FirmwareVersion { version: 0x1A, identity: None };
    }
    let identification = std::array::from_fn(|i| i as u8);
    let identity = FirmwareIdentity { extended: 0x0122, series: Series(2), identification };
    FirmwareVersion { version: 0x22, identity: Some(identity) }
}

/// XF-1.4 Every golden answer is decoded to the fields it was made from; XF-2.5 one of them is no answer: the chip was
/// not ready.
#[test]
fn golden_answers_decode_to_their_fields() {
    for vector in packets().iter().filter(|packet| packet.is_answer) {
        let received = AnswerPacket::parse(&vector.bytes, vector.size, vector.rule.coverage).expect("a right packet");
        let Received::Answer(packet) = received else {
            assert_eq!(vector.name, "answer-not-ready");
            continue;
        };
        assert_eq!(packet.header, answer_header(vector), "{}", vector.name);
        assert_eq!(packet.header.status.check_type(), Ok(vector.rule.kind));
        let data = vector.data();
        assert_eq!(&packet.data[..data.len()], data, "{}", vector.name);
    }
}

/// XF-1.4 The golden answers have the results that they were made from.
#[test]
fn golden_answers_have_their_results() {
    let op = with_answer("answer-state-get", |packet| packet.answer_to(&StateGet { slaves: Slaves::All }));
    assert_eq!(op, Ok(NetworkState(8)));

    let operation = PdoOperation::WRITE | PdoOperation::READ;
    let read = with_answer("answer-fifo-read", |packet| {
        let exchange = packet.answer_to(&PdoDataFifo { count: 1, operation, data: &[] }).expect("a result");
        assert_eq!((packet.header.tx_fifo, packet.header.rx_fifo), (3, 7));
        (exchange.done, Statusword(u16::from_le_bytes([exchange.data[0], exchange.data[1]])), exchange.data.len())
    });
    assert_eq!(read, (operation, Statusword(0x1637), 12));

    for name in ["answer-fw-0", "answer-fw-20"] {
        assert_eq!(with_answer(name, |packet| packet.answer_to(&FirmwareVersionGet)), Ok(version(name)));
    }
    let busy = with_answer("answer-busy-command-error", |packet| (packet.header.errors, packet.header.status));
    assert_eq!(busy.0, Errors::COMMAND);
    assert!(busy.1.contains(Status::BUSY));
}

fn with_answer<T>(name: &str, look: impl FnOnce(&AnswerPacket<'_>) -> T) -> T {
    let vector = packet_named(name);
    match AnswerPacket::parse(&vector.bytes, vector.size, vector.rule.coverage) {
        Ok(Received::Answer(packet)) => look(&packet),
        other => panic!("{name}: {other:?}"),
    }
}

/// XF-1.4, XF-2.2 Every golden packet carries the check word that its file names.
#[test]
fn golden_packets_carry_their_check_word() {
    for packet in packets() {
        let at = packet.bytes.len() - 8;
        assert_eq!(packet.bytes[at..at + 4], packet.check.to_le_bytes(), "{}", packet.name);
    }
}
