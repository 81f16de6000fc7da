//! The SDO slot: one transfer at a time, the answer that stays, rejections, aborts and timeouts.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{Job, Ns};
use ecmsk::sk::{
    CommandId, FifoAction, Frame, InvalidArgument, MasterCommand, MasterState, RawSlot, SdoCommand, SdoResponse,
    SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig};

use crate::host::Host;
use crate::puppet::Puppet;
use crate::watch::{Spans, Started, Watch};

const MS: Ns = 1_000_000;
const CYCLE: Ns = MS;
/// The timeout of a silent slave.
const TIMEOUT: Ns = 1000 * MS;

/// A board in PreOP with one puppet slave and one servo drive.
struct Bench {
    host: Host,
    puppet: Puppet,
    network: SimHandle,
    jobs: Spans,
}

fn bench_of(config: EngineConfig) -> Bench {
    let puppet = Puppet::new();
    puppet.strings().objects.extend([
        ((0x2000, 1), (1, 0xFE)),
        ((0x2000, 2), (2, 0xFEDC)),
        ((0x2000, 4), (4, 0xFEDC_BA98)),
        ((0x6060, 0), (1, 8)),
    ]);
    let bus = SimBus::new(vec![puppet.boxed(), Box::new(Drive::new(DriveConfig::default()))]);
    let network = bus.handle();
    let (bus, jobs) = Watch::new(bus);
    let mut host = Host::new(config, bus);
    host.declare_drives(2).cycle();
    Bench { host, puppet, network, jobs }
}

fn bench() -> Bench {
    bench_of(EngineConfig::default())
}

fn read(slave: u8, index: u16, sub: u8) -> SdoCommand {
    SdoCommand::Read { slave, object: ObjectAddress::new(index, sub) }
}

fn write(slave: u8, index: u16, sub: u8, size: SdoSize, value: u32) -> SdoCommand {
    SdoCommand::Write { slave, object: ObjectAddress::new(index, sub), size, value }
}

fn frame_of(host: &Host, command: SdoCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_sdo(host.size, &command);
    frame
}

/// The raw SDO slot.
fn slot(host: &Host) -> RawSlot {
    host.report.slot(host.size, host.size.sdo_slot())
}

fn rejected(host: &Host, reason: Reason) -> u64 {
    host.counters().rejected[reason.kind()]
}

/// SK-6.1 A transfer takes several cycles.
/// SK-6.2 While one is under way the slot keeps the previous answer; an answer stays until the next transfer ends.
/// SK-3.3 It stays under GET_STATUS.
#[test]
fn an_answer_stays_until_the_next_transfer_ends() {
    for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
        let Bench { mut host, .. } = bench();
        host.go(state).drained_in(state);
        assert!(slot(&host).is_zero(), "no transfer has ended yet");
        let mut before = RawSlot::ZERO;
        for (sub, value) in [(2, 0xFEDC), (4, 0xFEDC_BA98)] {
            host.sdo(read(1, 0x2000, sub));
            let mut cycles = 0;
            while slot(&host) == before {
                host.idle().cycle();
                cycles += 1;
            }
            assert!(cycles > 2, "{state}: {cycles} cycles");
            let data1 = 0x2000_0000 | u32::from(sub);
            let after = RawSlot { id: 0x07, index: 0, parm: 1, data1, data2: value, data3: 0 };
            assert_eq!(slot(&host), after);
            for _ in 0..300 {
                host.idle().cycle();
                assert_eq!(slot(&host), after, "{state}");
            }
            before = after;
        }
    }
}

