//! The link over wires controlled by a test, on the real clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Config, Ecm, Options};
use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::sk::{CommandId, CrcPolicy, FifoAction, Frame, MasterCommand, MasterState, SlotSize};

use super::frames::{SIZE, all, all_on, axes, board, cycle, drive, master, state, target, to};
use super::wires::{Busy, Held};

const LINK: &str = "spi:/dev/spidev0.0";
/// Longer than any call takes.
const PATIENCE: Wait = Wait::For(Duration::from_secs(60));

#[track_caller]
fn until(link: &dyn Link, mut done: impl FnMut(&Frame) -> bool) -> Frame {
    let mut report = Frame::new();
    for _ in 0..200_000 {
        link.read(&mut report, PATIENCE).unwrap();
        if done(&report) {
            return report;
        }
    }
    panic!("it does not come: {report:?}");
}

fn write(link: &dyn Link, frame: &Frame) {
    link.write(frame, PATIENCE).unwrap();
}

/// In OP, all axes on.
#[track_caller]
fn on(link: &dyn Link, slaves: usize) {
    axes().chain([cycle(1000), to(MasterState::Op)]).for_each(|frame| write(link, &frame));
    until(link, |report| state(report) == Some(MasterState::Op));
    write(link, &all(slaves, CommandId::ServoOn, 0, 0));
    until(link, |report| all_on(report, slaves) && master(report).fifo_free == 160);
}

/// SK-10.3, SK-10.4 The examples' loop over a link with BUSY and over one without: every written frame was sent once
/// and in order, unchanged, and every entry was executed; one report per cycle, each with a right CRC.
#[test]
fn every_frame_written_goes_out_once_and_in_order() {
    for busy in [Busy::True, Busy::None] {
        let sim = link::open("sim:?queue=1&slaves=drive*3", Share::ByName).unwrap();
        let held = Held::over(sim.clone()).busy(busy);
        let link = held.open(LINK).unwrap();
        on(&link, 3);
        let mut n = 0;
        while n < 300 {
            let _ = (write(&link, &target(3, n)), write(&link, &target(3, n + 1)));
            n += 2;
            until(&link, |report| {
                assert_eq!(report.check_crc(SIZE, CrcPolicy::Strict), Ok(()));
                master(report).fifo_free >= 150
            });
        }
        until(&link, |report| master(report).fifo_free == 160);
        link.close();
        let csp = CommandId::Csp.code();
        let went: Vec<Frame> = held.with(|state| {
            let frames = state.exchanges.iter().map(|(_, frame)| frame.clone());
            frames.filter(|frame| frame.slot(SIZE, 1).id == csp).collect()
        });
        assert_eq!(went, (0..300).map(|n| target(3, n)).collect::<Vec<_>>(), "{busy:?}");
        let counters = sim.stats().board.unwrap();
        assert_eq!((counters.full, counters.rejected_total(), counters.crc), (0, 0, 0), "{busy:?}");
        if busy == Busy::None {
            let begins: Vec<_> = held.with(|state| state.exchanges.iter().map(|(at, _)| *at).collect());
            let least = begins.windows(2).map(|pair| pair[1] - pair[0]).min().unwrap();
            // The test's wires take no time for an exchange; the link assumes 168 us.
            assert!(least >= Duration::from_micros(800 - 168), "SK-10.6: {least:?}");
        }
        assert_eq!(link.spi_stats().unsent, 0);
    }
}

