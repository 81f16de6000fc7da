//! Tests of finding and opening boards, and of the pipe, over a simulated Windows.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use super::fake::{BOARD, FakeWindows, Listed, ReportReaction};
use super::*;
use crate::io::hid::calls::{PATIENCE, in_time, read};
use crate::io::hid::reports::Shared;
use crate::io::hid::{NotTheBoard, Pipe, PipeError, PipeOptions, PipeStats};

const TRANSFERS: usize = 3;
const QUEUE: usize = 4;
const SOON: Duration = Duration::from_millis(20);

const LIMITS: PipeOptions = PipeOptions { transfers: TRANSFERS, queue: QUEUE, may_pause_input: false };

fn try_open(world: &'static FakeWindows) -> Result<Pipe, PipeError> {
    open_with(world, LIMITS)
}

fn open_with(world: &'static FakeWindows, limits: PipeOptions) -> Result<Pipe, PipeError> {
    let candidate = world.candidates().expect("it lists").pop().expect("it is there");
    let shared = Arc::new(Shared::new(limits));
    let interface = candidate.interface.expect("a board");
    let backend = candidate.device.open_backend(interface, TRANSFERS, &shared)?;
    Pipe::with_backend(backend, shared)
}

fn open() -> (&'static FakeWindows, Arc<Pipe>) {
    let world = FakeWindows::new(vec![BOARD]);
    let pipe = Arc::new(try_open(world).expect("it opens"));
    (world, pipe)
}

/// WIN-40 Ids, instance and serial number are read from Windows' names: no other device is opened, and no text is read
/// from a device.
#[test]
fn a_board_is_found_by_its_names() {
    let relay = Listed { name: "hid#vid_16c0&pid_05df#7&2&0&0000", parents: &[], reports: [9, 9] };
    let keyboard = Listed { name: "hid#vid_046d&pid_c31c#7&3&0&0000", parents: &[], reports: [9, 2] };
    let composite = Listed {
        name: "hid#vid_16c0&pid_05df&mi_00#8&4&0&0000",
        parents: &[r"USB\VID_16C0&PID_05DF&MI_00\7&5&0&0000", r"USB\VID_16C0&PID_05DF\B"],
        ..BOARD
    };
    let world = FakeWindows::new(vec![composite, keyboard, relay, BOARD]);
    let found = world.candidates().expect("it lists");
    let seen: Vec<_> = found.iter().map(|one| (one.instance.as_str(), one.interface.err())).collect();
    let expected = [("7-1a2b-0-0000", None), ("7-2-0-0000", Some(NotTheBoard::OtherReports)), ("8-4-0-0000", None)];
    assert_eq!(seen, expected);
    assert!(world.opened().iter().all(|path| path.contains("vid_16c0")), "{:?}", world.opened());

    let texts: Vec<_> = found.iter().map(|one| one.device.texts(false)).collect();
    let text = |text: &str| Some(text.to_owned());
    assert_eq!(texts, [(None, text("0001")), (None, None), (None, text("B"))]);
    assert_eq!(world.asked(), 0);
    assert_eq!(found[0].device.texts(true), (text("ECM-SK"), text("0001")), "what Windows knows is not asked for");
    assert_eq!(found[1].device.texts(true), (text("ECM-SK"), text("told")));
    drop(found);
    assert_eq!(world.leaked(), 0);
}

/// WIN-41 Windows' driver passes reports with their id 0 in front, both ways. The report itself has exactly 512 bytes.
#[test]
fn a_report_has_its_number_in_front() {
    let (world, pipe) = open();
    let report: [u8; REPORT_LEN] = std::array::from_fn(|at| (at % 251) as u8 + 1);
    pipe.write(&report, None).expect("it takes it");
    assert_eq!(world.taken(), [[&[0], &report[..]].concat()]);
    for (number, bytes) in [(0, &report[..]), (1, &report), (0, &report[..511]), (0, &[]), (0, &[7; 512])] {
        world.send(number, bytes);
    }
    let mut came = [0; REPORT_LEN];
    assert_eq!(pipe.read(&mut came, Some(PATIENCE)).map(|(_, number)| number), Ok(0));
    assert_eq!(came, report);
    assert_eq!(read(&pipe, Some(PATIENCE)), Ok((7, 1)));
    assert_eq!(pipe.stats(), PipeStats { reports: 2, dropped: 0, short: 3, failed: 0 });
    assert_eq!(read(&pipe, Some(SOON)), Err(PipeError::Timeout(SOON)));
}

