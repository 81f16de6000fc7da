//! Tests of the pipe over a simulated libusb, which can cause events on request that a real kernel causes only by
//! chance.

#[cfg(target_os = "linux")]
mod ended_by_force;
#[cfg(target_os = "linux")]
mod in_a_signal_handler;

use std::sync::mpsc;
use std::thread;

use super::super::calls::{PATIENCE, in_time, read};
use super::super::libusb::fake::{self, FakeUsb, ReportReaction};
use super::super::libusb::status;
use super::super::reports::EVENTS_FAILED;
use super::*;

const INTERFACE_OF_BOARD: ReportInterface = ReportInterface { number: 0, input: 0x81, output: 0x02 };
const LIMITS: PipeOptions = PipeOptions { transfers: 3, queue: 4, may_pause_input: false };
const NOTHING_LEFT: [isize; 5] = [0; 5];
const SOON: Option<Duration> = Some(Duration::from_millis(20));

#[track_caller]
fn open(world: &'static FakeUsb) -> Pipe {
    let found = world.found();
    assert_eq!((found.interface, found.path.as_str(), found.bus_and_address), (Ok(INTERFACE_OF_BOARD), "9-2", (9, 7)));
    Pipe::open(&found, INTERFACE_OF_BOARD, LIMITS).expect("it opens")
}

/// A listener that panics whenever it is called.
#[derive(Default)]
struct Panics {
    lost: Mutex<bool>,
}

impl crate::io::hid::backend::TransferListener for Panics {
    fn input_ended(&self, _: usize, _: Outcome, _: &[u8], _: &dyn Fn() -> Result<(), UsbError>) {
        panic!("this panic is part of the test");
    }

    fn output_ended(&self, _: Outcome, _: usize) {}

    fn panicked(&self) {
        *self.lost.lock() = true;
        panic!("so is this one");
    }
}

/// A panic in a callback of libusb is caught: the program continues, and the board counts as lost.
#[test]
fn a_panic_in_the_callback_does_not_end_the_program() {
    let world = FakeUsb::new();
    let listener = Arc::new(Panics::default());
    let backend = world.found().device.open_backend(INTERFACE_OF_BOARD, 1, &listener).expect("it opens");
    backend.submit_input(0).expect("it is handed over");
    world.send(status::COMPLETED, &[1; 512]);
    while !*listener.lost.lock() {
        backend.handle_events(PATIENCE).expect("events are handled");
    }
    let shared = Shared::new(LIMITS);
    crate::io::hid::backend::TransferListener::panicked(&shared);
    let why = shared.state.lock().check().unwrap_err().to_string();
    assert!(why.contains("defect") && why.contains("open it again"), "{why}");
}

/// Reports are returned in order with their numbers; empty and short ones are skipped and counted.
#[test]
fn empty_and_short_reports_are_skipped_and_counted() {
    let world = FakeUsb::new();
    let pipe = open(world);
    for bytes in [&[1; 512][..], &[], &[2; 511], &[3; 1], &[4; 512]] {
        world.send(status::COMPLETED, bytes);
    }
    assert_eq!(read(&pipe, Some(PATIENCE)), Ok((1, 0)));
    assert_eq!(read(&pipe, Some(PATIENCE)), Ok((4, 1)));
    assert_eq!(pipe.stats(), PipeStats { reports: 2, dropped: 0, short: 3, failed: 0 });
    assert_eq!(read(&pipe, SOON), Err(PipeError::Timeout(SOON.unwrap())));
}

#[test]
fn of_reports_nobody_reads_the_newest_are_kept() {
    let world = FakeUsb::new();
    let pipe = open(world);
    (0..10).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
    world.until_pending(LIMITS.transfers);
    assert_eq!(
        (0..4).map(|_| read(&pipe, None)).collect::<Result<Vec<_>, _>>(),
        Ok((6..10).map(|n| (n, n.into())).collect())
    );
    assert_eq!(pipe.stats(), PipeStats { reports: 10, dropped: 6, short: 0, failed: 0 });
}

/// Waiting calls handle libusb's events themselves. Between two calls, while the program does something else, reports
/// are received nevertheless, even more than there are transfers.
#[test]
fn reports_are_taken_between_two_calls() {
    let world = FakeUsb::new();
    let pipe = open(world);
    let mut sent = 0;
    for _ in 0..20 {
        // The read either times out or gets a report: after both, the pipe's thread must handle events again.
        assert_eq!(read(&pipe, SOON), Err(PipeError::Timeout(SOON.unwrap())));
        world.send(status::COMPLETED, &[1; 512]);
        sent += 1;
        assert_eq!(read(&pipe, None), Ok((1, sent - 1)));
        (0..10).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
        sent += 10;
        world.until_pending(LIMITS.transfers);
        for fill in 6..10 {
            assert_eq!(read(&pipe, None), Ok((fill, sent - 10 + u64::from(fill))));
        }
    }
}

