//! Round trips: every value of a type survives encoding and decoding, and any bytes are decoded without harm.

use std::collections::BTreeSet;

use ecmsk::xf::request::{Arguments, Call, Encode, Request, UnknownCommand};
use ecmsk::xf::response::Returned;
use ecmsk::xf::{
    CheckRule, CheckType, CommandCode, CommandHeader, CommandPacket, CrcCoverage, DataSize, MAX_PACKET, Reserve,
    write_request,
};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::strategy::ValueTree as _;
use proptest::test_runner::TestRunner;

use crate::codes::functions;

/// Fields of a header whose numbers are often small, so that they are often valid.
fn arguments() -> impl Strategy<Value = Arguments> {
    let byte = || prop_oneof![4 => 0u8..3, 1 => 0u8..16, 1 => Just(0x5A), 1 => Just(0xFF), 1 => any::<u8>()];
    (byte(), [byte(), byte(), byte(), byte()], any::<u16>(), prop_oneof![0u16..400, any::<u16>()])
        .prop_map(|(parameter, info, reserve, len)| Arguments { parameter, info, reserve: Reserve(reserve), len })
}

/// The data of a segment. Fields are often small, and the lists of PDOs, the fixed numbers and the lengths often valid.
fn data(n: usize) -> impl Strategy<Value = Vec<u8>> {
    // More than half of the bytes are 0, and more than half of the others below 4.
    let small = proptest::collection::vec(any::<u16>(), n).prop_map(|numbers| {
        let byte = |number: u16| match number >> 8 & 0xF {
            0..=8 => 0,
            9..=12 => number as u8 & 3,
            _ => number as u8,
        };
        numbers.into_iter().map(byte).collect::<Vec<u8>>()
    });
    let pdo = (small.clone(), 0u8..4, 0u8..9, any::<bool>()).prop_map(|(mut data, count, objects, tx)| {
        data[1] = count;
        data[2..4].copy_from_slice(&[0x12 + u8::from(tx), 0x1C]);
        data[10..16].copy_from_slice(&[objects, 0, objects / 2, 0, 1, 0]);
        data
    });
    let numbers = [0u32, 12, 12, 12, 0x10, 0x100, 0x200, 0x300, 0x1000, 0x1000, 0x1000, 0x1030, 0x2030, 0x3030];
    let fixed = (small.clone(), select(numbers.to_vec())).prop_map(|(mut data, number)| {
        data[..4].copy_from_slice(&number.to_le_bytes());
        data
    });
    let foe = (small.clone(), 1u8..=4, 0u8..100, 0u32..0x4_0000).prop_map(|(mut data, operation, bytes, start)| {
        data[..4].copy_from_slice(&[operation / 2, 0, operation, 0]);
        data[8..12].copy_from_slice(&u32::from(bytes).to_le_bytes());
        data[16..20].copy_from_slice(&start.to_le_bytes());
        data
    });
    let zeros = Just(vec![0; n]);
    prop_oneof![3 => small, 2 => pdo, 3 => fixed, 1 => foe, 1 => zeros, 1 => proptest::collection::vec(any::<u8>(), n)]
}

/// A function of the manuals: its code and fields, including its parameter if it has one.
fn known() -> impl Strategy<Value = (CommandCode, Arguments)> {
    (select(functions()), arguments()).prop_map(|((code, function), arguments)| {
        let parameter = function.unwrap_or(arguments.parameter);
        (CommandCode::from_code(code), Arguments { parameter, ..arguments })
    })
}

/// Every code with every parameter that the manuals do not have.
fn unknown() -> Vec<(u8, u8)> {
    let known = functions();
    let all = (0..=255).flat_map(|code| (0..=255).map(move |parameter| (code, parameter)));
    all.filter(|(code, parameter)| !known.contains(&(*code, None)) && !known.contains(&(*code, Some(*parameter))))
        .collect()
}