/// WIN-42 Reads are pending at all times. The newest unread reports are kept, and the others are counted as dropped.
/// Windows' driver drops reports silently when its queue is full, so the queue is set to its maximum.
#[test]
fn of_reports_nobody_reads_the_newest_are_kept() {
    let (world, pipe) = open();
    world.until_pending(TRANSFERS);
    assert_eq!(world.keeps(), Some(512));
    (0..10).for_each(|fill| world.send(0, &[fill; REPORT_LEN]));
    world.until_pending(TRANSFERS);
    let kept = (0..QUEUE).map(|_| read(&pipe, Some(PATIENCE))).collect::<Result<Vec<_>, _>>();
    assert_eq!(kept, Ok((6..10).map(|number| (number, number.into())).collect()));
    assert_eq!(pipe.stats().dropped, 6);
}

/// WIN-43 Whichever error code Windows uses for an unplugged board, every call ends at once and reports the loss, and
/// so do all later calls. Nothing stays open.
#[test]
fn every_call_ends_when_the_board_goes() {
    for code in [2, 5, 6, 55, 303, 433, 1167, 1617] {
        let (world, pipe) = open();
        world.set_reaction(ReportReaction::Nothing);
        let (reads, writes) = (pipe.clone(), pipe.clone());
        let reader = thread::spawn(move || read(&reads, None).map(drop));
        let writer = thread::spawn(move || writes.write(&[1; REPORT_LEN], None));
        world.until_pending(TRANSFERS + 1);
        world.pull(code);
        for call in [reader, writer] {
            let ended = in_time(|| call.join().expect("no panic"));
            assert!(matches!(ended, Err(PipeError::Lost(_))), "code {code}: {ended:?}");
        }
        assert!(matches!(pipe.check(), Err(PipeError::Lost(_))));
        assert!(matches!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Lost(_))));
        assert!(matches!(read(&pipe, None), Err(PipeError::Lost(_))));
        pipe.close();
        assert_eq!(read(&pipe, None), Err(PipeError::Closed));
        drop(pipe);
        assert_eq!(world.leaked(), 0, "code {code}");
    }
}

/// LIB-65 When the board is gone, unread reports in the queue are dropped and counted, and no longer returned.
#[test]
fn kept_reports_go_with_the_board() {
    let (world, pipe) = open();
    (0..4).for_each(|fill| world.send(0, &[fill; REPORT_LEN]));
    assert_eq!(read(&pipe, Some(PATIENCE)), Ok((0, 0)));
    world.pull(1167);
    assert!(matches!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Lost(_))));
    assert!(matches!(read(&pipe, Some(PATIENCE)), Err(PipeError::Lost(_))));
    pipe.close();
    let stats = pipe.stats();
    assert_eq!((stats.reports - 1, stats.dropped), (stats.dropped, stats.dropped), "each is counted once");
}

/// WIN-43 Transfers that fail on the wire without another reason are repeated; after 9 failures in a row the board
/// counts as gone.
#[test]
fn a_wire_that_fails_is_not_asked_for_ever() {
    let (world, pipe) = open();
    world.set_reaction(ReportReaction::Fails(31));
    assert_eq!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Usb(UsbError::Io)));
    world.set_reaction(ReportReaction::All);
    assert_eq!(pipe.write(&[2; REPORT_LEN], None), Ok(()));
    world.pull(31);
    let ended = in_time({
        let pipe = pipe.clone();
        move || read(&pipe, None)
    });
    assert!(matches!(ended, Err(PipeError::Lost(_))), "{ended:?}");
}

/// WIN-44 A write that the board does not accept is cancelled at its limit, by a cancellation, and by closing the pipe.
/// The next write can then succeed.
#[test]
fn a_write_that_is_not_taken_is_taken_back() {
    let (world, pipe) = open();
    world.set_reaction(ReportReaction::Nothing);
    assert_eq!(pipe.write(&[1; REPORT_LEN], Some(SOON)), Err(PipeError::Timeout(SOON)));
    let write = || {
        let pipe = pipe.clone();
        let writer = thread::spawn(move || pipe.write(&[2; REPORT_LEN], None));
        world.until_pending(TRANSFERS + 1);
        writer
    };
    let writer = write();
    pipe.cancel_writes();
    assert_eq!(in_time(|| writer.join().expect("no panic")), Err(PipeError::Cancelled));
    world.set_reaction(ReportReaction::All);
    assert_eq!(pipe.write(&[3; REPORT_LEN], Some(PATIENCE)), Ok(()));
    world.set_reaction(ReportReaction::Nothing);
    let writer = write();
    pipe.close();
    assert_eq!(in_time(|| writer.join().expect("no panic")), Err(PipeError::Closed));
    assert_eq!(world.taken().iter().map(|report| report[1]).collect::<Vec<_>>(), [3]);
}