/// The native API streams over it, with a prefill and without.
#[test]
fn the_native_api_streams() {
    for keys in ["", "?prefill=8"] {
        let sim = link::open("sim:?queue=1&slaves=drive*2", Share::ByName).unwrap();
        let link = Arc::new(Held::over(sim.clone()).open(&format!("{LINK}{keys}")).unwrap());
        let ecm = Ecm::over(link, Options::default()).unwrap();
        // Closing has a time limit, and the machine may be slow.
        ecm.configure(&Config { cycle_us: 4000, ..Config::drives(2) }).unwrap();
        ecm.set_state(MasterState::Op).unwrap();
        ecm.servo_on(&[1, 2]).unwrap();
        let start = ecm.snapshot().unwrap().position(1).unwrap();
        let mut stream = ecm.stream(20).unwrap();
        for n in 0..150 {
            // At rest at the end, so that finishing has nothing to brake.
            let far = n.min(80) * 10;
            stream.csp(1, start + far).unwrap();
            stream.csp(2, start - far).unwrap();
            stream.step().unwrap();
        }
        let stats = stream.finish().unwrap();
        assert_eq!((stats.frames, stats.losses), (150, 0), "{keys}");
        let moved = ecm.snapshot().unwrap().position(1).unwrap() - start;
        assert!((moved - 800).abs() <= 3, "{keys}: {moved}");
        drop(ecm);
        let counters = sim.stats().board.unwrap();
        assert_eq!((counters.full, counters.rejected_total()), (0, 0), "{keys}");
    }
}

/// The host's frames are sent unchanged, the link's own with a right CRC: a board that checks CRCs accepts both.
/// SK-1.16 The setting of SET_EX remains after the next boot.
#[test]
fn a_board_that_checks_crcs_takes_the_links_own_frames() {
    let opened = || link::open("sim:?queue=1&slaves=drive&name=checks", Share::ByName);
    let held = Held::over(opened().unwrap());
    let (link, errors) = checking(&held, opened);
    let mut wrong = board(&MasterCommand::GetStatus);
    wrong.bytes_mut()[3] ^= 0xFF;
    write(&link, &wrong);
    until(&link, |report| report.slot(SIZE, 0).index == errors + 1);
    for _ in 0..30 {
        until(&link, |report| {
            assert_eq!(report.slot(SIZE, 0).index, errors + 1, "the host's frame alone was wrong");
            true
        });
    }
}

/// The board of the wires checks CRCs from now on; the link to it, and how many wrong ones it has seen.
#[track_caller]
fn checking(held: &Held, open: impl Fn() -> Result<Arc<dyn Link>, LinkError>) -> (ecmsk::link::spi::SpiLink, u8) {
    let link = held.open(LINK).unwrap();
    write(&link, &board(&MasterCommand::SetEx { check_commands: true, fill_responses: true }));
    write(&link, &board(&MasterCommand::SoftReset));
    drop(link);
    held.with(|state| state.spi_board.reset());
    let link = come_back(held, open);
    let errors = until(&link, |_| true).slot(SIZE, 0).index;
    (link, errors)
}

/// The board of the wires boots and is opened again.
#[track_caller]
fn come_back(held: &Held, open: impl Fn() -> Result<Arc<dyn Link>, LinkError>) -> ecmsk::link::spi::SpiLink {
    held.with(|state| state.spi_board.close());
    let again = (0..3000).find_map(|_| {
        thread::sleep(Duration::from_millis(10));
        open().ok()
    });
    held.with(|state| state.spi_board.replace(again.expect("it starts up")));
    held.open(LINK).unwrap()
}

/// SK-4.33 After SW_RESET the board is lost, as on USB; it can be opened again when it has started up.
#[test]
fn sw_reset_takes_the_board_away() {
    let opened = || link::open("sim:?queue=1&slaves=drive&name=resets", Share::ByName);
    let held = Held::over(opened().unwrap());
    let link = held.open(LINK).unwrap();
    on(&link, 1);
    write(&link, &board(&MasterCommand::SoftReset));
    let mut report = Frame::new();
    let lost = loop {
        if let Err(error) = link.read(&mut report, PATIENCE) {
            break error;
        }
    };
    assert!(matches!(&lost, LinkError::Lost { reason, .. } if reason.contains("SW_RESET")), "{lost:?}");
    assert_eq!(link.write(&report, PATIENCE), Err(lost));
    drop(link);
    held.with(|state| state.spi_board.reset());
    assert!(held.open(LINK).err().unwrap().to_string().contains("BUSY has been high"));
    let link = come_back(&held, opened);
    until(&link, |report| state(report) == Some(MasterState::PreOp));
}

