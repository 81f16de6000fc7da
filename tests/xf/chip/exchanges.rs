//! Packets: the order of answers, errors, check words, sizes, resets, the stream of bytes.

use ecmsk::xf::chip::{ChipPort, Profile};
use ecmsk::xf::request::{
    AsyncReset, AsyncResetActions, CrcErrorCountClear, CrcTypeSet, FifoGetRxCount, FifoSetRxCount, FirmwareVersionGet,
    InfoUpdate, InitDc, SdoOperation, SlaveCountGet, SpiPackSizeGet, SpiReconfig, StateUpdate, WarmReset,
};
use ecmsk::xf::{
    AnswerPacket, CheckRule, CheckType, CommandCode, CommandHeader, Control, CrcCoverage, DataSize, Errors,
    EtherCatState, NetworkState, Received, Resync, Status, write_request,
};

use super::{Host, MS, is_not_ready};
use crate::network::{INIT, sdo, to_all};

/// XF-11.1 The answer in an exchange belongs to the command of the one before; the first one after a start belongs to
/// none.
#[test]
fn answers_come_with_the_next_exchange() {
    let mut host = Host::with_drives();
    let first = host.send(&SpiPackSizeGet);
    assert!(first.has(Status::NOP));
    assert_eq!((first.header.index, first.header.code), (0, CommandCode::InfoUpdate));
    let second = host.send(&FirmwareVersionGet);
    assert_eq!((second.header.index, second.to(&SpiPackSizeGet)), (1, DataSize::NEWER));
    let third = host.send(&InfoUpdate);
    assert_eq!((third.header.index, third.to(&FirmwareVersionGet).version), (2, 0x22));
    // INFO_UPDATE_OP itself is a command like others.
    let fourth = host.send(&InfoUpdate);
    assert_eq!((fourth.header.code, fourth.has(Status::NOP)), (CommandCode::InfoUpdate, false));
}

/// XF-11.2 A packet with index and code of the one before is not run again: its answer has the NOP flag, both echoed,
/// length 0 and return value 0. Its header is processed all the same.
#[test]
fn repeated_packets_are_not_run() {
    let mut host = Host::with_drives();
    let header = CommandHeader::with_index(77);
    host.send_with(header, &FifoGetRxCount);
    assert_eq!(host.send_with(header, &FifoGetRxCount).header.ret, 64);
    for _ in 0..3 {
        let repeated = host.send_with(header, &FifoGetRxCount);
        assert!(repeated.has(Status::NOP));
        assert_eq!((repeated.header.index, repeated.header.code), (77, CommandCode::FifoGetRxCount));
        assert_eq!((repeated.header.ret, repeated.header.len), (0, 0));
    }
    // The same index with another code is another command.
    host.send_with(header, &FirmwareVersionGet);
    let got = host.send_with(header, &FifoSetRxCount { entries: 0 });
    assert_eq!(got.to(&FirmwareVersionGet).version, 0x22);
    let clear = CommandHeader { control: Control::CLEAR_ALL, ..header };
    assert_eq!(host.send_with(clear, &FifoSetRxCount { entries: 0 }).errors(), Errors::COMMAND);
    let got = host.send(&InfoUpdate);
    assert_eq!((got.has(Status::NOP), got.errors()), (true, Errors::NONE));
}

/// XF-11.3 A packet with a wrong check word, or a wrong start or end word, is not run: it is counted, with its error
/// bit, and answered with NOP. The errors stay until they are cleared, the count until CRC_ERR_CNT_CLR.
#[test]
fn damaged_packets_are_counted() {
    let mut host = Host::with_drives();
    host.rule = CheckRule::FIXED;
    let size = host.chip.size();
    let damage = [(24 + size.bytes(), Errors::CRC), (0, Errors::SPI), (size.packet_len() - 1, Errors::SPI)];
    let mut all = Errors::NONE;
    for (count, (at, error)) in (1..).zip(damage) {
        let mut bytes = host.packet(CommandHeader::with_index(100 + count), &FifoSetRxCount { entries: 9 });
        bytes[at] ^= 0x10;
        host.exchange_bytes(&bytes);
        let got = host.send(&InfoUpdate);
        all = all | error;
        assert!(got.has(Status::NOP));
        assert_eq!((got.header.index, got.header.code), (100 + count, CommandCode::FifoSetRxCount));
        assert_eq!((got.header.crc_errors, got.errors(), got.header.len), (count, all, 0));
    }
    assert_eq!(host.call(&FifoGetRxCount).header.ret, 64, "none of them was run");
    assert_eq!(all, Errors::CRC | Errors::SPI);
    // A packet of another length is one without its end.
    host.exchange_bytes(&[0; 100]);
    assert_eq!(host.send(&InfoUpdate).header.crc_errors, 4);

    let clear = CommandHeader { control: Control::CLEAR_CRC, ..CommandHeader::with_index(200) };
    host.send_with(clear, &InfoUpdate);
    assert_eq!(host.send(&InfoUpdate).errors(), Errors::SPI);
    let clear = CommandHeader { control: Control::CLEAR_SPI, ..CommandHeader::with_index(201) };
    host.send_with(clear, &InfoUpdate);
    let got = host.send(&CrcErrorCountClear);
    assert_eq!((got.errors(), got.header.crc_errors), (Errors::NONE, 4));
    assert_eq!(host.send(&InfoUpdate).header.crc_errors, 0);
}