/// WIN-44 Reads continue, and can end, while a write does not return from Windows.
#[test]
fn a_write_that_windows_holds_holds_no_read() {
    let (world, pipe) = open();
    world.hold();
    let writes = pipe.clone();
    let writer = thread::spawn(move || writes.write(&[1; REPORT_LEN], Some(SOON)));
    world.send(0, &[7; REPORT_LEN]);
    let reads = pipe.clone();
    assert_eq!(in_time(move || read(&reads, Some(PATIENCE))), Ok((7, 0)));
    let reads = pipe.clone();
    assert_eq!(in_time(move || read(&reads, Some(SOON))), Err(PipeError::Timeout(SOON)));
    world.let_go();
    let ended = in_time(|| writer.join().expect("no panic"));
    assert!(matches!(ended, Ok(()) | Err(PipeError::Timeout(_))), "{ended:?}");
}

/// WIN-44 Closing ends a waiting read at once and releases everything.
#[test]
fn close_ends_a_read_that_waits() {
    let (world, pipe) = open();
    let reads = pipe.clone();
    let reader = thread::spawn(move || read(&reads, None));
    world.until_pending(TRANSFERS);
    pipe.close();
    pipe.close();
    assert_eq!(in_time(|| reader.join().expect("no panic")), Err(PipeError::Closed));
    drop(pipe);
    assert_eq!(world.leaked(), 0);
}

/// WIN-45 If a board cannot be opened, the error says why, and nothing stays open.
#[test]
fn an_open_that_fails_leaves_nothing() {
    for (code, error) in [(5, UsbError::Access), (32, UsbError::Busy), (433, UsbError::NoDevice)] {
        let world = FakeWindows::new(vec![BOARD]);
        world.refuse(code);
        assert_eq!(try_open(world).map(drop), Err(PipeError::Usb(error)));
        assert_eq!(world.leaked(), 0);
    }
    let world = FakeWindows::new(vec![BOARD]);
    let found = world.candidates().expect("it lists");
    world.pull(1167);
    let shared = Arc::new(Shared::new(LIMITS));
    let device = &found[0].device;
    let refused = device.open_backend(found[0].interface.expect("a board"), TRANSFERS, &shared).map(drop);
    assert_eq!(refused, Err(UsbError::NoDevice));
    drop(found);
    assert_eq!(world.leaked(), 0);
}

/// A board with paused input: its program has only written for a while, so that reports stay in Windows' queue.
fn with_paused_input() -> (&'static FakeWindows, Pipe) {
    let world = FakeWindows::new(vec![BOARD]);
    let pipe = open_with(world, PipeOptions { may_pause_input: true, ..LIMITS }).expect("it opens");
    assert_eq!(pipe.write(&[1; REPORT_LEN], None), Ok(()));
    assert_eq!(world.reads(), TRANSFERS);
    in_time(move || {
        // Waits until the driver's queue is set, which begins a pause, and no read is pending. The number of pending
        // reads alone does not show a pause: a read may just not be resubmitted yet.
        while world.keeps() != Some(QUEUE as u32) || world.reads() > 0 {
            pipe.write(&[1; REPORT_LEN], None).expect("it takes it");
            world.send(0, &[99; REPORT_LEN]);
            thread::sleep(Duration::from_millis(1));
        }
        (world, pipe)
    })
}