/// SW_RESET with another CRC than its own.
fn wrong_reset(crc: Option<u8>) -> Frame {
    let mut frame = board(&MasterCommand::SoftReset);
    frame.bytes_mut()[3] = crc.unwrap_or(!frame.bytes()[3]);
    frame
}

/// SK-1.24 A board that checks CRCs refuses a SW_RESET with a wrong one: it is not lost, and reports go on.
#[test]
fn a_sw_reset_that_the_board_refuses_ends_nothing() {
    for busy in [Busy::True, Busy::None] {
        let uri = format!("sim:?queue=1&slaves=drive&name=refuses-{}", u8::from(busy == Busy::None));
        let opened = || link::open(&uri, Share::ByName);
        let held = Held::over(opened().unwrap()).busy(busy);
        let (link, errors) = checking(&held, opened);
        for (number, crc) in [(1, None), (2, Some(0))] {
            write(&link, &wrong_reset(crc));
            until(&link, |report| report.slot(SIZE, 0).index == errors.wrapping_add(number));
            (0..30).for_each(|_| _ = until(&link, |_| true));
        }
        assert_eq!(link.check(), Ok(()));
        write(&link, &board(&MasterCommand::SoftReset));
        assert!(is_reset(&link), "by a right one it is");
        drop(link);
        held.with(|state| state.spi_board.close());
    }
}

/// A board that does not check CRCs is lost by any SW_RESET, with BUSY and without.
#[test]
fn a_sw_reset_without_a_right_crc_takes_the_board_away() {
    for busy in [Busy::True, Busy::None] {
        for crc in [None, Some(0)] {
            let held = Held::board("sim:?queue=1&slaves=drive").busy(busy);
            let link = held.open(LINK).unwrap();
            write(&link, &wrong_reset(crc));
            assert!(is_reset(&link), "{busy:?} {crc:?}");
        }
    }
}

/// Reads until the board is lost; whether by SW_RESET.
fn is_reset(link: &dyn Link) -> bool {
    let mut report = Frame::new();
    loop {
        match link.read(&mut report, PATIENCE) {
            Ok(_) => {}
            Err(LinkError::Lost { reason, .. }) => return reason.contains("SW_RESET"),
            Err(_) => return false,
        }
    }
}

/// Written frames are sent before the link is closed, however many there are; frames below a prefill that was never
/// reached are executed too.
#[test]
fn closing_sends_what_was_written() {
    for keys in ["", "?prefill=100"] {
        let sim = link::open("sim:?queue=1&slaves=drive", Share::ByName).unwrap();
        let held = Held::over(sim.clone());
        let link = held.open(&format!("{LINK}{keys}")).unwrap();
        on(&link, 1);
        (0..60).for_each(|n| write(&link, &target(1, n)));
        link.close();
        assert_eq!((link.spi_stats().unsent, link.spi_stats().held), (0, 0), "{keys}");
        let mut report = Frame::new();
        let executed = (0..5000).any(|_| {
            sim.read(&mut report, PATIENCE).unwrap();
            drive(&report, 1).position.abs_diff(590) <= 3
        });
        assert!(executed, "{keys}: {:?}", drive(&report, 1));
        assert_eq!(link.write(&report, Wait::Forever), Err(LinkError::Closed));
        assert_eq!(link.read(&mut report, Wait::Forever), Err(LinkError::Closed));
        link.close();
    }
}

/// Blocks the wires until it is dropped.
struct Hold(Arc<AtomicBool>);

