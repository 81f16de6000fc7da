//! Frames and reports through the kernel.

use std::time::Duration;

use ecmsk::link::Dir;
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlotSize, StateByte};

use super::hidraw::Hidraw;
use support::served::{PATIENCE, Served, attach, detach_all, recorded};

const SIZE: SlotSize = SlotSize::Bytes12;

fn state(report: &[u8]) -> StateByte {
    MasterResponse::decode(&Frame::from_prefix(report).slot(SIZE, 0)).state
}

fn next(board: &Hidraw) -> Vec<u8> {
    board.get(PATIENCE).expect("the board is there").expect("a report")
}

/// SK-9.5, SK-9.8 513 bytes are written, the first one 0, and 512 are read; reports come without a write.
#[test]
fn hidraw_writes_513_bytes_and_reads_512() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    for _ in 0..10 {
        let report = next(&board);
        assert_eq!((report.len(), state(&report)), (512, StateByte::reached(MasterState::PreOp)));
    }
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op));
    assert_eq!(board.put(frame.bytes()).expect("the board takes it"), 513);
    let mut reports = (0..100_000).map(|_| next(&board));
    assert!(reports.any(|report| state(&report) == StateByte::reached(MasterState::Op)));
    detach_all();
}

/// Every written frame arrives, once, in order and complete.
#[test]
fn no_frame_is_lost_or_doubled() {
    let file = "/tmp/frames.pcapng";
    let served = Served::start(&["sim:?slaves=io&record=%2Ftmp%2Fframes.pcapng"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    let mut sent = Vec::new();
    for number in 0..1000_u32 {
        // Numbered in the data of a slave's slot without a command.
        let mut frame = Frame::new();
        frame.bytes_mut()[16..20].copy_from_slice(&number.to_le_bytes());
        frame.bytes_mut()[504..512].copy_from_slice(&[number as u8; 8]);
        assert_eq!(board.put(frame.bytes()).expect("the board takes it"), 513);
        sent.push(frame);
        if number % 7 == 0 {
            next(&board);
        }
    }
    served.stop();
    let arrived = recorded(file, Dir::Write);
    assert_eq!(arrived.len(), sent.len());
    assert!(arrived == sent, "other frames than were sent, or in another order");
}

/// A reader that opens and closes repeatedly makes the kernel cancel its transfers, while reports arrive.
#[test]
fn readers_come_and_go() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let shown = attach("1-1");
    for round in 0..50 {
        let board = Hidraw::open(&shown);
        for _ in 0..round % 3 {
            assert_eq!(next(&board).len(), 512);
        }
    }
    assert_eq!(next(&Hidraw::open(&shown)).len(), 512);
    detach_all();
}

/// SK-9.7 A short report hangs the board until it is attached again: no report comes, and the kernel gives up its next
/// write and cancels it.
#[test]
fn a_short_packet_hangs_the_board() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    let board = Hidraw::open(&attach("1-1"));
    next(&board);
    assert_eq!(board.put(&[0; 504]).expect("the packet itself is taken"), 505);
    // Earlier reports are in the kernel's queue of 64.
    let late = (0..200).take_while(|_| board.get(Duration::from_millis(500)).expect("it is there").is_some()).count();
    assert!(late <= 64 + 2, "reports go on: {late}");
    let error = board.put(&[0; 512]).expect_err("it hangs");
    assert_eq!(error.kind(), std::io::ErrorKind::TimedOut, "{error}");
    drop(board);
    detach_all();
    let board = Hidraw::open(&attach("1-1"));
    next(&board);
    assert_eq!(board.put(&[0; 512]).expect("it runs"), 513);
    detach_all();
}
