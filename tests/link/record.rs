//! The wrapper that records a link: the file's content, its times, and the cost.

use std::io;
use std::sync::Arc;
use std::sync::mpsc;
use std::thread;
use std::time::{SystemTime, UNIX_EPOCH};

use ecmsk::link::options::Clock;
use ecmsk::link::record::{QUEUE, RecordLink};
use ecmsk::link::{Dir, Link, LinkError, Stamp, Wait};
use ecmsk::recording::{RecordMeta, Recording};
use ecmsk::sk::{Frame, SlotSize};
use support::recording::{
    Echo, Memory, URI, blocks, frame, frames, meta, options, read_file, record_to, recording_of, u16_at, u32_at, u64_at,
};

/// Pcapng: section header, interface, one enhanced packet per frame, interface statistics.
#[test]
fn the_file_is_pcapng_of_usbmon_in_nanoseconds() {
    let memory = Memory::default();
    let meta = meta(Clock::Real, 1_700_000_000_000_000_001);
    let link = RecordLink::to_sink(Arc::new(Echo::new(false)), "m", Box::new(memory.clone()), &meta, 8).unwrap();
    let mut out = Frame::new();
    link.write(&frame(7), Wait::Now).unwrap();
    link.read(&mut out, Wait::Now).unwrap();
    link.close();

    let bytes = memory.bytes();
    let blocks = blocks(&bytes);
    assert_eq!(blocks.iter().map(|block| block.0).collect::<Vec<_>>(), [0x0A0D_0D0A, 1, 6, 6, 5]);

    let section = &blocks[0].1;
    assert_eq!(u32_at(section, 0), 0x1A2B_3C4D);
    assert_eq!((u16_at(section, 4), u16_at(section, 6), u64_at(section, 8)), (1, 0, u64::MAX));
    let comment = String::from_utf8(options(&section[16..])[&1].clone()).unwrap();
    assert_eq!(comment, format!("ecmsk slot=12 clock=real base_ns=1700000000000000001 link={URI}"));

    let interface = &blocks[1].1;
    assert_eq!(u16_at(interface, 0), 220, "LINKTYPE_USB_LINUX_MMAPPED");
    assert_eq!(u32_at(interface, 4), 0, "no limit to what is captured");
    assert_eq!(options(&interface[8..])[&9], [9], "if_tsresol: 10^-9 s");

    // The fields of usbmon, in their order: id, event, transfer, endpoint, device, bus, flag_setup, flag_data, seconds,
    // microseconds, status, length, captured, setup, interval, start_frame, transfer flags, descriptors.
    let header = |id: u64, event: u8, endpoint: u8, microseconds: u32, status: i32| {
        let mut header = Vec::new();
        header.extend(id.to_le_bytes());
        header.extend([event, 1, endpoint, 1, 1, 0, b'-', 0]);
        header.extend(1_700_000_001_u64.to_le_bytes());
        header.extend(microseconds.to_le_bytes());
        header.extend(status.to_le_bytes());
        header.extend(512_u32.to_le_bytes());
        header.extend(512_u32.to_le_bytes());
        header.extend([0; 8]);
        header.extend(1_u32.to_le_bytes());
        header.extend([0; 12]);
        header
    };
    let expected = [
        (1_700_000_001_000_125_001_u64, header(0, b'S', 0x02, 125, -115)),
        (1_700_000_001_000_250_001, header(1, b'C', 0x81, 250, 0)),
    ];
    for ((_, packet), (at_ns, header)) in blocks[2..4].iter().zip(&expected) {
        assert_eq!(u32_at(packet, 0), 0, "interface");
        assert_eq!((u64::from(u32_at(packet, 4)) << 32) + u64::from(u32_at(packet, 8)), *at_ns, "upper half first");
        assert_eq!((u32_at(packet, 12), u32_at(packet, 16)), (576, 576));
        assert_eq!(header.len(), 64);
        assert_eq!(packet[20..84], *header);
        assert_eq!(packet[84..], *frame(7).bytes());
    }

    let statistics = &blocks[4].1;
    assert_eq!((u64::from(u32_at(statistics, 4)) << 32) + u64::from(u32_at(statistics, 8)), expected[1].0);
    let counts = options(&statistics[12..]);
    assert_eq!((u64_at(&counts[&4], 0), u64_at(&counts[&5], 0)), (2, 0), "frames there were, frames missing");
}