impl Drop for Hold {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Waits end at once by closing and by cancelling, and by their limit; the frame of a read is left unchanged.
#[test]
fn waits_end_by_closing_cancelling_and_their_limit() {
    let sim = link::open("sim:?queue=1&slaves=drive", Share::ByName).unwrap();
    let held = Held::over(sim);
    let link = Arc::new(held.open(LINK).unwrap());
    // From here on no exchange ends: the wires are blocked.
    let hold = Hold(Arc::new(AtomicBool::new(true)));
    let (holds, is_held) = (hold.0.clone(), Arc::new(AtomicBool::new(false)));
    let held_now = is_held.clone();
    let _ = held.clone().tamper(move |_, _| {
        held_now.store(true, Ordering::Relaxed);
        while holds.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(1));
        }
    });
    while !is_held.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(1));
    }
    let frame = board(&MasterCommand::GetStatus);
    while link.write(&frame, Wait::Now).is_ok() {}
    let full = link.write(&frame, Wait::For(Duration::from_millis(5))).unwrap_err();
    assert!(matches!(full, LinkError::Timeout { dir: Dir::Write, .. }), "{full:?}");
    let mut report = Frame::from_bytes([0xA5; 512]);
    while link.read(&mut report, Wait::Now).is_ok() {}
    let before = report.clone();
    let none = link.read(&mut report, Wait::For(Duration::from_millis(5))).unwrap_err();
    assert!(matches!(none, LinkError::Timeout { dir: Dir::Read, .. }), "{none:?}");
    assert_eq!(report, before);

    for dir in [Dir::Read, Dir::Write] {
        let waiting = Arc::new(AtomicBool::new(true));
        let waiter = thread::spawn({
            let (link, waiting) = (link.clone(), waiting.clone());
            move || {
                let mut report = Frame::new();
                let ended = match dir {
                    Dir::Read => link.read(&mut report, Wait::Forever).map(|_| ()),
                    Dir::Write => link.write(&report, Wait::Forever).map(|_| ()),
                };
                waiting.store(false, Ordering::Relaxed);
                ended
            }
        });
        // It may not be waiting yet.
        while waiting.load(Ordering::Relaxed) {
            link.cancel(dir);
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(waiter.join().unwrap(), Err(LinkError::Cancelled { dir }));
    }

    let reader = thread::spawn({
        let link = link.clone();
        move || link.read(&mut Frame::new(), Wait::Forever).map(|_| ())
    });
    let closer = thread::spawn({
        let link = link.clone();
        move || link.close()
    });
    assert_eq!(reader.join().unwrap(), Err(LinkError::Closed), "though the wires are held");
    drop(hold);
    closer.join().unwrap();
}

/// The newest `queue=` reports are kept, the others counted; each has a number and a time.
#[test]
fn the_newest_reports_are_kept() {
    let held = Held::board("sim:?queue=1&slaves=drive");
    let link = held.open("spi:/dev/spidev0.0?queue=4").unwrap();
    let mut report = Frame::new();
    while link.stats().reports_dropped < 20 {
        thread::sleep(Duration::from_millis(1));
    }
    let mut last = None;
    let mut numbers = Vec::new();
    for _ in 0..12 {
        let meta = link.read(&mut report, PATIENCE).unwrap();
        assert_eq!(meta.sequence - numbers.len() as u64, meta.dropped, "what is missing was dropped");
        assert!(last.is_none_or(|last| meta.at > last));
        last = Some(meta.at);
        numbers.push(meta.sequence);
    }
    assert!(numbers[0] >= 20, "{numbers:?}");
    assert_eq!(link.stats().read, 12);
}