/// Starts a read that waits and handles libusb's events while the pipe's thread sleeps.
#[track_caller]
fn waiting_reader(world: &FakeUsb, pipe: &Arc<Pipe>) -> thread::JoinHandle<Result<(u8, u64), PipeError>> {
    let reads = pipe.clone();
    let reader = thread::spawn(move || read(&reads, None));
    let state = || (pipe.shared.state.lock().thread_asleep, world.event_waits());
    for round in 0..400 {
        if round % 3 == 0 {
            // The tests need a reader that handles USB events, but the pipe's own thread may still handle them, since
            // it started before the reader. Cancelling writes wakes that thread, so that the reader can take over.
            pipe.cancel_writes();
        }
        let before = state();
        thread::sleep(Duration::from_millis(50));
        if before.0 && state() == before {
            return reader;
        }
    }
    panic!("the pipe's thread does not sleep");
}

/// The pipe's thread sleeps while a call waits for a silent board, and wakes when the call returns. So reports are
/// received between two calls in this case too.
#[test]
fn the_pipes_thread_sleeps_while_a_call_waits() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    for round in 0..10 {
        let reader = waiting_reader(world, &pipe);
        world.send(status::COMPLETED, &[1; 512]);
        assert_eq!(in_time(|| reader.join().unwrap()), Ok((1, round * 9)));
        (0..8).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
        world.until_pending(LIMITS.transfers);
        for fill in 4..8 {
            assert_eq!(read(&pipe, None), Ok((fill, round * 9 + 1 + u64::from(fill))));
        }
    }
}

/// The pipe's thread, which sleeps while a call waits, checks at an interval whether the thread of that call still
/// exists. If the call returns just when this check is due, the pipe's thread does not sleep again.
#[test]
fn the_pipes_thread_wakes_if_its_check_is_due_when_a_call_returns() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    for _ in 0..3 {
        let reader = waiting_reader(world, &pipe);
        // First the reader, then the pipe's thread waits for this lock, which the reader mostly gets twice before the
        // pipe's thread gets it.
        let held = pipe.shared.state.lock();
        world.send(status::COMPLETED, &[1; 512]);
        thread::sleep(2 * CALLER_CHECK_INTERVAL);
        drop(held);
        assert_eq!(in_time(|| reader.join().unwrap()).map(|(fill, _)| fill), Ok(1));
        (0..8).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
        world.until_pending(LIMITS.transfers);
        while read(&pipe, SOON).is_ok() {}
    }
}

/// A write that finds the board gone ends a read that is handling events, even without further events.
#[test]
fn a_write_that_finds_the_board_gone_ends_a_read() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    let reader = waiting_reader(world, &pipe);
    world.answer("submit", -4);
    assert_eq!(pipe.write(&[0; REPORT_LEN], None), Err(PipeError::Lost(GONE)));
    assert_eq!(in_time(|| reader.join().unwrap()), Err(PipeError::Lost(GONE)));
}

/// LIB-65 If a write finds the board gone, the unread reports in the queue are not returned any more; they count as
/// dropped.
#[test]
fn kept_reports_go_with_the_board() {
    let world = FakeUsb::new();
    let pipe = open(world);
    (0..4).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
    assert_eq!(read(&pipe, Some(PATIENCE)), Ok((0, 0)));
    world.answer("submit", -4);
    assert_eq!(pipe.write(&[0; REPORT_LEN], None), Err(PipeError::Lost(GONE)));
    assert_eq!(read(&pipe, Some(PATIENCE)), Err(PipeError::Lost(GONE)));
    pipe.close();
    let stats = pipe.stats();
    assert_eq!(stats.dropped, stats.reports - 1, "each is counted once");
}