/// A recording is read back: frames, directions, times, the link.
#[test]
fn a_recording_is_read_back() {
    let bytes = recording_of(300);
    let mut recording = Recording::new(&bytes[..], "bytes").unwrap();
    assert_eq!(recording.meta(), Some(&meta(Clock::Virtual, 0)));
    for (number, recorded) in recording.by_ref().enumerate() {
        let recorded = recorded.unwrap();
        let number = number as u64;
        assert_eq!(*recorded.frame, frame(number / 2));
        assert_eq!(recorded.dir, if number.is_multiple_of(2) { Dir::Write } else { Dir::Read });
        assert_eq!(recorded.at_ns, 1_000_000_000 + 125_000 * (number + 1));
    }
    assert_eq!(recording.missing(), 0);
    assert_eq!(frames(&bytes).len(), 600);
}

#[test]
fn the_metadata_of_a_recording_is_read_back() {
    for slot in [None, Some(SlotSize::Bytes12), Some(SlotSize::Bytes16)] {
        for (clock, base_ns) in [(Clock::Virtual, 0), (Clock::Real, u64::MAX)] {
            for link in ["usb:", URI, "spi:/dev/a b?x= link=y ecmsk", ""] {
                let meta = RecordMeta { slot, clock, base_ns, opened_ns: None, link: link.to_owned(), machine: None };
                let memory = Memory::default();
                let echo = Arc::new(Echo::new(true));
                drop(RecordLink::to_sink(echo, "memory", Box::new(memory.clone()), &meta, 1).unwrap());
                let bytes = memory.bytes();
                assert_eq!(Recording::new(&bytes[..], "bytes").unwrap().meta(), Some(&meta));
            }
        }
    }
}

/// Virtual time begins at 0; real time begins at the calendar's time of the opening.
#[test]
fn recorded_times_are_calendar_times_on_the_real_clock() {
    let info = |virtual_time| Echo::new(virtual_time).info();
    let stepped = RecordMeta::now(&info(true), Stamp(77));
    assert_eq!((stepped.clock, stepped.base_ns, stepped.slot), (Clock::Virtual, 0, Some(SlotSize::Bytes12)));
    assert_eq!(stepped.link, URI);

    let unix_ns = || SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64;
    let before = unix_ns();
    let real = RecordMeta::now(&info(false), Stamp(5_000_000_000));
    let after = unix_ns();
    assert_eq!(real.clock, Clock::Real);
    assert!((before..=after).contains(&(real.base_ns + 5_000_000_000)));
}

#[test]
fn a_call_that_fails_is_not_recorded() {
    let memory = Memory::default();
    let meta = meta(Clock::Real, 0);
    let link = RecordLink::to_sink(Arc::new(Echo::new(false)), "m", Box::new(memory.clone()), &meta, 8).unwrap();
    assert!(link.read(&mut Frame::new(), Wait::Now).is_err());
    link.close();
    assert_eq!(link.write(&frame(1), Wait::Now), Err(LinkError::Closed));
    assert_eq!(frames(&memory.bytes()), []);
    assert_eq!(link.stats().record_dropped, 2, "the two of the link inside");
}