/// XF-11.73 An error is cleared only when an answer to a command has shown it: a client that clears all errors in every
/// packet sees a failed transfer exactly once.
///
/// Row: error bits of 0x09.
#[test]
fn errors_are_shown_before_they_are_cleared() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    let header = |host: &mut Host| {
        host.index = host.index.wrapping_add(1);
        CommandHeader { control: Control::CLEAR_ALL, ..CommandHeader::with_index(host.index) }
    };
    for copies in 1..=3 {
        let missing = sdo(0, 0x5FFF, 0, SdoOperation::Read { bytes: 4 });
        let first = header(&mut host);
        host.send_with(first, &missing);
        let mut shown = 0;
        for _ in 0..100 {
            // Each packet is sent more than once; the answers to the copies, which are NOPs, show no error to this
            // client.
            let header = header(&mut host);
            for _ in 0..copies {
                let got = host.send_with(header, &InfoUpdate);
                shown += u32::from(!got.has(Status::NOP) && got.errors() == Errors::NON_IMMEDIATE);
            }
        }
        assert_eq!((shown, host.call(&InfoUpdate).errors()), (1, Errors::NONE), "{copies} copies");
    }
}

/// XF-11.4 CRC_TYPE_SET is taken with the fixed word or with a word of the type in force; the new type holds from its
/// answer on.
#[test]
fn check_type() {
    let mut host = Host::with_drives();
    let set = CrcTypeSet { kind: CheckType::Crc32 };
    assert_eq!(host.send(&set).header.status.check_type(), Ok(CheckType::Fixed));
    host.rule = CheckRule::CRC32;
    assert_eq!(host.send(&set).header.status.check_type(), Ok(CheckType::Crc32));
    // With the fixed word, while CRC-32 is in force.
    host.rule = CheckRule::FIXED;
    let got = host.send(&set);
    assert_eq!((got.header.crc_errors, got.header.status.check_type()), (0, Ok(CheckType::Crc32)));
    let got = host.send(&InfoUpdate);
    assert_eq!(got.header.crc_errors, 0);
    // Any other command needs the CRC.
    host.rule = CheckRule::CRC32;
    assert_eq!(host.send(&InfoUpdate).header.crc_errors, 1);
}

/// XF-11.5 SPI_RECONFIG_OP changes n from the next packet on, its own check word being the fixed one; the answer to it
/// has the new size. An ECM-XFU refuses it.
#[test]
fn data_size_changes() {
    let mut host = Host::with_drives();
    host.use_crc();
    for n in [32, 1408, 112] {
        let size = DataSize::new(n).expect("32 to 1408");
        host.send(&SpiReconfig { size });
        assert_eq!(host.chip.size(), size);
        let got = host.send(&SpiPackSizeGet);
        assert_eq!((got.header.code, got.data.len()), (CommandCode::SpiReconfig, n));
        let got = host.send(&InfoUpdate);
        assert_eq!((got.to(&SpiPackSizeGet), got.header.crc_errors), (size, 0));
    }
    let mut host = Host::new(Profile::XFU, vec![]);
    assert_eq!(host.chip.size(), DataSize::XFU);
    assert_eq!(host.call(&SpiReconfig { size: DataSize::MIN }).errors(), Errors::COMMAND);
    assert_eq!(host.chip.size(), DataSize::XFU);
}

