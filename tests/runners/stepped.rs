//! The runner of virtual time: time passes only by calls, and the same calls produce the same bytes.

use std::time::Duration;

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Stepped, Stop};
use ecmsk::link::engine::RunOptions;
use ecmsk::link::{Dir, LinkError, Stamp, Wait};
use ecmsk::sk::{
    CycleTime, DcShift, FIFO_ENTRIES, Frame, MasterCommand, MasterState, SdoCommand, SlaveCommand, StateByte,
};

use crate::client::{Client, MS, board, open, soft_reset, target};

const MICROFRAME: u64 = 125_000;

fn options() -> RunOptions {
    RunOptions::default()
}

/// SK-9.8 One thread that makes the same calls sees the same bytes at the same times in each run.
#[test]
fn the_same_calls_give_the_same_bytes() {
    let run = || {
        let (mut client, network) = open(3, options());
        let mut seen: Vec<(Frame, Stamp, u64, u64)> = Vec::new();
        let mut keep = |client: &mut Client, wait| {
            if let Ok(meta) = client.try_read(wait) {
                seen.push((client.report.clone(), meta.at, meta.sequence, meta.dropped));
            }
        };
        client.op();
        client.slave(1, SlaveCommand::ServoOn);
        (0..200).for_each(|_| keep(&mut client, Wait::Forever));
        for n in 0..3000 {
            client.write(&target(n * 40, n as u8));
            match n % 7 {
                0 => keep(&mut client, Wait::Forever),
                1 => keep(&mut client, Wait::Now),
                2 => keep(&mut client, Wait::For(Duration::from_micros(300))),
                _ => {}
            }
            match n {
                700 => client.sdo(SdoCommand::Read { slave: 2, object: ObjectAddress::new(0x1018, 4) }),
                1500 => network.silence(3, true),
                2500 => client.slave(1, SlaveCommand::ServoOff),
                _ => {}
            }
        }
        (0..400).for_each(|_| keep(&mut client, Wait::Forever));
        (seen, client.link.stats())
    };
    let (first, second) = (run(), run());
    assert_eq!(first.1, second.1);
    assert_eq!(first.0.len(), second.0.len());
    assert!(first.0 == second.0, "the same frames, times and numbers");
    assert!(first.0.len() > 1000);
}

/// SK-9.10 A write takes a microframe of the board's time, so that a tight writer writes 8 frames per cycle and fills
/// the FIFO. LIB-23 It may go on without one read.
#[test]
fn a_tight_writer_fills_the_fifo() {
    let (mut client, _) = open(1, options());
    client.op();
    let mut last = None;
    for n in 0..1000u64 {
        let at = client.link.write(&target(n as i32, n as u8), Wait::Forever).unwrap();
        if let Some(last) = last.replace(at) {
            assert_eq!(at.0, last.0 + MICROFRAME, "frame {n}");
        }
    }
    let counters = client.link.stats().board.unwrap();
    // 125 ms: as many entries executed, 160 in the FIFO, the others lost.
    assert!((124..=126).contains(&counters.executed), "{counters:?}");
    assert_eq!(counters.executed + 160 + counters.full, 1000, "{counters:?}");
    client.until("what was inside", |client| client.answer().fifo_free == FIFO_ENTRIES);
    assert_eq!(u64::from(client.answer().full_count), counters.full);
}

/// SK-9.10 With host_us=0 a write takes no time at all.
#[test]
fn a_write_may_take_no_time() {
    let (mut client, _) = open(1, RunOptions { host_ns: 0, ..options() });
    client.op();
    let first = client.link.write(&Frame::new(), Wait::Forever).unwrap();
    for _ in 0..499 {
        assert_eq!(client.link.write(&Frame::new(), Wait::Forever).unwrap(), first);
    }
    let counters = client.link.stats().board.unwrap();
    assert_eq!((counters.executed, counters.full), (0, 340));
    client.until("the newest report", |client| client.answer().full_count == 340);
    assert_eq!(client.answer().fifo_free, 1, "the first cycle after them");
}