/// SK-6.16 A program that polls sends its request in every frame until the answer is there: all are one request, and
/// none is rejected. Another request in between is.
#[test]
fn a_request_that_repeats_the_one_under_way_is_one_with_it() {
    for state in [MasterState::PreOp, MasterState::Op] {
        let Bench { mut host, puppet, network, .. } = bench();
        host.go(state).drained_in(state);
        network.delay_sdo(1, 50 * MS);
        for n in 0..=20 {
            host.sdo(read(1, 0x2000, 4)).cycle();
            assert_eq!((host.counters().sdo_repeated, host.counters().rejected_total()), (n, 0), "{state}");
        }
        // A held request may be repeated as well; the earlier one counts as a different one then.
        for n in 21..=24 {
            host.sdo(read(1, 0x2000, 2)).cycle();
            assert_eq!((host.counters().sdo_repeated, host.counters().rejected_total()), (n - 1, 0), "{state}");
        }
        host.sdo(read(1, 0x2000, 4)).cycle();
        assert_eq!(rejected(&host, Reason::SdoBusy), 1, "{state}: the one that was held");
        host.until("the answer", |host| !slot(host).is_zero());
        assert_eq!(slot(&host).data2, 0xFEDC_BA98, "{state}");
        host.cycles(200);
        assert_eq!(puppet.strings().uploads, [ObjectAddress::new(0x2000, 4); 2], "{state}");
    }
}

/// SK-6.3 A library that writes one object after another, in the same cycle or 1 ms later, and reads no answer: all are
/// written, in their order.
#[test]
fn writes_that_follow_one_another_are_all_made() {
    for state in [MasterState::PreOp, MasterState::Op] {
        for cycles in [0, 1] {
            let Bench { mut host, jobs, .. } = bench();
            host.go(state).drained_in(state);
            let before = jobs.transfers().len();
            for (sub, value) in [(1, 11), (2, 22)] {
                host.sdo(write(2, 0x6099, sub, SdoSize::Four, value)).cycles(cycles);
            }
            host.cycles(200);
            let made: Vec<_> =
                jobs.transfers()[before..].iter().map(|(made, _)| (made.object.sub, made.write)).collect();
            assert_eq!(made, [(1, Some((SdoSize::Four, 11))), (2, Some((SdoSize::Four, 22)))], "{state} {cycles}");
            assert_eq!((host.counters().rejected_total(), slot(&host).data2), (0, 22), "{state} {cycles}");
        }
    }
}

/// SK-6.3 A request while another one is under way is held, and runs next; a newer one replaces the held one, which is
/// counted and reported. SK-4.38 The slot keeps its answer meanwhile.
#[test]
fn a_third_request_replaces_the_one_that_is_held() {
    for state in [MasterState::PreOp, MasterState::Op] {
        let Bench { mut host, puppet, network, .. } = bench();
        host.go(state).drained_in(state);
        network.delay_sdo(1, 50 * MS);
        let mark = host.mark();
        host.sdo(read(1, 0x2000, 4)).cycle();
        for (n, sub) in [1, 2, 1, 2].into_iter().enumerate() {
            host.sdo(read(1, 0x2000, sub)).cycles(2);
            assert_eq!(rejected(&host, Reason::SdoBusy), n as u64, "{state}");
            assert!(slot(&host).is_zero());
        }
        assert_eq!(host.rejections(mark), [(41, CommandId::SdoRead, Reason::SdoBusy); 3], "{state}");
        let addresses = [4, 2].map(|sub| ObjectAddress::new(0x2000, sub));
        host.until("the first answer", |host| !slot(host).is_zero());
        assert_eq!(slot(&host).data2, 0xFEDC_BA98, "{state}");
        host.until("the answer of the one that was held", |host| slot(host).data1 == 0x2000_0002);
        assert_eq!((slot(&host).data2, puppet.strings().uploads.clone()), (0xFEDC, addresses.to_vec()), "{state}");
    }
}

/// SK-6.17 A write of 0x6060 in PreOP with SET_STATE in the same frame, in the frame before or in the one after it in the same
/// cycle: the host's value is written first, then that of DRIVE_MODE. The same holds for two writes, the second of which is
/// held.
#[test]
fn the_hosts_writes_go_before_the_boards_own() {
    for order in 0..4 {
        let Bench { mut host, jobs, .. } = bench();
        let mode = write(2, 0x6060, 0, SdoSize::One, 6);
        let up = MasterCommand::SetState(MasterState::SafeOp);
        let before = jobs.transfers().len();
        match order {
            0 => {
                host.build(|frame, size| {
                    frame.put_sdo(size, &mode);
                    frame.put_master(size, &up);
                });
            }
            1 => {
                host.sdo(mode).master(up);
            }
            2 => {
                host.master(up).sdo(mode);
            }
            _ => {
                host.sdo(read(1, 0x2000, 1)).cycles(1).sdo(mode).master(up);
            }
        }
        host.until("SafeOP", |host| host.state() == StateByte::reached(MasterState::SafeOp));
        let written: Vec<_> = jobs.transfers()[before..].iter().filter_map(|(made, _)| made.write).collect();
        assert_eq!(written, [(SdoSize::One, 6)], "{order}");
        assert_eq!(host.read_object(2, 0x6060, 0), Ok(8), "{order}: DRIVE_MODE's value is the last");
        assert_eq!(host.counters().rejected_total(), 0, "{order}");
    }
}