/// WIN-67 While a program only writes, reports stay in the driver's queue, which keeps the newest reports. The first
/// read returns the oldest of these, and from then on no report is lost.
#[test]
fn while_a_program_only_writes_its_reports_pause() {
    let (world, pipe) = with_paused_input();
    assert_eq!(world.keeps(), Some(QUEUE as u32));
    let before = pipe.stats().reports;
    for fill in 0..10 {
        world.send(0, &[fill; REPORT_LEN]);
        pipe.write(&[1; REPORT_LEN], None).expect("it takes it");
    }
    assert_eq!((world.reads(), pipe.stats().reports), (0, before), "nobody asks for them");
    let first = read(&pipe, Some(PATIENCE)).expect("it reads");
    assert_eq!(first.0, 6, "the newest {QUEUE} are kept");
    assert_eq!(world.keeps(), Some(512));
    for fill in 7..10 {
        assert_eq!(read(&pipe, Some(PATIENCE)).map(|(fill, _)| fill), Ok(fill));
    }
    world.until_pending(TRANSFERS);
    (0..10).for_each(|fill| world.send(0, &[fill; REPORT_LEN]));
    world.until_pending(TRANSFERS);
    assert_eq!(read(&pipe, Some(PATIENCE)).map(|(fill, number)| (fill, number > first.1)), Ok((6, true)));
}

/// WIN-67 If the board sends nothing more, a read after a pause still returns the queued reports without waiting for
/// new ones.
#[test]
fn a_silent_board_ends_a_pause() {
    let (_, pipe) = with_paused_input();
    assert_eq!(read(&pipe, Some(PATIENCE)).map(|(fill, _)| fill), Ok(99));
    let pipe = Arc::new(pipe);
    let reads = pipe.clone();
    assert_eq!(in_time(move || read(&reads, None)).map(|(fill, _)| fill), Ok(99));
}

/// WIN-67 If the board is closed during a pause, all transfers end and all handles are freed. If it is unplugged during
/// a pause, the next write, read or check reports the loss.
#[test]
fn a_board_that_goes_while_its_reports_pause() {
    let (world, pipe) = with_paused_input();
    pipe.close();
    assert_eq!(read(&pipe, None), Err(PipeError::Closed));
    assert_eq!(world.reads(), 0, "nothing is begun any more");
    drop(pipe);
    assert_eq!(world.leaked(), 0);

    let (world, pipe) = with_paused_input();
    world.pull(1167);
    assert!(matches!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Lost(_))));
    assert!(matches!(read(&pipe, None), Err(PipeError::Lost(_))));

    let (world, pipe) = with_paused_input();
    world.pull(1167);
    assert!(matches!(read(&pipe, None), Err(PipeError::Lost(_))), "no kept report is given as true");

    let (world, pipe) = with_paused_input();
    assert_eq!(pipe.check(), Ok(()));
    world.pull(1167);
    assert!(matches!(pipe.check(), Err(PipeError::Lost(_))), "nothing is under way that would tell");
}

/// WIN-67 If a program does nothing with its board, reports stay in the driver's queue and cost no processor time. When
/// the program continues, it reads the newest reports.
#[test]
fn reports_pause_while_a_program_does_nothing() {
    let world = FakeWindows::new(vec![BOARD]);
    let pipe = open_with(world, PipeOptions { may_pause_input: true, ..LIMITS }).expect("it opens");
    let pipe = in_time(move || {
        while world.keeps() != Some(QUEUE as u32) || world.reads() > 0 {
            world.send(0, &[99; REPORT_LEN]);
            thread::sleep(Duration::from_millis(1));
        }
        pipe
    });
    let before = pipe.stats().reports;
    (0..10).for_each(|fill| world.send(0, &[fill; REPORT_LEN]));
    assert_eq!((world.reads(), pipe.stats().reports), (0, before), "nobody asks for them");
    for fill in 6..10 {
        assert_eq!(read(&pipe, Some(PATIENCE)).map(|(fill, _)| fill), Ok(fill));
    }
}

/// WIN-67 There is no pause for a program that reads from time to time, nor for one that must count all its reports:
/// reads are pending at all times.
#[test]
fn others_never_pause() {
    let world = FakeWindows::new(vec![BOARD]);
    let counts = open_with(world, LIMITS).expect("it opens");
    let reader = FakeWindows::new(vec![BOARD]);
    let reads = open_with(reader, PipeOptions { may_pause_input: true, ..LIMITS }).expect("it opens");
    for round in 0..500 {
        for pipe in [&counts, &reads] {
            pipe.write(&[1; REPORT_LEN], None).expect("it takes it");
        }
        let _ = read(&reads, Some(Duration::ZERO));
        [world, reader].iter().for_each(|world| world.send(0, &[round as u8; REPORT_LEN]));
        thread::sleep(Duration::from_millis(1));
    }
    let _ = read(&reads, Some(Duration::ZERO));
    in_time(move || [world, reader].iter().for_each(|world| world.until_pending(TRANSFERS)));
    assert_eq!(counts.stats().dropped, 500 - QUEUE as u64);
}