/// XF-11.6 While the chip starts or works on a packet INT0 is inactive; an exchange then has the check word "not
/// ready", loses the command, and leaves the answer for the next one.
#[test]
fn not_ready() {
    let mut host = Host::with_drives();
    assert!(host.chip.int0(host.now));
    host.send(&SpiPackSizeGet);
    assert!(!host.chip.int0(host.now), "INT0 falls with the end of the packet");
    host.pace = 1_000;
    let lost = host.packet(CommandHeader::with_index(50), &FifoSetRxCount { entries: 9 });
    assert!(is_not_ready(&host.exchange_bytes(&lost)));
    host.pace = super::PACE;
    assert!(!host.chip.int0(host.now + 90_000) && host.chip.int0(host.now + 150_000), "less than 150 us");
    let got = host.send(&FifoGetRxCount);
    assert_eq!(got.to(&SpiPackSizeGet), DataSize::NEWER);
    assert_eq!(host.send(&InfoUpdate).header.ret, 64);
}

/// XF-11.7 A code, a parameter or an item that the manuals do not have is a command error, which stays until it is
/// cleared; the answer has no data.
#[test]
fn wrong_commands() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    let clear = |host: &mut Host| {
        host.index += 1;
        let header = CommandHeader { control: Control::CLEAR_COMMAND, ..CommandHeader::with_index(host.index) };
        host.send_with(header, &InfoUpdate);
        assert_eq!(host.send(&InfoUpdate).errors(), Errors::NONE);
    };
    let unknown =
        [14, 17, 21, 22, 36, 37, 40, 42, 49, 60, 65, 67, 68, 76, 77, 78, 79, 80, 84, 126, 128, 129, 133, 136, 141]
            .into_iter()
            .chain(145..=255)
            .map(|code| (code, 0, 0));
    let parameters =
        [(12, 0x80), (13, 3), (18, 2), (19, 2), (25, 1), (28, 0), (31, 7), (32, 4), (51, 3), (75, 8), (83, 9)];
    // The vendor's header has items of slaves up to 40, which no manual describes.
    let items = [14, 40].map(|item| (15, 0, item));
    for (code, parameter, info) in unknown.chain(parameters.map(|(code, parameter)| (code, parameter, 0))).chain(items)
    {
        let header = CommandHeader::with_index(host.index.wrapping_add(1));
        host.index = header.index;
        let mut bytes = host.packet(header, &InfoUpdate);
        (bytes[0x04], bytes[0x0C], bytes[0x0D]) = (info, code, parameter);
        host.exchange_bytes(&bytes);
        let got = host.send(&InfoUpdate);
        assert_eq!((got.header.code.code(), got.errors()), (code, Errors::COMMAND), "par {parameter} info {info}");
        assert_eq!((got.header.len, got.has(Status::BUSY)), (0, false));
        assert_eq!(host.send(&InfoUpdate).errors(), Errors::COMMAND, "it stays");
        clear(&mut host);
    }
}

/// XF-11.9 A command that takes time sets the busy bit in its own answer. Another one meanwhile is a command error and
/// dropped; immediate ones go on.
#[test]
fn one_at_a_time() {
    let mut host = Host::with_drives();
    let got = host.call(&INIT);
    assert!(got.has(Status::BUSY));
    assert_eq!(got.errors(), Errors::NONE);
    assert_eq!(host.call(&FirmwareVersionGet).to(&FirmwareVersionGet).version, 0x22);
    let got = host.call(&StateUpdate);
    assert_eq!((got.errors(), got.has(Status::BUSY)), (Errors::COMMAND, true));
    let got = host.wait();
    assert_eq!((got.errors(), got.header.state), (Errors::COMMAND, NetworkState::from(EtherCatState::Init)));
}

/// XF-11.10 A command that takes time and fails sets bit 3, which stays until it is cleared.
#[test]
fn failures() {
    let mut host = Host::new(Profile::NEW, vec![]);
    assert_eq!(host.end(&INIT).errors(), Errors::NON_IMMEDIATE, "a network without slaves");
    assert_eq!(host.call(&InfoUpdate).errors(), Errors::NON_IMMEDIATE);
    let header = CommandHeader { control: Control::CLEAR_NON_IMMEDIATE, ..CommandHeader::with_index(200) };
    host.send_with(header, &InfoUpdate);
    assert_eq!(host.send(&InfoUpdate).errors(), Errors::NONE);
    // Before any initialisation there are no clocks.
    assert_eq!(host.end(&InitDc).errors(), Errors::NON_IMMEDIATE);
}