/// SK-6.17 A program that sends SDO requests without end does not prevent the network from reaching SafeOP.
#[test]
fn requests_without_end_do_not_hold_up_a_change() {
    let Bench { mut host, network, .. } = bench();
    network.delay_sdo(1, 5 * MS);
    host.master(MasterCommand::SetState(MasterState::SafeOp));
    let mut sub = 0;
    for _ in 0..2000 {
        sub = 1 + (sub + 1) % 4;
        host.sdo(read(1, 0x2000, sub)).cycle();
    }
    assert_eq!(host.state(), StateByte::reached(MasterState::SafeOp));
}

/// SK-4.17 Programs put the object's size above the slave's number of a read, too, 0x0201, and poll for Parm = slave: the
/// read runs in every state that has it, nothing is rejected, and the answer has the slave's number alone.
#[test]
fn a_read_with_a_size_in_parm_is_a_read() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = bench_of(EngineConfig { slot: size, ..EngineConfig::default() });
        for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            host.go(state);
            for (high, sub, value) in
                [(0x01u16, 1u32, 0xFE), (0x02, 2, 0xFEDC), (0x04, 4, 0xFEDC_BA98), (0xFF, 2, 0xFEDC)]
            {
                let data1 = 0x2000_0000 | sub;
                let asked = RawSlot { id: 0x07, parm: high << 8 | 1, data1, ..RawSlot::ZERO };
                let answer = RawSlot { id: 0x07, parm: 1, data1, data2: value, ..RawSlot::ZERO };
                host.raw(size.sdo_slot(), asked).until("the answer", |host| slot(host) == answer);
            }
        }
        assert_eq!(host.counters().rejected_total(), 0);
    }
}

/// SK-6.6 A slave number 0 or above 40 (30) is rejected: nothing is started and the slot keeps its answer.
#[test]
fn slave_numbers_the_board_does_not_have_are_rejected() {
    for (size, most) in [(SlotSize::Bytes12, 40u16), (SlotSize::Bytes16, 30)] {
        let Bench { mut host, jobs, .. } = bench_of(EngineConfig { slot: size, ..EngineConfig::default() });
        host.read_object(1, 0x2000, 1).unwrap();
        let before = slot(&host);
        let mut count = 0;
        for slave in [0, most + 1, 255, 0x100, 0x8000] {
            let read = RawSlot { id: 0x07, parm: slave, data1: 0x2000_0001, ..RawSlot::ZERO };
            host.raw(size.sdo_slot(), read).cycles(20);
            count += 1;
            assert_eq!(
                rejected(&host, Reason::BadArgument(InvalidArgument::SdoSlave(0))),
                count,
                "read, slave {slave}"
            );
        }
        for slave in [0, most + 1, 255] {
            let write = RawSlot { id: 0x08, parm: 0x0100 | slave, data1: 0x2000_0001, ..RawSlot::ZERO };
            host.raw(size.sdo_slot(), write).cycles(20);
            count += 1;
            assert_eq!(
                rejected(&host, Reason::BadArgument(InvalidArgument::SdoSlave(0))),
                count,
                "write, slave {slave}"
            );
        }
        assert_eq!((slot(&host), jobs.transfers().len()), (before, 1));
        // The last valid number is accepted, though that slave is absent.
        assert_eq!(host.read_object(most as u8, 0x2000, 1), Err(AbortCode::TIMEOUT));
    }
}