#[test]
fn a_recording_link_passes_every_other_call_on() {
    let echo = Arc::new(Echo::new(true));
    let link =
        RecordLink::to_sink(Arc::clone(&echo) as _, "m", Box::new(io::sink()), &meta(Clock::Virtual, 0), 8).unwrap();
    assert_eq!(link.info(), echo.info());
    link.cancel(Dir::Read);
    link.cancel(Dir::Write);
    assert_eq!(echo.cancelled(), [Dir::Read, Dir::Write]);
    assert_eq!(link.write(&frame(1), Wait::Now), Ok(Stamp(1_000_125_000)));
    let mut out = Frame::new();
    let read = link.read(&mut out, Wait::Now).unwrap();
    assert_eq!((read.at, read.sequence, out), (Stamp(1_000_250_000), 0, frame(1)));
    assert_eq!(link.stats(), echo.stats());
    link.close();
    assert_eq!(echo.write(&frame(1), Wait::Now), Err(LinkError::Closed));
}

/// LIB-47 closing twice is harmless, and dropping the link does as well as closing it
#[test]
fn the_file_is_complete_after_close_and_after_drop() {
    let dir = tempfile::tempdir().unwrap();
    for (name, close) in [("closed", true), ("dropped", false), ("closed.ecmrec", true), ("dropped.ecmrec", false)] {
        let path = dir.path().join(name);
        let link = record_to(&path, Clock::Real);
        for number in 0..250 {
            link.write(&frame(number), Wait::Now).unwrap();
        }
        if close {
            link.close();
            assert_eq!(read_file(&path).len(), 250);
            link.close();
        }
        drop(link);
        let recorded = read_file(&path);
        assert!(recorded.iter().map(|recorded| &*recorded.frame).eq((0..250).map(frame).collect::<Vec<_>>().iter()));
    }
}

/// LIB-26 LIB-48 reader, writer and closer are three threads; no frame of a call that succeeded is lost
#[test]
fn closing_under_traffic_loses_nothing() {
    for _ in 0..20 {
        let memory = Memory::default();
        let (sender, waiting) = mpsc::channel();
        let mut echo = Echo::new(false);
        echo.waiting = Some(sender);
        let sink = Box::new(memory.clone());
        let link = RecordLink::to_sink(Arc::new(echo), "memory", sink, &meta(Clock::Real, 0), QUEUE).unwrap();
        let (written, read) = thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let mut out = Frame::new();
                (0..).take_while(|_| link.read(&mut out, Wait::Forever).is_ok()).count()
            });
            waiting.recv().unwrap();
            let writer = scope.spawn(|| (0..2000).take_while(|n| link.write(&frame(*n), Wait::Now).is_ok()).count());
            while link.stats().written < 500 {
                thread::yield_now();
            }
            link.close();
            (writer.join().unwrap(), reader.join().unwrap())
        });
        assert!(written >= 500);
        let recorded = frames(&memory.bytes());
        let in_dir = |dir| recorded.iter().filter(|recorded| recorded.dir == dir).count();
        assert_eq!((in_dir(Dir::Write), in_dir(Dir::Read)), (written, read));
        assert_eq!(link.stats().record_dropped, 2, "none but the two of the link inside");
    }
}

#[test]
fn a_recorded_call_allocates_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let endings = ["pcapng", "ecmrec"].iter();
    for (clock, ending) in endings.flat_map(|ending| [(Clock::Real, ending), (Clock::Virtual, ending)]) {
        let link = record_to(&dir.path().join(format!("{clock:?}.{ending}")), clock);
        let sent = frame(1);
        let mut out = Frame::new();
        let mut exchange = || {
            link.write(&sent, Wait::Now).unwrap();
            link.read(&mut out, Wait::Now).unwrap();
        };
        // On the real clock everything fits the queue, so that no call finds it full. In virtual time calls wait for
        // the writer, and the first wait allocates.
        let (warm_up, pairs) = match clock {
            Clock::Real => (1, QUEUE / 2 - 1),
            Clock::Virtual => (QUEUE, QUEUE),
        };
        (0..warm_up).for_each(|_| exchange());
        let allocations = allocation_counter::measure(|| (0..pairs).for_each(|_| exchange()));
        assert_eq!(allocations.count_total, 0, "{clock:?} {ending}");
        assert_eq!(link.stats().record_dropped, 2, "none but the two of the link inside");
    }
}