/// WIRE-95 If the system permanently stops reporting the ends of transfers, every call ends with that reason, and so
/// does closing. Memory that the system may still use is not freed.
#[test]
fn events_that_fail_for_good_end_every_call() {
    for closed in [false, true] {
        let world = FakeUsb::new();
        let pipe = Arc::new(open(world));
        world.set_reaction(ReportReaction::None { moved: 0 });
        let reader = waiting_reader(world, &pipe);
        let writes = pipe.clone();
        let writer = thread::spawn(move || writes.write(&[1; REPORT_LEN], None));
        world.until_pending(LIMITS.transfers + 1);
        world.fail_events(u32::MAX);
        let closes = pipe.clone();
        if closed {
            in_time(move || closes.close());
        } else {
            drop(closes);
        }
        for call in [in_time(|| reader.join().unwrap().map(drop)), in_time(|| writer.join().unwrap())] {
            // Closing the pipe and the failure happen at the same time: a call reports the one that it sees first.
            assert!(
                call == Err(PipeError::Lost(EVENTS_FAILED)) || (closed && call == Err(PipeError::Closed)),
                "{call:?}"
            );
        }
        let ended = Err(if closed { PipeError::Closed } else { PipeError::Lost(EVENTS_FAILED) });
        assert_eq!((read(&pipe, None).map(drop), pipe.write(&[2; REPORT_LEN], None)), (ended, ended));
        in_time(move || drop(pipe));
        let [_, _, _, claims, _] = world.leaked();
        assert_eq!(claims, 0, "others may have the board");
    }
}

/// WIRE-95 Occasional errors of the event handling are not errors of the board: reports continue.
#[test]
fn events_that_fail_at_times_end_nothing() {
    let world = FakeUsb::new();
    let pipe = open(world);
    for round in 0..4 {
        world.fail_events(40);
        world.send(status::COMPLETED, &[7; 512]);
        assert_eq!(read(&pipe, Some(PATIENCE)), Ok((7, round)));
    }
    drop(pipe);
    assert_eq!(world.leaked(), NOTHING_LEFT);
}

/// If the call that handles libusb's events for all calls ends, the other calls continue, and each ends by its own
/// report or cancellation.
#[test]
fn calls_do_not_need_one_another() {
    for round in 0..20 {
        let world = FakeUsb::new();
        let pipe = Arc::new(open(world));
        world.set_reaction(ReportReaction::None { moved: 0 });
        let (reads, writes) = (pipe.clone(), pipe.clone());
        let readers = [reads.clone(), reads].map(|pipe| thread::spawn(move || read(&pipe, None)));
        let writer = thread::spawn(move || writes.write(&[1; REPORT_LEN], None));
        world.until_pending(LIMITS.transfers + 1);
        world.send(status::COMPLETED, &[7; 512]);
        world.send(status::COMPLETED, &[8; 512]);
        let mut ended = readers.map(|reader| in_time(|| reader.join().unwrap().unwrap()));
        ended.sort_unstable();
        assert_eq!(ended, [(7, 0), (8, 1)], "round {round}");
        pipe.cancel_writes();
        assert_eq!(in_time(|| writer.join().unwrap()), Err(PipeError::Cancelled), "round {round}");
        assert_eq!(read(&pipe, SOON), Err(PipeError::Timeout(SOON.unwrap())));
    }
}

/// If the board's endpoint to the host stalls, the board is lost at once, and the error says what to do. The next
/// program that opens the board finds the halt cleared.
#[test]
fn a_stall_of_the_board_ends_every_read() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    let waits = pipe.clone();
    let reader = thread::spawn(move || read(&waits, None));
    world.send(status::STALL, &[]);
    let Err(PipeError::Lost(why)) = in_time(|| reader.join().unwrap()) else { panic!("it is lost") };
    assert!(why.contains("stalls") && why.contains("switch it off and on"), "{why}");
    assert_eq!(pipe.write(&[0; REPORT_LEN], None), Err(PipeError::Lost(why)));
    assert!(world.halts_cleared().is_empty());
    pipe.close();
    assert_eq!(world.halts_cleared(), [INTERFACE_OF_BOARD.input]);
    drop(pipe);
    assert_eq!(world.leaked(), NOTHING_LEFT);
}

/// A forked child that executes no other program keeps no descriptor of the device. Otherwise nobody could open the
/// board after the end of the program.
#[test]
fn a_forked_child_lets_go_of_the_device() {
    let world = FakeUsb::with_descriptor();
    let pipe = open(world);
    let descriptor = world.descriptor();
    // SAFETY: the child makes calls of the system alone, and uses nothing of its parent.
    let status = unsafe {
        let child = libc::fork();
        if child == 0 {
            threads::close_in_child();
            libc::_exit(i32::from(libc::fcntl(descriptor, libc::F_GETFD) != -1));
        }
        let mut status = -1;
        assert_eq!(libc::waitpid(child, &raw mut status, 0), child);
        status
    };
    assert_eq!(status, 0, "the child has it");
    drop(pipe);
    assert_eq!(world.leaked(), NOTHING_LEFT);
}