/// SK-6.7 A slave that is silent for 1 s (a link key) ends in abort 0x05040000, to the cycle. A transfer to an absent
/// slave ends with it as well, at once. SK-6.13 On the wire: CMD, Parm = slave | 0x8000, Data1 the same, Data2 = the
/// code.
#[test]
fn a_transfer_that_nobody_answers_times_out() {
    for (timeout, state) in [(TIMEOUT, MasterState::PreOp), (TIMEOUT, MasterState::Op), (70 * MS, MasterState::SafeOp)]
    {
        let config = EngineConfig { sdo_timeout_ns: timeout, ..EngineConfig::default() };
        let Bench { mut host, network, jobs, .. } = bench_of(config);
        host.go(state).drained_in(state);
        let aborted = |slave: u8| {
            let (parm, data1) = (0x8000 | u16::from(slave), 0x6065_0000);
            RawSlot { id: 0x08, parm, data1, data2: 0x0504_0000, ..RawSlot::ZERO }
        };
        for slave in [3, 40] {
            host.sdo(write(slave, 0x6065, 0, SdoSize::Four, 7)).cycles(2);
            assert_eq!((slot(&host), jobs.transfers().len()), (aborted(slave), 0), "slave {slave}, {state}");
        }
        // The slave is present, but answers SDOs only after a longer time.
        network.delay_sdo(2, timeout + MS);
        let before = slot(&host);
        host.sdo(write(2, 0x6065, 0, SdoSize::Four, 7)).cycle();
        host.until("the transfer", |_| !jobs.transfers().is_empty());
        let began = jobs.transfers()[0].1.began;
        while host.time() < began + timeout - CYCLE {
            host.cycle();
            assert_eq!(slot(&host), before);
        }
        host.cycle();
        assert_eq!((host.time(), slot(&host)), (began + timeout, aborted(2)), "{state}");
        // A slave that answers just in time.
        network.delay_sdo(2, timeout - 10 * MS);
        assert_eq!(host.read_object(2, 0x6065, 0), Ok(3 << 17), "nothing was written meanwhile");
    }
}

/// SK-6.7 A slave that does not answer frames ends in the same abort.
#[test]
fn a_silent_slave_times_out() {
    let Bench { mut host, network, .. } = bench();
    network.silence(2, true);
    assert_eq!(host.read_object(2, 0x1000, 0), Err(AbortCode::TIMEOUT));
    network.silence(2, false);
    assert_eq!(host.read_object(2, 0x1000, 0), Ok(0x0002_0192));
}

/// SK-6.9 A second, identical SDO_RD matches the old answer at once, until its own comes.
#[test]
fn an_identical_request_shows_the_old_answer_at_once() {
    let Bench { mut host, puppet, .. } = bench();
    assert_eq!(host.read_object(1, 0x2000, 4), Ok(0xFEDC_BA98));
    let old = slot(&host);
    puppet.strings().objects.insert((0x2000, 4), (4, 1));
    host.sdo(read(1, 0x2000, 4)).cycle();
    assert_eq!(slot(&host), old, "the next report matches the request already");
    host.until("the new value", |host| slot(host) != old);
    assert_eq!(slot(&host), RawSlot { data2: 1, ..old });
}

/// SK-6.11 SDO_RD gives at most 4 bytes, zero-extended.
#[test]
fn values_are_zero_extended() {
    let Bench { mut host, .. } = bench();
    assert_eq!(host.read_object(1, 0x2000, 1), Ok(0xFE));
    assert_eq!(host.read_object(1, 0x2000, 2), Ok(0xFEDC));
    assert_eq!(host.read_object(1, 0x2000, 4), Ok(0xFEDC_BA98));
    // A servo drive: 0x6098 is i8, 0x605D i16, 0x607C i32, 0x1008 a text that is longer.
    assert_eq!(host.write_object(2, 0x60C2, 2, SdoSize::One, 0xFD), Ok(0xFD));
    assert_eq!(host.read_object(2, 0x60C2, 2), Ok(0xFD), "-3 in an i8");
    assert_eq!(host.write_object(2, 0x6071, 0, SdoSize::Two, 0xFFF0), Ok(0xFFF0));
    assert_eq!(host.read_object(2, 0x6071, 0), Ok(0xFFF0), "-16 in an i16");
    assert_eq!(host.write_object(2, 0x607C, 0, SdoSize::Four, 0xFFFF_FFFF), Ok(0xFFFF_FFFF));
    assert_eq!(host.read_object(2, 0x607C, 0), Ok(0xFFFF_FFFF));
    assert_eq!(host.read_object(2, 0x1008, 0), Ok(u32::from_le_bytes(*b"SRVO")));
}