/// SET_FIFO clear and leaving OP take effect at once, before the frames that the link still holds: these are dropped
/// with those in the board, and counted.
#[test]
fn a_clear_overtakes_what_is_held() {
    let sim = link::open("sim:?queue=1&slaves=drive", Share::ByName).unwrap();
    let held = Held::over(sim.clone());
    let link = held.open(LINK).unwrap();
    on(&link, 1);
    for last in [board(&MasterCommand::SetFifo(FifoAction::Clear)), to(MasterState::PreOp)] {
        let before = link.spi_stats().cleared;
        (0..100).for_each(|n| write(&link, &target(1, n)));
        write(&link, &last);
        assert!(link.spi_stats().cleared > before + 50, "{:?}", link.spi_stats());
    }
    until(&link, |report| state(report) == Some(MasterState::PreOp));
}

/// SK-10.6, SK-10.7 A cycle too short for the wires is refused before its frame is sent.
#[test]
fn a_cycle_that_the_wires_are_too_slow_for_is_refused() {
    let held = Held::board("sim:?queue=1&slaves=drive").busy(Busy::None);
    let link = held.open(LINK).unwrap();
    for us in [250, 500] {
        let said = link.write(&cycle(us), PATIENCE).unwrap_err().to_string();
        assert!(said.contains("without BUSY") && said.contains("busy="), "{said}");
    }
    link.write(&cycle(1000), PATIENCE).unwrap();
    drop(link);
    let held = held.busy(Busy::True);
    let link = held.open("spi:/dev/spidev0.0?speed=6M&busy=gpiochip0/25").unwrap();
    let said = link.write(&cycle(500), PATIENCE).unwrap_err().to_string();
    assert!(said.contains("12000000 Hz at least") && said.contains("speed="), "{said}");
    link.write(&cycle(1000), PATIENCE).unwrap();
    assert_eq!(link.stats().write_errors, 1);
    drop(link);
    let link = held.open("spi:/dev/spidev0.0?speed=5M&busy=gpiochip0/25").unwrap();
    let said = link.write(&to(MasterState::Op), PATIENCE).unwrap_err().to_string();
    assert!(said.contains("6000000 Hz at least"), "{said}");
    link.write(&to(MasterState::SafeOp), PATIENCE).unwrap();
}

/// SK-10.9 With a line for RESETN the board is reset when the link is opened: low for more than 32 us.
#[test]
fn the_board_is_reset_when_it_is_opened() {
    let held = Held::board("sim:?queue=1&slaves=drive");
    let link = held.open(LINK).unwrap();
    assert!(held.with(|state| state.resets.clone()).iter().all(|low| *low > Duration::from_micros(32)));
    assert_eq!(held.with(|state| state.resets.len()), 1);
    drop(link);
}

/// SK-10.13 The other slot size: exchanges of 512 bytes.
#[test]
fn slots_of_16_bytes_are_exchanged_in_512_bytes() {
    let held = Held::board("sim:?queue=1&slaves=drive&slot=16");
    let link = held.open("spi:/dev/spidev0.0?slot=16").unwrap();
    let mut report = Frame::new();
    link.read(&mut report, PATIENCE).unwrap();
    assert_eq!(link.info().slot, Some(SlotSize::Bytes16));
    assert_eq!(report.check_crc(SlotSize::Bytes16, CrcPolicy::Strict), Ok(()));
}

/// Reader and writer are two threads, and neither waits for the other; neither allocates.
#[test]
fn reader_and_writer_do_not_wait_for_each_other_nor_allocate() {
    let held = Held::board("sim:?queue=1&slaves=drive");
    let link = Arc::new(held.open(LINK).unwrap());
    on(&*link, 1);
    let writer = thread::spawn({
        let link = link.clone();
        move || {
            let frames: Vec<Frame> = (0..200).map(|n| target(1, n)).collect();
            let used = allocation_counter::measure(|| frames.iter().for_each(|frame| write(&*link, frame)));
            used.count_total
        }
    });
    let mut report = Frame::new();
    let read = allocation_counter::measure(|| {
        while drive(&report, 1).position.abs_diff(1990) > 3 {
            link.read(&mut report, PATIENCE).unwrap();
        }
    });
    assert_eq!((writer.join().unwrap(), read.count_total), (0, 0));
}