/// LIB-55 Without a reader the newest 32 reports are kept and the dropped ones counted, for a minute too. SK-9.11 Old
/// reports are read first. SK-9.9 One report per cycle.
#[test]
fn a_host_that_stops_reading_finds_the_newest_reports() {
    for (queue, cycle_us) in [(32, 1000), (32, 4000), (1, 1000)] {
        let (mut client, _) = open(1, RunOptions { host_ns: 1000 * MS, queue, ..options() });
        client.master(MasterCommand::SetDc { cycle: CycleTime::from_us(cycle_us).unwrap(), shift: DcShift::Auto });
        client.op();
        let before = client.read();
        // A minute: 60 writes of a second.
        let mut end = Stamp(0);
        for _ in 0..60 {
            end = client.link.write(&Frame::new(), Wait::Forever).unwrap();
        }
        let kept: Vec<_> = (0..queue).map(|_| client.read()).collect();
        let cycle = u64::from(cycle_us) * 1000;
        for pair in kept.windows(2) {
            assert_eq!(pair[1].sequence, pair[0].sequence + 1);
            assert_eq!(pair[1].at.0, pair[0].at.0 + cycle);
        }
        let newest = kept.last().unwrap();
        assert!(newest.at <= end && newest.at.0 + cycle > end.0, "up to the present");
        let passed = newest.sequence - before.sequence;
        assert_eq!(passed, (newest.at.0 - before.at.0) / cycle);
        assert_eq!(kept[0].dropped, before.dropped + passed - queue as u64);
        assert_eq!(client.link.stats().reports_dropped, kept[0].dropped);
        // Then one report per cycle again, none lost.
        let next = client.read();
        assert_eq!((next.sequence, next.dropped), (newest.sequence + 1, kept[0].dropped));
    }
}

/// LIB-36 A read with a limit ends after that time of the board, and leaves the buffer unchanged. SK-9.10 Time passes
/// during waits, and by polling too.
#[test]
fn a_read_with_a_limit_ends_after_that_board_time() {
    let (mut client, _) = open(1, options());
    client.master(MasterCommand::SetDc { cycle: CycleTime::from_us(512_000).unwrap(), shift: DcShift::Auto });
    client.op();
    let last = client.read();
    while client.try_read(Wait::Now).is_ok() {}
    let before = client.report.clone();

    let limit = Duration::from_millis(100);
    let ended = client.try_read(Wait::For(limit)).unwrap_err();
    assert!(matches!(ended, LinkError::Timeout { dir: Dir::Read, waited, .. } if waited == limit), "{ended:?}");
    assert!(ended.to_string().contains("100ms"), "{ended}");
    assert_eq!(client.report, before);

    // The elapsed time shows in the time stamp of a write.
    let early = client.link.write(&Frame::new(), Wait::Forever).unwrap();
    for _ in 0..80 {
        client.try_read(Wait::Now).unwrap_err();
    }
    let late = client.link.write(&Frame::new(), Wait::Forever).unwrap();
    assert_eq!(late.0 - early.0, 80 * MICROFRAME + MICROFRAME);
    let next = client.try_read(Wait::For(Duration::MAX)).unwrap();
    assert_eq!((next.at.0 - last.at.0) % (512 * MS), 0);
    assert_eq!(client.read().at.0, next.at.0 + 512 * MS);
}

/// SK-9.12 In OP no report comes while the cable before the first slave is cut: on virtual time nothing else can happen
/// during a wait, so a read fails at once, with the time of the cut, and works again when the cable does. SK-9.8 Below
/// OP reports go on.
#[test]
fn a_silent_bus_fails_at_once() {
    let (mut client, network) = open(1, options());
    client.op();
    while client.try_read(Wait::Now).is_ok() {}
    let last = client.read();
    network.cut_after(0);
    for (n, wait) in [Wait::Forever, Wait::Forever, Wait::For(Duration::MAX), Wait::Forever].into_iter().enumerate() {
        let ended = client.try_read(wait).unwrap_err();
        assert_eq!(ended, LinkError::Silent { since_ns: last.at.0, cycles: n as u64 + 1 });
        assert!(ended.to_string().contains(&format!("since {}ms", last.at.0 / MS)), "{ended}");
    }
    client.write(&Frame::new());
    network.heal();
    let next = client.read();
    assert_eq!(next.sequence, last.sequence + 1, "no report was made meanwhile");
    assert_eq!(next.at.0, last.at.0 + 5 * MS, "time has passed, a cycle for each read");

    let (mut client, network) = open(1, options());
    network.cut_after(0);
    for _ in 0..100 {
        client.read();
    }
}

