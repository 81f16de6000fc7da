//! Sequences of calls of existing applications, on virtual time, so that each ends as it would on the board.

use ecmsk::coe::ObjectAddress;
use ecmsk::link::Wait;
use ecmsk::link::engine::RunOptions;
use ecmsk::sk::{
    CycleTime, DcShift, Frame, MasterCommand, MasterState, Motion, SdoCommand, SlaveCommand, SlaveKind, StateByte,
};

use crate::client::{Client, MS, SIZE, open, target};

fn client() -> Client {
    open(2, RunOptions::default()).0
}

/// LIB-20 One read right after opening, before any write.
#[test]
fn a_read_comes_first() {
    let mut client = client();
    assert_eq!(client.read().sequence, 0);
    assert_eq!(client.answer().state, StateByte::reached(MasterState::PreOp));
}

/// LIB-21 5 SET_AXIS writes 2 ms apart, SET_DC, DRIVE_MODE, none followed by a read; then "read, compare the state byte,
/// else write an all-zero frame", 1000 times at most.
#[test]
fn configuration_without_reads() {
    // On virtual time the 2 ms are the duration of a write.
    let (mut client, _) = open(2, RunOptions { host_ns: 2 * MS, ..RunOptions::default() });
    for group in 0..5 {
        client.master(MasterCommand::SetAxis { group, kinds: [SlaveKind::Drive; 8] });
    }
    client.master(MasterCommand::SetDc { cycle: CycleTime::DEFAULT, shift: DcShift::Auto });
    let mode = SlaveCommand::DriveMode { mode: ecmsk::cia402::Mode::Csp, sync: ecmsk::sk::DriveSync::DcSync };
    client.slave(1, mode);
    for state in [MasterState::SafeOp, MasterState::Op] {
        client.master(MasterCommand::SetState(state));
        let tries = (1..=1000).find(|_| {
            client.read();
            let there = client.answer().state == StateByte::reached(state);
            if !there {
                client.write(&Frame::new());
            }
            there
        });
        assert!(tries.is_some(), "{state}: {:?}", client.answer());
    }
}

/// LIB-22 In OP write 2 frames, then read until the free space is above a mark (150, or 160 when idle), repeatedly.
#[test]
fn two_writes_then_reads_to_a_mark() {
    let mut client = client();
    client.op();
    client.slave(1, SlaveCommand::ServoOn);
    client.until("on", |client| client.slot(1).parm & 0xFF == 0x37);
    for n in 0..1000 {
        client.write(&target(n * 20, 0));
        client.write(&target(n * 20 + 10, 0));
        client.until("the mark", |client| client.answer().fifo_free > 150);
    }
    client.until("idle", |client| client.answer().fifo_free == 160);
    for _ in 0..300 {
        client.read();
    }
    assert_eq!((client.slot(1).data1, client.answer().full_count), (999 * 20 + 10, 0));
}

/// LIB-24 The request once, then all-zero frames and reads until CMD, Parm, Data1 and Data2 of slot 41 match.
#[test]
fn an_sdo_by_comparing_the_slot() {
    for state in [MasterState::PreOp, MasterState::Op] {
        let mut client = client();
        client.op();
        client.go(state);
        let window = ObjectAddress::new(0x6065, 0);
        let write = SdoCommand::Write { slave: 1, object: window, size: ecmsk::coe::SdoSize::Four, value: 4321 };
        for command in [write, SdoCommand::Read { slave: 1, object: window }] {
            let asked = command.encode();
            client.sdo(command);
            let tries = (1..=800).find(|_| {
                client.write(&Frame::new());
                client.read();
                let slot = client.slot(SIZE.sdo_slot());
                (slot.id, slot.parm, slot.data1, slot.data2) == (asked.id, 1, asked.data1, 4321)
            });
            assert!(tries.is_some(), "{state}: {:?}", client.slot(41));
        }
    }
}

/// LIB-25 0x37 is "on", bit 0 clear is "off", Data2 >> 16 is an alarm.
#[test]
fn statuswords_as_applications_read_them() {
    let (mut client, network) = open(1, RunOptions::default());
    client.op();
    client.slave(1, SlaveCommand::ServoOn);
    client.until("on", |client| client.slot(1).parm & 0xFF == 0x37);
    client.slave(1, SlaveCommand::ServoOff);
    client.until("off", |client| client.slot(1).parm & 1 == 0);
    assert_eq!(client.slot(1).data2 >> 16, 0);
    network.apply_fault(
        1,
        ecmsk::slave::Fault::Alarm { axis: 0, fault: ecmsk::slave::DeviceFault { code: 0x2310, resettable: true } },
    );
    client.until("an alarm", |client| client.slot(1).data2 >> 16 == 0x2310);
}

/// LIB-26 One thread reads while another one writes.
#[test]
fn a_reader_beside_a_writer() {
    let mut client = client();
    client.op();
    let link = &client.link;
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for n in 0..2000 {
                let mut frame = Frame::new();
                frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n)).into());
                link.write(&frame, Wait::Forever).unwrap();
            }
        });
        scope.spawn(|| {
            let mut report = Frame::new();
            let mut last = None;
            for _ in 0..2000 {
                let meta = link.read(&mut report, Wait::Forever).unwrap();
                assert!(last < Some(meta.sequence), "in order");
                assert!(report.check_crc(SIZE, ecmsk::sk::CrcPolicy::Strict).is_ok(), "whole");
                last = Some(meta.sequence);
            }
        });
    });
    while client.try_read(Wait::Now).is_ok() {}
    client.read();
    let left = 160 - u64::from(client.answer().fifo_free);
    let counters = client.link.stats().board.unwrap();
    assert_eq!(counters.executed + counters.full + left, 2000, "{counters:?}");
}