/// SK-6.12 A refused access ends in a CoE abort code. SK-6.13 On the wire: CMD = 7 or 8, Parm = slave | 0x8000, Data1
/// the same, Data2 = the code; a program that waits for Parm == slave never takes it for a value. SK-4.18 The high byte
/// of Parm, the size of a write, is not in the answer.
#[test]
fn refusals_are_abort_codes() {
    use SdoSize::{Four, One, Two};
    for size in SlotSize::ALL {
        let Bench { mut host, network, .. } = bench_of(EngineConfig { slot: size, ..EngineConfig::default() });
        let mut ends_in = |command: SdoCommand, data1, codes: &[AbortCode]| {
            let before = host.sdo_answer();
            host.sdo(command).until("its end", |host| host.sdo_answer() != before);
            let raw = slot(&host);
            assert!(codes.contains(&AbortCode(raw.data2)), "{command:?}: {raw:x?}");
            let head = RawSlot { id: command.encode().id, parm: 0x8002, data1, data2: raw.data2, ..RawSlot::ZERO };
            assert_eq!(raw, head, "{command:?}");
        };
        let length = [AbortCode::LENGTH, AbortCode::TOO_LONG, AbortCode::TOO_SHORT];
        ends_in(read(2, 0x5FFF, 0), 0x5FFF_0000, &[AbortCode::NO_OBJECT]);
        ends_in(write(2, 0x5FFF, 3, Four, 1), 0x5FFF_0003, &[AbortCode::NO_OBJECT]);
        ends_in(read(2, 0x1018, 9), 0x1018_0009, &[AbortCode::NO_SUB_INDEX]);
        ends_in(write(2, 0x6060, 0, Two, 8), 0x6060_0000, &length);
        ends_in(write(2, 0x607C, 0, One, 8), 0x607C_0000, &length);
        ends_in(write(2, 0x6041, 0, Two, 1), 0x6041_0000, &[AbortCode::READ_ONLY]);
        ends_in(write(2, 0x6060, 0, One, 99), 0x6060_0000, &[AbortCode::VALUE_RANGE]);
        network.abort_sdo(2, Some(AbortCode(0x0800_0099)));
        ends_in(read(2, 0x1000, 0), 0x1000_0000, &[AbortCode(0x0800_0099)]);
        network.abort_sdo(2, None);
        // The slot works after aborts, and Data2 of a write comes back as it was sent.
        assert_eq!(host.write_object(2, 0x6098, 0, One, 0x1234_5623), Ok(0x1234_5623));
        assert_eq!(slot(&host), RawSlot { id: 8, parm: 2, data1: 0x6098_0000, data2: 0x1234_5623, ..RawSlot::ZERO });
        assert_eq!(host.read_object(2, 0x6098, 0), Ok(0x23));
    }
}

/// SK-6.4 A request that comes during the board's own work on the way to SafeOP waits, and runs next. SK-6.3 One more is held.
#[test]
fn a_request_during_the_boards_own_transfers_is_held() {
    for target in [MasterState::SafeOp, MasterState::Op] {
        let Bench { mut host, jobs, puppet, .. } = bench();
        host.master(MasterCommand::SetState(target));
        host.until("DRIVE_MODE's value being written", |_| {
            matches!(jobs.under_way(), Some(Started::Job(Job::Configure(_))))
        });
        let before = host.counters();
        host.sdo(read(1, 0x2000, 2)).cycle();
        assert_eq!(host.counters().rejected_total(), before.rejected_total(), "not rejected");
        assert!(matches!(jobs.under_way(), Some(Started::Job(Job::Configure(_)))), "the board's own work goes on");
        host.sdo(read(1, 0x2000, 1)).cycle();
        host.sdo(read(1, 0x2000, 4)).cycle();
        assert_eq!(rejected(&host, Reason::SdoBusy), 1, "one deep behind the one that waits");
        host.until("the answer", |host| !slot(host).is_zero());
        assert_eq!(host.sdo_answer(), done(1, 0x2000, 2, 0xFEDC));
        assert_eq!(host.state(), StateByte::reached(MasterState::PreOp), "it runs next");
        host.until("the state", |host| host.state() == StateByte::reached(target)).cycles(100);
        assert_eq!(host.sdo_answer(), done(1, 0x2000, 4, 0xFEDC_BA98));
        assert_eq!(puppet.strings().uploads, [2, 4].map(|sub| ObjectAddress::new(0x2000, sub)));
    }
}