/// If the board refuses a report, only that write fails; reads continue, and the next write succeeds.
#[test]
fn a_stall_of_a_write_is_an_error_of_that_write() {
    let world = FakeUsb::new();
    let pipe = open(world);
    world.set_reaction(ReportReaction::Nothing);
    assert_eq!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Stalled));
    assert_eq!(world.halts_cleared(), [INTERFACE_OF_BOARD.output]);
    world.set_reaction(ReportReaction::All);
    assert_eq!(pipe.write(&[2; REPORT_LEN], None), Ok(()));
    world.send(status::COMPLETED, &[7; 512]);
    assert_eq!(read(&pipe, None), Ok((7, 0)));
    assert_eq!(world.taken(), [[2; REPORT_LEN]]);
}

/// A write that has timed out, that was cancelled, or whose pipe was closed reports whether nothing, a part or all of
/// the report was transferred.
#[test]
fn a_write_that_is_given_up_says_what_has_moved() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    let limit = SOON.unwrap();
    for (moved, expected) in
        [(0, Err(PipeError::Timeout(limit))), (64, Err(PipeError::Partial { moved: 64 })), (REPORT_LEN, Ok(()))]
    {
        world.set_reaction(ReportReaction::None { moved });
        assert_eq!(pipe.write(&[5; REPORT_LEN], SOON), expected);
    }
    assert_eq!(world.taken(), [[5; REPORT_LEN]], "it was through when it was taken back");

    world.set_reaction(ReportReaction::None { moved: 0 });
    let write = || {
        let pipe = pipe.clone();
        let writer = thread::spawn(move || pipe.write(&[6; REPORT_LEN], None));
        world.until_pending(LIMITS.transfers + 1);
        writer
    };
    let writer = write();
    pipe.cancel_writes();
    assert_eq!(in_time(|| writer.join().unwrap()), Err(PipeError::Cancelled));
    let writer = write();
    pipe.close();
    assert_eq!(in_time(|| writer.join().unwrap()), Err(PipeError::Closed));
    assert_eq!(world.taken().len(), 1);
}

/// The cable is cut at each single call of libusb during opening, using and closing. Every call ends by itself and
/// reports that the board is gone, and no libusb object is left.
#[test]
fn a_cable_cut_at_any_moment_ends_every_call() {
    fn run(world: &'static FakeUsb) -> Result<(), PipeError> {
        let bus = world.bus()?;
        let found = super::super::find(&bus, fake::VENDOR, fake::PRODUCT)?.pop();
        let found = found.ok_or(UsbError::NoDevice)?;
        // Once the device is unplugged its descriptors cannot be read.
        let interface = found.interface.map_err(|_| UsbError::NoDevice)?;
        let pipe = Pipe::open(&found, interface, LIMITS)?;
        world.send(status::COMPLETED, &[1; 512]);
        let mut all = Ok(());
        for _ in 0..2 {
            all = all.and(pipe.write(&[0; REPORT_LEN], None));
        }
        all = all.and(read(&pipe, Some(PATIENCE)).map(drop));
        all = all.and(pipe.check());
        pipe.close();
        all
    }
    let whole = FakeUsb::new();
    assert_eq!(run(whole), Ok(()));
    assert_eq!(whole.leaked(), NOTHING_LEFT);
    let mut lost = 0;
    for call in 1..=whole.calls() {
        let world = FakeUsb::new();
        world.pull_at(call);
        match in_time(move || run(world)) {
            Err(PipeError::Lost(_) | PipeError::Usb(UsbError::NoDevice)) => lost += 1,
            other => assert_eq!(other, Ok(()), "call {call} of {}", whole.calls()),
        }
        assert_eq!(world.leaked(), NOTHING_LEFT, "call {call}");
    }
    assert!(lost >= 10, "most calls come before the end: {lost} of {}", whole.calls());
}