/// The request as it is built into a packet with a data segment of n bytes.
fn encoded(request: &Request<'_>, n: usize) -> Option<(CommandCode, Arguments, Vec<u8>)> {
    let mut data = vec![0; n];
    let (code, arguments) = request.command(&mut data).ok()?;
    Some((code, arguments, data))
}

/// Decodes an answer for the request's type, and encodes and decodes it again. Returns whether it could be decoded.
fn through_answer<'d, C: Call<'d>>(call: &C, returned: Returned, data: &[u8]) -> bool {
    use ecmsk::xf::response::Answer as _;
    let Ok(answer) = call.answer(returned, data) else { return false };
    let mut again = vec![0; data.len()];
    let returned = answer.encode(&mut again).expect("what was read fits");
    let second = call.answer(returned, &again).expect("what was written is read");
    assert_eq!(format!("{answer:?}"), format!("{second:?}"));
    true
}

/// Decodes an answer for the type of any request.
macro_rules! through_any_answer {
    ($request:expr, $returned:expr, $data:expr; $($variant:ident)*) => {
        match $request {
            $(Request::$variant(call) => through_answer(call, $returned, $data),)*
            Request::Unknown(_) => false,
        }
    };
}

fn any_answer(request: &Request<'_>, returned: Returned, data: &[u8]) -> bool {
    through_any_answer!(request, returned, data;
        InfoUpdate EcatInit Reconfig InitDc PdoWorkingCounterGet PdoDataFifo PdoData PdoConfigSet PdoConfigRequest
        PdoConfigGet SdoRequest SdoGet StateSet StateGet SlaveInfoGet SlaveCountGet FifoEnable FifoPackSizeGet
        SpiPackSizeGet SpiReconfig CrcErrorCountClear CrcTypeSet HelperConfigSet HelperStateSet HelperStateGet
        HelperControlSet HelperControlGet GpioSetMode GpioSetModeExt GpioEnableDebounce GpioEnableDebounceExt
        GpioSetDebounceClock GpioIntEnable GpioIntClear GpioIntClearExt GpioSetValue GpioExtSetValue GpioGetValue
        GpioExtGetValue GpioGetIntFlag GpioExtGetIntFlag EncOpen EncStart EncStop EncGetCount DacOpen DacClose
        DacSetDelayTime DacSetData DacStartConv AdcOpen AdcClose AdcConfigSampleModule AdcGetDataValidFlag AdcStartConv
        AdcGetConvData EepromRequest EepromGet StateCheck DcSync FifoClear FifoSetTxCount FifoGetTxCount FifoSetRxCount
        FifoGetRxCount FirmwareVersionGet StateUpdate InterruptSetEnable InterruptGetEnable FifoInit SdoAbortCodeGet
        FifoThresholdSet ConfigSyncManager ConfigFmmu ConfigMap HelperStatuswordGet AsyncReset Mdio DirectAssign
        CoeEmergency WarmReset WkcErrorCountGet WkcErrorMaxGet WkcErrorMaxSet RawRequest RawGet FoeRequest FoeGet
        EnableLrw ReceiveMailbox MailboxStatus)
}

/// Lengths of answers, including those that some answers need.
fn answer_len() -> impl Strategy<Value = u16> {
    prop_oneof![Just(0u16), 0u16..24, Just(112), Just(148), 0u16..400]
}