/// SK-6.1 One transfer at a time: the board's own work waits for the host's transfer, and both come to their end.
#[test]
fn the_boards_own_transfers_wait_for_the_hosts() {
    let Bench { mut host, network, .. } = bench();
    network.delay_sdo(1, 200 * MS);
    host.sdo(read(1, 0x2000, 1)).cycle();
    host.go(MasterState::SafeOp);
    assert_eq!(host.sdo_answer(), done(1, 0x2000, 1, 0xFE));
}

/// SK-6.1 The board asks a busy bus again.
#[test]
fn a_busy_bus_delays_a_transfer() {
    let Bench { mut host, jobs, .. } = bench();
    jobs.be_busy(5);
    assert_eq!(host.read_object(1, 0x2000, 1), Ok(0xFE));
    jobs.be_busy(5);
    host.go(MasterState::Op);
}

/// SK-5.20 The SDO slot waits in the queue: in OP its request starts when its entry is taken out.
#[test]
fn in_op_a_request_waits_for_its_entry() {
    let Bench { mut host, jobs, puppet, .. } = bench();
    host.op(2);
    host.arrive_marked(1..=100);
    let mut request = host.marked(101);
    request.put_sdo(host.size, &read(1, 0x2000, 1));
    host.arrive(&request).arrive_marked(102..=120);
    while host.mark_shown() < 100 {
        host.cycle();
        assert_eq!(jobs.transfers().len(), 0, "at entry {}", host.mark_shown());
    }
    host.cycles(2);
    assert_eq!((host.mark_shown(), jobs.transfers().len()), (102, 1));
    host.until("the answer", |host| host.sdo_answer() == done(1, 0x2000, 1, 0xFE));

    // Behind a threshold that holds all entries back it does not start at all, and a clear drops it.
    let mut frame = frame_of(&host, read(1, 0x2000, 4));
    frame.put_master(host.size, &MasterCommand::SetFifo(FifoAction::Threshold(1)));
    host.drained().arrive(&frame).cycles(1000);
    host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(100);
    assert_eq!(puppet.strings().uploads.len(), 1);
}

/// SK-6.3 Requests that are rejected for other reasons do not affect a transfer under way, in any slot.
#[test]
fn nonsense_leaves_a_transfer_alone() {
    let Bench { mut host, network, .. } = bench();
    network.delay_sdo(1, 20 * MS);
    host.sdo(read(1, 0x2000, 2)).cycle();
    let sdo = host.size.sdo_slot();
    for raw in [
        RawSlot { id: 0x15, ..RawSlot::ZERO },
        RawSlot { id: 0x07, parm: 1, data1: 0x2000_0100, ..RawSlot::ZERO },
        RawSlot { id: 0x08, parm: 0x0301, data1: 0x2000_0001, ..RawSlot::ZERO },
        RawSlot { id: 0x99, ..RawSlot::ZERO },
    ] {
        host.raw(sdo, raw);
    }
    assert_eq!(host.counters().rejected_total(), 4);
    host.until("the answer", |host| !slot(host).is_zero());
    assert_eq!(host.sdo_answer(), done(1, 0x2000, 2, 0xFEDC));
}

fn done(slave: u8, index: u16, sub: u8, value: u32) -> SdoResponse {
    SdoResponse::Done { id: CommandId::SdoRead, slave, object: ObjectAddress::new(index, sub), value }
}

impl Host {
    /// Waits until the FIFO is empty, if this state has one.
    fn drained_in(&mut self, state: MasterState) -> &mut Self {
        if state == MasterState::Op { self.drained() } else { self }
    }
}