#[test]
fn reader_and_writer_are_told_when_the_cable_is_pulled() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    world.set_reaction(ReportReaction::None { moved: 0 });
    let (reads, writes) = (pipe.clone(), pipe.clone());
    let reader = thread::spawn(move || read(&reads, None).map(drop));
    let writer = thread::spawn(move || writes.write(&[1; REPORT_LEN], None));
    world.until_pending(LIMITS.transfers + 1);
    world.pull();
    for call in [reader, writer] {
        assert_eq!(in_time(|| call.join().unwrap()), Err(PipeError::Lost(GONE)));
    }
    assert_eq!(pipe.check(), Err(PipeError::Lost(GONE)));
    assert_eq!(pipe.write(&[1; REPORT_LEN], None), Err(PipeError::Lost(GONE)));
}

/// A report arrives just while the pipe is being closed. Its transfer must not be resubmitted after the cancellation,
/// since closing would then wait for the board's next report.
#[test]
fn a_report_in_the_moment_of_closing_holds_nobody_up() {
    let world = FakeUsb::new();
    let pipe = Arc::new(open(world));
    let (closing, closed) = mpsc::channel();
    let closer = pipe.clone();
    world.at_next_submit(move || {
        thread::spawn(move || {
            closer.close();
            let _ = closing.send(());
        });
        // Waits for a cancellation of the transfer. If the pipe wrongly allows a cancellation before the transfer is
        // submitted, it happens now.
        world.wait_for_a_cancel(Duration::from_millis(100));
    });
    world.send(status::COMPLETED, &[1; 512]);
    closed.recv_timeout(PATIENCE).expect("close ends");
    drop(pipe);
}

/// Signals to the reading thread, however many, are no errors: the read returns the next report at once.
#[test]
fn signals_do_not_hold_up_reports() {
    let world = FakeUsb::new();
    let pipe = open(world);
    world.signal(2000);
    world.send(status::COMPLETED, &[7; 512]);
    assert_eq!(read(&pipe, Some(PATIENCE / 2)), Ok((7, 0)));
}

/// Transfers that fail on the wire are resubmitted and counted; several failures in a row mean that the board is gone.
#[test]
fn a_wire_that_fails_is_not_asked_for_ever() {
    const ERROR: i32 = 1;
    let world = FakeUsb::new();
    let pipe = open(world);
    for _ in 0..5 {
        (0..8).for_each(|_| world.send(ERROR, &[]));
        world.send(status::COMPLETED, &[1; 512]);
        assert!(read(&pipe, Some(PATIENCE)).is_ok());
    }
    assert_eq!(pipe.stats().failed, 40);
    (0..9).for_each(|_| world.send(ERROR, &[]));
    let Err(PipeError::Lost(why)) = read(&pipe, Some(PATIENCE)) else { panic!("it is lost") };
    assert!(why.contains("cable"), "{why}");
}

/// Whichever call fails while a board is opened, nothing stays open.
#[test]
fn an_open_that_fails_leaves_nothing() {
    for (name, code, error) in [
        ("open", -3, PipeError::Usb(UsbError::Access)),
        ("detach_driver_by_itself", -99, PipeError::Usb(UsbError::Other(-99))),
        ("claim", -6, PipeError::Usb(UsbError::Busy)),
        ("submit", -11, PipeError::Usb(UsbError::NoMemory)),
        ("submit", -4, PipeError::Lost(GONE)),
    ] {
        let world = FakeUsb::new();
        world.answer(name, code);
        let found = world.found();
        let refused = Pipe::open(&found, INTERFACE_OF_BOARD, LIMITS).map(drop);
        assert_eq!(refused, Err(error), "{name}");
        drop(found);
        assert_eq!(world.leaked(), NOTHING_LEFT, "{name}");
    }
    let world = FakeUsb::new();
    world.answer("detach_driver_by_itself", -12);
    drop(open(world));
    assert_eq!(world.leaked(), NOTHING_LEFT, "a system without kernel drivers");
}

/// A device without an active configuration, and a device with invalid descriptors, are reported as such.
#[test]
fn a_device_without_descriptors_is_no_board() {
    use super::super::NotTheBoard;

    for (code, why) in [(-5, NotTheBoard::Unconfigured), (-1, NotTheBoard::Descriptors)] {
        let world = FakeUsb::new();
        world.answer("configuration", code);
        assert_eq!(world.found().interface, Err(why));
    }
    assert!(NotTheBoard::Unconfigured.to_string().contains("too little power"));
    let world = FakeUsb::new();
    world.answer("devices", -11);
    let bus = world.bus().unwrap();
    assert!(matches!(super::super::find(&bus, 1, 2), Err(UsbError::NoMemory)));
    let world = FakeUsb::new();
    world.answer("init", -99);
    assert!(matches!(world.bus(), Err(UsbError::Other(-99))));
}