/// XF-4.5 The inputs of the properties below have requests of every function, and valid answers to each.
#[test]
fn every_function_is_tried() {
    let mut runner = TestRunner::deterministic();
    let tried = (known(), data(160), data(160), answer_len());
    let all: BTreeSet<_> = functions().into_iter().collect();
    let (mut requests, mut answers) = (BTreeSet::new(), BTreeSet::new());
    for _ in 0..20_000 {
        if answers.len() == all.len() {
            break;
        }
        let ((code, arguments), command, data, len) = tried.new_tree(&mut runner).expect("a value").current();
        if let Ok(request) = Request::decode(code, &arguments, &command) {
            let function = (code.code(), (31..=35).contains(&code.code()).then_some(arguments.parameter));
            requests.insert(function);
            if any_answer(&request, Returned { ret: 0, len }, &data) {
                answers.insert(function);
            }
        }
    }
    assert_eq!(all.difference(&requests).collect::<Vec<_>>(), Vec::<&(u8, Option<u8>)>::new());
    assert_eq!(all.difference(&answers).collect::<Vec<_>>(), Vec::<&(u8, Option<u8>)>::new());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1024))]

    /// XF-4.5 A request decoded from any fields and data is encoded and decoded to the same; XF-4.4 a forbidden value
    /// is a readable error.
    #[test]
    fn every_request_comes_back((code, arguments) in known(), data in data(300)) {
        match Request::decode(code, &arguments, &data) {
            Err(malformed) => prop_assert!(malformed.to_string().contains(", allowed is ")),
            Ok(request) => {
                prop_assert_eq!(request.code(), code);
                let again = encoded(&request, data.len());
                let (code, arguments, data) = again.expect("what was decoded fits into a segment of the same size");
                prop_assert_eq!(Request::decode(code, &arguments, &data), Ok(request));
            }
        }
    }

    /// XF-4.5 An answer to any request is decoded or refused, and a decoded one survives encoding and decoding.
    #[test]
    fn every_answer_comes_back(
        (code, arguments) in known(),
        command in data(300),
        data in data(300),
        ret: u8,
        len in answer_len(),
    ) {
        if let Ok(request) = Request::decode(code, &arguments, &command) {
            any_answer(&request, Returned { ret, len }, &data);
        }
    }

    /// XF-4.1 An unknown command survives with every field and every byte.
    #[test]
    fn unknown_commands_come_back((code, parameter) in select(unknown()), arguments in arguments(), data in data(112)) {
        let (code, arguments) = (CommandCode::from_code(code), Arguments { parameter, ..arguments });
        let unknown = Request::Unknown(UnknownCommand { code, arguments, data: &data });
        prop_assert_eq!(Request::decode(code, &arguments, &data), Ok(unknown));
        prop_assert_eq!(encoded(&unknown, 112), Some((code, arguments, data.clone())));
    }

    /// XF-1.1, XF-2.3, XF-4.5 A packet of any size with any check word survives, including its header.
    #[test]
    fn every_packet_comes_back(
        (code, arguments) in known(),
        data in data(300),
        n in 300usize..=1408,
        crc: bool,
        valid: bool,
        (index, control, gpio) in any::<(u8, u8, u16)>(),
    ) {
        let Ok(request) = Request::decode(code, &arguments, &data) else { return Ok(()) };
        let size = DataSize::new(n).expect("in range");
        let kind = if crc { CheckType::Crc32 } else { CheckType::Fixed };
        let rule = CheckRule { kind, coverage: if valid { CrcCoverage::Valid } else { CrcCoverage::All } };
        let header = CommandHeader {
            control: ecmsk::xf::Control(control),
            gpio_outputs: gpio,
            ..CommandHeader::with_index(index)
        };
        let mut buffer = [0xA5; MAX_PACKET];
        let packet = write_request(&mut buffer, size, rule, header, &request).expect("it fits");
        prop_assert_eq!(packet.len(), n + 32);
        let received = CommandPacket::parse(packet, size, rule).expect("a right packet");
        let beside = (received.header.index, received.header.control.0, received.header.gpio_outputs);
        prop_assert_eq!(beside, (index, control, gpio));
        prop_assert_eq!(received.request(), Ok(request));
        // No old bytes of the buffer remain: the packet is the same in any other.
        let mut other = [0x5A; MAX_PACKET];
        prop_assert_eq!(write_request(&mut other, size, rule, header, &request), Ok(packet));
    }

    /// XF-4.5 Any bytes decode without harm, in a segment of any size.
    #[test]
    fn any_command_decodes(
        code: u8,
        arguments in arguments(),
        data in proptest::collection::vec(any::<u8>(), 0..300),
        cut: Index,
    ) {
        let _ = Request::decode(CommandCode::from_code(code), &arguments, &data[..cut.index(data.len() + 1)]);
    }
}
