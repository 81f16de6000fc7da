//! Queues, results, errors, repetitions.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::xf::host::{HostConfig, HostError, IMMEDIATE_SLOTS, NON_IMMEDIATE_SLOTS, Ticket, Timeouts};
use ecmsk::xf::request::{
    Analog, CrcErrorCountClear, CrcTypeSet, DacSetData, DacStartConv, SdoGet, SdoOperation, SdoRequest, SlaveCountGet,
    SlaveInfoGet, SlaveInfoItem, SpiReconfig, StateUpdate,
};
use ecmsk::xf::response::SlaveInfo;
use ecmsk::xf::{CheckType, CommandCode, CommandHeader, DataSize, Interrupts, Reserve};

use super::Rig;
use super::chip::Fault;
use crate::slave;

fn vendor(n: u8) -> SlaveInfoGet {
    SlaveInfoGet { slave: slave(n), item: SlaveInfoItem::Vendor }
}

pub fn dac(n: u32) -> DacSetData {
    DacSetData { value: Analog::new(n).expect("12 bits") }
}

pub fn sdo(index: u16, operation: SdoOperation<'_>) -> SdoRequest<'_> {
    let object = ObjectAddress::new(index, 0);
    SdoRequest { slave: slave(0), object, scope: SdoScope::Entry, timeout_us: 1000, operation }
}

pub const READ: SdoOperation<'static> = SdoOperation::Read { bytes: 4 };
const BUSY_NS: u64 = 1_000_000_000;

/// How often a command ran.
fn ran(rig: &Rig, code: CommandCode) -> usize {
    rig.chip.ran.iter().filter(|(ran, _)| *ran == code).count()
}

/// XF-12.7 A command takes two exchanges, the second of which sends the same packet again; its answer comes to its
/// ticket.
#[test]
fn a_command_and_its_answer() {
    let mut rig = Rig::running(HostConfig::default());
    let ticket = rig.submit(&vendor(5));
    assert_eq!(rig.host.take(ticket, &vendor(5)), None);
    rig.done(ticket);
    assert_eq!(rig.sent.len(), 2);
    assert_eq!(rig.sent[0], rig.sent[1]);
    let other = rig.host.take(ticket, &SlaveCountGet);
    let codes = (CommandCode::SlaveInfoGet, CommandCode::SlaveCountGet);
    assert_eq!(other, Some(Err(HostError::OtherCommand { expected: codes.0, found: codes.1 })));
    assert_eq!(rig.host.take(ticket, &vendor(5)), Some(Ok(SlaveInfo::U32(1005))));
    assert_eq!(rig.host.take(ticket, &vendor(5)), Some(Err(HostError::UnknownTicket)));
    assert_eq!(rig.chip.ran, [(CommandCode::SlaveInfoGet, 5)]);
}

/// XF-12.7 The index counts 1 to 255 and begins again; no command has index and code of the one before.
#[test]
fn indices_go_round() {
    let mut rig = Rig::running(HostConfig::default());
    for n in 0..600 {
        let ticket = rig.ended(&dac(n));
        assert_eq!(rig.host.take(ticket, &dac(n)), Some(Ok(())));
    }
    assert!(rig.chip.taken.iter().all(|(index, _)| *index > 0));
    assert!(rig.chip.taken.windows(2).all(|pair| pair[1].0 == if pair[0].0 == 255 { 1 } else { pair[0].0 + 1 }));
    let tags: Vec<u32> = rig.chip.ran.iter().map(|(_, tag)| *tag).collect();
    assert_eq!(tags, (0..600).collect::<Vec<_>>());
}

/// XF-12.7 With any fault in one exchange, a command that sets something runs once, and a command that reads has its
/// result.
#[test]
fn one_exchange_goes_wrong() {
    let faults = [
        Fault::ToChip(8 * 11),
        Fault::ToChip(8 * 60),
        Fault::ToHost(8 * 11),
        Fault::ToHost(8 * 60),
        Fault::NotReady,
        Fault::Lost,
        Fault::Doubled,
        Fault::Replaced,
        Fault::Late,
        Fault::Stranger,
    ];
    for fault in faults {
        for second in faults {
            for at in 0..4 {
                let mut rig = Rig::running(HostConfig::default());
                rig.faults = vec![Fault::None; at];
                rig.faults.extend([fault, second]);
                let (set, get, strobe) = (rig.submit(&dac(77)), rig.submit(&vendor(3)), rig.submit(&DacStartConv));
                rig.done(set);
                rig.done(get);
                rig.done(strobe);
                let what = format!("{fault:?}, {second:?} at {at}");
                assert_eq!(rig.host.take(set, &dac(77)), Some(Ok(())), "{what}");
                assert_eq!(rig.host.take(get, &vendor(3)), Some(Ok(SlaveInfo::U32(1003))), "{what}");
                assert_eq!(rig.host.take(strobe, &DacStartConv), Some(Ok(())), "{what}");
                assert_eq!(ran(&rig, CommandCode::DacFunction), 2, "{what}: {:?}", rig.chip.ran);
            }
        }
    }
}

/// XF-12.7 If the only answer is damaged, a read is sent again with another index; any other command has run and
/// reports that.
#[test]
fn a_lost_answer() {
    let mut rig = Rig::running(HostConfig::default());
    rig.faults = vec![Fault::None, Fault::ToHost(500)];
    let ticket = rig.ended(&vendor(3));
    assert_eq!(rig.host.take(ticket, &vendor(3)), Some(Ok(SlaveInfo::U32(1003))));
    assert_eq!((ran(&rig, CommandCode::SlaveInfoGet), rig.host.counters().asked_again), (2, 1));
    assert_ne!(rig.chip.taken[0].0, rig.chip.taken[1].0);

    rig.faults = vec![Fault::None, Fault::ToHost(500)];
    let ticket = rig.ended(&CrcErrorCountClear);
    let lost = HostError::AnswerLost { code: CommandCode::CrcErrorCountClear };
    assert_eq!(rig.host.take(ticket, &CrcErrorCountClear), Some(Err(lost)));
    assert_eq!((ran(&rig, CommandCode::CrcErrorCountClear), rig.host.counters().answers_lost), (1, 1));
}

/// XF-12.8 Non-immediate commands run one after the other; immediate ones go on meanwhile.
#[test]
fn one_non_immediate_command_at_a_time() {
    let mut rig = Rig::running(HostConfig::default());
    rig.chip.busy_for = 40;
    let updates: Vec<_> = (0..NON_IMMEDIATE_SLOTS).map(|_| rig.submit(&StateUpdate)).collect();
    let full = rig.host.submit(rig.now, &StateUpdate);
    assert_eq!(full, Err(HostError::QueueFull { code: CommandCode::StateUpdate, slots: NON_IMMEDIATE_SLOTS }));
    for (done, update) in updates.iter().enumerate() {
        let get = rig.ended(&vendor(1));
        assert!(!rig.host.is_done(*update), "an immediate command overtakes");
        assert_eq!(rig.host.take(get, &vendor(1)), Some(Ok(SlaveInfo::U32(1001))));
        rig.done(*update);
        assert!(!rig.chip.is_busy());
        assert_eq!(rig.host.take(*update, &StateUpdate), Some(Ok(())));
        assert_eq!(ran(&rig, CommandCode::StateUpdate), done + 1);
    }
    let full: Vec<_> = (0..IMMEDIATE_SLOTS).map(|_| rig.submit(&SlaveCountGet)).collect();
    assert!(rig.host.submit(rig.now, &SlaveCountGet).is_err());
    full.into_iter().for_each(|ticket| rig.done(ticket));
}

/// XF-12.9 A pair: nothing comes between SDO_REQ and SDO_GET, whose data are the result.
#[test]
fn pairs_belong_together() {
    let mut rig = Rig::running(HostConfig::default());
    let reads: Vec<_> = [0x6041, 0x6064, 0x1018]
        .map(|index| (index, rig.host.submit_pair(rig.now, &sdo(index, READ), &SdoGet, BUSY_NS).expect("room")))
        .into();
    for (index, ticket) in reads {
        rig.done(ticket);
        let expected = (u32::from(index) + 7).to_le_bytes();
        assert_eq!(rig.host.take(ticket, &SdoGet), Some(Ok(&expected[..])));
    }
    let wrong = rig.host.submit_pair(rig.now, &sdo(1, READ), &CrcErrorCountClear, BUSY_NS);
    assert_eq!(wrong, Err(HostError::NotARead { code: CommandCode::CrcErrorCountClear }));
}

/// XF-12.9 An SDO that fails has its abort code, and the next one is not taken for failed.
#[test]
fn a_failed_sdo() {
    let mut rig = Rig::running(HostConfig::default());
    let bad = rig.host.submit_pair(rig.now, &sdo(0x5555, READ), &SdoGet, BUSY_NS).expect("room");
    let good = rig.host.submit_pair(rig.now, &sdo(0x6041, READ), &SdoGet, BUSY_NS).expect("room");
    rig.done(good);
    let Some(Err(error)) = rig.host.take(bad, &SdoGet) else { panic!("it failed") };
    let abort = AbortCode(0x0602_0000);
    assert!(
        matches!(error, HostError::Failed { code: CommandCode::SdoRequest, abort: Some(code), .. } if code == abort)
    );
    assert!(error.to_string().contains("0x06020000"), "{error}");
    assert!(matches!(rig.host.take(good, &SdoGet), Some(Ok(_))));
}

/// XF-12.10 A command that does not end, and one that waits behind it, end with errors that say how long it took.
#[test]
fn a_chip_that_stays_busy() {
    let timeouts = Timeouts { busy_ns: 50_000_000, queue_ns: 80_000_000, ..Timeouts::default() };
    let mut rig = Rig::running(HostConfig { timeouts, ..HostConfig::default() });
    rig.chip.busy_for = u32::MAX;
    let (first, second) = (rig.submit(&StateUpdate), rig.submit(&StateUpdate));
    rig.done(first);
    let result = rig.host.take(first, &StateUpdate);
    let Some(Err(HostError::StillBusy { code: CommandCode::StateUpdate, waited_ns })) = result else {
        panic!("{result:?}")
    };
    assert!((50_000_000..52_000_000).contains(&waited_ns), "{waited_ns}");
    rig.done(second);
    let result = rig.host.take(second, &StateUpdate);
    assert!(matches!(result, Some(Err(HostError::NotSent { waited_ns: 80_000_000..83_000_000, .. }))), "{result:?}");
    assert_eq!(ran(&rig, CommandCode::StateUpdate), 1);
}

/// XF-12.10 A command without an answer ends with what was tried; it is never sent again.
#[test]
fn a_command_without_an_answer() {
    let mut rig = Rig::running(HostConfig::default());
    let ticket = rig.submit(&dac(1));
    rig.faults = vec![Fault::NotReady; 4000];
    rig.done(ticket);
    let result = rig.host.take(ticket, &dac(1));
    let Some(Err(error @ HostError::NoAnswer { copies, waited_ns, .. })) = result else { panic!("{result:?}") };
    assert!(copies > 5 && waited_ns >= 100_000_000, "{error}");
    assert!(error.to_string().contains("whether it ran is unknown"), "{error}");
    rig.faults.clear();
    rig.ended(&dac(2));
    rig.chip.ran.retain(|(code, _)| *code != CommandCode::InfoUpdate);
    assert_eq!(rig.chip.ran, [(CommandCode::DacFunction, 2)]);
}

/// XF-12.10 A host that stands still for 3 s after any exchange of a command has its result all the same, and the command runs once.
#[test]
fn a_host_that_stood_still() {
    for exchanges in 0..=2 {
        let mut rig = Rig::running(HostConfig::default());
        let ticket = rig.submit(&vendor(5));
        rig.exchanges(exchanges);
        rig.now += 3_000_000_000;
        rig.done(ticket);
        let result = rig.host.take(ticket, &vendor(5));
        assert_eq!(result, Some(Ok(SlaveInfo::U32(1005))), "after {exchanges}");
        assert_eq!(ran(&rig, CommandCode::SlaveInfoGet), 1, "after {exchanges}");
    }
}

/// XF-12.7 A chip whose count of CRC errors is at its end shows no more of them: a command of which no copy has arrived
/// is not treated as one whose answer was lost.
#[test]
fn the_count_of_errors_is_at_its_end() {
    let mut rig = Rig::running(HostConfig::default());
    rig.chip.crc_errors = u8::MAX;
    rig.until("the count is seen", |rig| rig.host.header().is_some_and(|header| header.crc_errors == u8::MAX));
    rig.faults = vec![Fault::ToChip(600); 20];
    let ticket = rig.ended(&dac(1));
    assert_eq!(rig.host.take(ticket, &dac(1)), Some(Ok(())));
    assert_eq!(ran(&rig, CommandCode::DacFunction), 1);
}

/// XF-12.10 The chip refuses a command: that command has the error, and not the next one.
#[test]
fn a_refused_command() {
    let mut rig = Rig::running(HostConfig::default());
    rig.chip.refused = Some(CommandCode::SlaveCountGet);
    let (refused, fine) = (rig.submit(&SlaveCountGet), rig.submit(&vendor(2)));
    rig.done(fine);
    let error = HostError::Refused { code: CommandCode::SlaveCountGet };
    assert_eq!(rig.host.take(refused, &SlaveCountGet), Some(Err(error)));
    assert_eq!(rig.host.take(fine, &vendor(2)), Some(Ok(SlaveInfo::U32(1002))));
}

/// XF-12.10 Commands that are reserved for the driver are refused, and so are commands that do not fit into a packet.
#[test]
fn commands_that_are_not_taken() {
    let mut rig = Rig::running(HostConfig::default());
    let check = CrcTypeSet { kind: CheckType::Fixed };
    assert_eq!(rig.host.submit(0, &check), Err(HostError::ReservedForDriver { code: CommandCode::CrcTypeSet }));
    let size = SpiReconfig { size: DataSize::MAX };
    assert_eq!(rig.host.submit(0, &size), Err(HostError::ReservedForDriver { code: CommandCode::SpiReconfig }));
    let long = rig.host.submit(0, &sdo(1, SdoOperation::Write(&[1; 101])));
    assert_eq!(long, Err(HostError::TooLong { code: CommandCode::SdoRequest, found: 113, most: 112 }));
    let malformed = rig.host.submit(0, &sdo(1, SdoOperation::Write(&[1; 257])));
    assert!(matches!(malformed, Err(HostError::Malformed(_))), "{malformed:?}");
}

/// XF-12.7 An idle driver reads the header every 10 ms.
#[test]
fn the_header_is_polled() {
    let mut rig = Rig::running(HostConfig::default());
    let (before, from) = (rig.host.counters().exchanges, rig.now);
    rig.until("a second", |rig| rig.now - from > 1_000_000_000);
    let exchanges = rig.host.counters().exchanges - before;
    assert!((180..=202).contains(&exchanges), "{exchanges}");
}

/// XF-12.14 The header of each packet puts GPIO outputs out if there are any, and clears interrupts once; control bits
/// 0 and 1 are never set.
#[test]
fn what_headers_carry() {
    let mut rig = Rig::running(HostConfig::default());
    let headers = |rig: &mut Rig| {
        let ticket = rig.ended(&SlaveCountGet);
        let _ = rig.host.take(ticket, &SlaveCountGet);
        let sent = rig.sent.pop().expect("it was sent");
        CommandHeader::decode(sent.first_chunk().expect("24 bytes")).1
    };
    let plain = headers(&mut rig);
    assert_eq!((plain.reserve, plain.gpio_outputs, plain.interrupt_clear), (Reserve::NONE, 0, Interrupts::NONE));
    rig.host.set_gpio_outputs(Some(0x0123));
    rig.host.clear_interrupts(Interrupts::ETHERCAT, 5);
    let header = headers(&mut rig);
    assert_eq!((header.reserve, header.gpio_outputs), (Reserve::GPIO_OUTPUTS_VALID, 0x0123));
    assert_eq!((header.interrupt_clear, header.gpio_interrupt_clear), (Interrupts::ETHERCAT, 5));
    let after = headers(&mut rig);
    assert_eq!((after.gpio_outputs, after.interrupt_clear, after.gpio_interrupt_clear), (0x0123, Interrupts::NONE, 0));
    assert!(rig.sent.iter().all(|packet| packet[0x0A] & 3 == 0));
}

/// XF-12.10 A result that can never be read has a deadline as well.
#[test]
fn a_result_that_is_always_lost() {
    let timeouts = Timeouts { queue_ns: 500_000_000, ..Timeouts::default() };
    let mut rig = Rig::running(HostConfig { timeouts, ..HostConfig::default() });
    let pair = rig.host.submit_pair(rig.now, &sdo(0x6041, READ), &SdoGet, BUSY_NS).expect("room");
    without_answers(&mut rig, pair);
    let lost = HostError::AnswerLost { code: CommandCode::SdoRequest };
    assert_eq!(rig.host.take(pair, &SdoGet), Some(Err(lost)));

    let plain = rig.submit(&vendor(1));
    without_answers(&mut rig, plain);
    let result = rig.host.take(plain, &vendor(1));
    assert!(matches!(result, Some(Err(HostError::NotSent { .. }))), "{result:?}");
    assert!(rig.host.counters().asked_again > 10);
}

/// Runs turns until the command is done; the answer to each first copy of a read is damaged, so that the later copies
/// show that it ran.
fn without_answers(rig: &mut Rig, ticket: Ticket) {
    for _ in 0..20_000 {
        let mut last = rig.sent.iter().rev();
        let (newest, before) = (last.next(), last.next());
        let read = newest.is_some_and(|packet| matches!(packet[0x0C], 11 | 15));
        rig.faults = vec![if read && newest != before { Fault::ToHost(500) } else { Fault::None }];
        rig.turn().expect("it runs");
        if rig.host.is_done(ticket) {
            return;
        }
    }
    panic!("it does not end");
}