/// XF-11.11 ASYNCCMD_RESET ends a running command: 1 clears busy, 4 gives the command up, which has failed then; 2
/// skips the wait for the network port; a sum does all of these.
#[test]
fn what_runs_is_ended() {
    let reset = |bits| AsyncReset::new(AsyncResetActions(bits)).expect("known bits");
    for (bits, errors) in [
        (1, Errors::NONE),
        (3, Errors::NONE),
        (4, Errors::NON_IMMEDIATE),
        (5, Errors::NON_IMMEDIATE),
        (7, Errors::NON_IMMEDIATE),
    ] {
        let mut host = Host::with_drives();
        assert!(host.call(&INIT).has(Status::BUSY));
        let got = host.call(&reset(bits));
        assert_eq!((got.has(Status::BUSY), got.errors()), (false, errors));
        host.pass(1000 * MS);
        assert_eq!(host.call(&SlaveCountGet).header.ret, 0, "it has no effect any more");
    }
    // The port is ready some time after the start.
    let started = |skip: Option<u8>| {
        let mut host = Host::with_drives();
        host.send(&WarmReset);
        host.pass(600 * MS);
        assert!(!host.call(&InfoUpdate).has(Status::PORT_READY));
        host.call(&INIT);
        if let Some(bits) = skip {
            assert!(host.call(&reset(bits)).has(Status::PORT_READY));
        }
        host.wait();
        host.now
    };
    assert!(started(Some(2)) < started(None));
    assert!(started(Some(7)) < started(Some(2)), "and the command is given up");
}

/// XF-11.12 WARM_RESET: the chip is as after power-on, and takes the next command only after its start.
#[test]
fn warm_reset() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.call(&FifoSetRxCount { entries: 7 });
    host.use_crc();
    host.call(&SpiReconfig { size: DataSize::MIN });
    host.send(&WarmReset);
    host.rule = CheckRule::FIXED;
    let lost = host.packet(CommandHeader::with_index(3), &FifoSetRxCount { entries: 9 });
    assert!(is_not_ready(&host.exchange_bytes(&lost)));
    assert!(!host.chip.int0(host.now));
    host.pass(1000 * MS);
    assert!(host.chip.int0(host.now));
    let first = host.send(&InfoUpdate);
    assert!(first.has(Status::NOP) && first.data.len() == 1024);
    assert!(first.has(Status::FIFO_ON), "until ECAT_INIT_OP says otherwise");
    assert_eq!(first.header.status.check_type(), Ok(CheckType::Fixed));
    assert_eq!((first.header.state, first.errors()), (NetworkState::NONE, Errors::NONE));
    assert_eq!(host.call(&FifoGetRxCount).header.ret, 64);
    assert_eq!(host.call(&SlaveCountGet).header.ret, 0);
    host.bring_to(EtherCatState::Op);
}

/// XF-11.14 Control bit 1 reads the states of all slaves, which takes time; the packet's own command is run as well.
#[test]
fn a_header_updates_states() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.chip.network_mut().silence(1, true);
    let header = CommandHeader { control: Control::UPDATE_STATE, ..CommandHeader::with_index(90) };
    host.send_with(header, &SpiPackSizeGet);
    let got = host.send(&InfoUpdate);
    assert_eq!(got.to(&SpiPackSizeGet), DataSize::NEWER);
    assert!(got.has(Status::BUSY));
    assert!(host.wait().header.state.has_error(), "slave 1 does not answer");
    // Another such packet while a command runs is a command error.
    host.send(&to_all(EtherCatState::Init));
    host.send_with(CommandHeader { index: 99, ..header }, &SpiPackSizeGet);
    assert_eq!(host.send(&InfoUpdate).errors(), Errors::COMMAND);
}