/// SK-4.34 SW_RESET drops the connection: it is lost for every call that follows. LIB-49 It stays lost although the
/// board has booted, until it is opened again.
#[test]
fn a_reset_board_is_lost() {
    let (mut client, _) = open(1, options());
    client.op();
    client.write(&soft_reset());
    let before = client.report.clone();
    for _ in 0..10_000 {
        let read = client.try_read(Wait::Forever).unwrap_err();
        assert!(matches!(read, LinkError::Lost { .. }), "{read:?}");
        let write = client.link.write(&Frame::new(), Wait::Forever).unwrap_err();
        assert!(matches!(write, LinkError::Lost { .. }), "{write:?}");
        assert!(matches!(client.link.check(), Err(LinkError::Lost { .. })));
    }
    assert_eq!(client.report, before, "a failing read of the native API leaves the buffer alone");
    client.link.close();
    assert_eq!(client.try_read(Wait::Forever), Err(LinkError::Closed));
    assert_eq!(client.link.check(), Err(LinkError::Closed));
}

/// LIB-41 Calls after close fail at once; LIB-47 closing twice is harmless.
#[test]
fn a_closed_link_is_closed() {
    let (mut client, _) = open(1, options());
    client.op();
    let stats = client.link.stats();
    client.link.close();
    client.link.close();
    assert_eq!(client.try_read(Wait::Forever), Err(LinkError::Closed));
    assert_eq!(client.link.write(&Frame::new(), Wait::Forever), Err(LinkError::Closed));
    let after = client.link.stats();
    assert_eq!((after.board, after.written, after.read), (stats.board, stats.written, stats.read), "they stay");
    assert_eq!((after.read_errors, after.write_errors), (1, 1));
}

/// SK-9.9 Before OP a report comes each default cycle, in OP each EtherCAT cycle. SK-9.8 With or without a command.
#[test]
fn a_report_a_cycle_in_every_state() {
    for cycle_us in [250, 1000, 8000] {
        let (mut client, _) = open(1, options());
        let spacing = |client: &mut Client| {
            while client.try_read(Wait::Now).is_ok() {}
            let [a, b] = [client.read(), client.read()];
            (b.at.0 - a.at.0, b.sequence - a.sequence)
        };
        client.master(MasterCommand::SetDc { cycle: CycleTime::from_us(cycle_us).unwrap(), shift: DcShift::Auto });
        assert_eq!(spacing(&mut client), (MS, 1));
        client.op();
        assert_eq!(spacing(&mut client), (u64::from(cycle_us) * 1000, 1));
        for state in [MasterState::SafeOp, MasterState::Init, MasterState::PreOp] {
            client.go(state);
            assert_eq!(spacing(&mut client), (MS, 1), "{state}");
            assert_eq!(client.answer().state, StateByte::reached(state));
        }
    }
}

/// SK-9.8 A pass of time advances the board, and its reports are kept as without a reader. A report that is due exactly
/// at the end of the limit comes. LIB-49 The reset of a board is an error.
#[test]
fn passed_time_makes_reports_as_if_nobody_read() {
    let (board, _) = board(1);
    let zero = board.now();
    let stepped = Stepped::new(board, 0, 32);
    assert_eq!(stepped.pass(5 * MS), Ok(zero + 5 * MS));
    let mut report = Frame::new();
    let look = || stepped.read(&mut report, Some(Duration::ZERO)).ok();
    let times: Vec<_> = std::iter::from_fn(look).map(|report| report.at).collect();
    assert_eq!((times.len(), times[4] - times[0]), (5, 4 * MS));
    let mut read = |limit| stepped.read(&mut report, limit).map(|report| report.at);
    let at = read(None).unwrap();
    assert_eq!(read(Some(Duration::from_nanos(MS))), Ok(at + MS));
    assert_eq!(read(Some(Duration::from_nanos(MS - 1))), Err(Stop::Timeout));
    stepped.write(&soft_reset()).unwrap();
    assert_eq!(stepped.pass(100 * MS), Err(Stop::Rebooted));
}