/// XF-11.14 Beside a command that takes time the states are read when it has ended, well or not; both count as one packet that
/// takes time (ecm-xf-commands, control bit 1). A command of an earlier packet makes it a command error.
#[test]
fn a_header_updates_states_behind_a_command_that_takes_time() {
    let read = sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 });
    let aborted = sdo(0, 0x5FFF, 0, SdoOperation::Read { bytes: 4 });
    for (request, errors) in [(&read, Errors::NONE), (&aborted, Errors::NON_IMMEDIATE)] {
        let mut host = Host::in_state(EtherCatState::PreOp);
        host.chip.network_mut().silence(1, true);
        let header = CommandHeader { control: Control::UPDATE_STATE, ..CommandHeader::with_index(90) };
        host.send_with(header, request);
        assert!(host.send(&InfoUpdate).has(Status::BUSY));
        let end = host.wait();
        assert_eq!(end.errors(), errors, "{request:?}");
        assert!(end.header.state.has_error(), "slave 1 does not answer");
        assert!(!end.has(Status::BUSY));
        // The update is one of its packet: none follows the next command.
        host.chip.network_mut().silence(1, false);
        host.send(&read);
        assert!(host.wait().header.state.has_error(), "nothing has read the state anew");
        // With a command of an earlier packet running, the own one is dropped, and no update comes.
        host.send(&to_all(EtherCatState::PreOp));
        host.wait();
        host.send(&read);
        host.send_with(CommandHeader { index: 91, ..header }, &read);
        assert!(host.send(&InfoUpdate).errors().contains(Errors::COMMAND));
    }
}

/// XF-11.14 XF-11.11 An update behind a command that is given up is given up with it.
#[test]
fn an_update_behind_a_command_is_given_up_with_it() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.chip.network_mut().silence(1, true);
    let header = CommandHeader { control: Control::UPDATE_STATE, ..CommandHeader::with_index(90) };
    host.send_with(header, &sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
    host.call(&AsyncReset::new(AsyncResetActions::CLEAR_BUSY).expect("known bits"));
    let end = host.send(&InfoUpdate);
    assert!(!end.has(Status::BUSY) && !end.header.state.has_error());
}

/// XF-11.15 As a stream the chip has a byte for each byte, however they are split. A host that does not know n or the
/// place finds both; a host that is out of step makes framing errors; after SPI_RECONFIG_OP the next packet has the new
/// n.
#[test]
fn stream() {
    let host = Host::with_drives();
    let start = host.now;
    let mut port = ChipPort::new(host.chip);
    let mut now = start;
    let mut clock = |port: &mut ChipPort<_>, to: &[u8]| {
        now += super::PACE;
        let mut from = vec![0; to.len()];
        assert_eq!(port.transfer(now, to, &mut from), to.len());
        from
    };
    // The host begins somewhere in a packet.
    clock(&mut port, &[0; 333]);
    let mut reader = Resync::new();
    for chunk in [1, 7, 700, 1056, 13].into_iter().cycle().take(40) {
        let bytes = clock(&mut port, &vec![0; chunk]);
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            rest = &rest[reader.push(rest)..];
            while reader.next_packet().is_some() {}
        }
    }
    assert_eq!(reader.size(), Some(DataSize::NEWER));
    let errors = port.chip_mut();
    assert_eq!(errors.size(), DataSize::NEWER);

    // The host finds the end of the packet under way, byte by byte.
    let mut last = Vec::new();
    while !last.ends_with(&[0x59, 0x58, 0x57, 0x56]) {
        last.extend(clock(&mut port, &[0]));
    }
    let mut buffer = [0; 1440];
    let mut exchange = |port: &mut ChipPort<_>, index, request: &dyn Fn(&mut [u8]) -> Vec<u8>| {
        let bytes = request(&mut buffer);
        assert_eq!(bytes[0x0B], index);
        clock(port, &bytes)
    };
    let size = DataSize::new(64).expect("32 to 1408");
    let with_index = CommandHeader::with_index;
    exchange(&mut port, 1, &|buffer| {
        let packet = write_request(buffer, DataSize::NEWER, CheckRule::FIXED, with_index(1), &SpiReconfig { size });
        packet.expect("it fits").to_vec()
    });
    let answer = exchange(&mut port, 2, &|buffer| {
        write_request(buffer, size, CheckRule::FIXED, with_index(2), &SpiPackSizeGet).expect("it fits").to_vec()
    });
    let Ok(Received::Answer(packet)) = AnswerPacket::parse(&answer, size, CrcCoverage::All) else {
        panic!("an answer")
    };
    assert_eq!((packet.header.index, packet.header.code), (1, CommandCode::SpiReconfig));
    assert!(packet.header.errors.contains(Errors::SPI), "the packets of zeros");
    let answer = exchange(&mut port, 3, &|buffer| {
        write_request(buffer, size, CheckRule::FIXED, with_index(3), &InfoUpdate).expect("it fits").to_vec()
    });
    let Ok(Received::Answer(packet)) = AnswerPacket::parse(&answer, size, CrcCoverage::All) else {
        panic!("an answer")
    };
    assert_eq!(packet.answer_to(&SpiPackSizeGet), Ok(size));
}
