//! Captures as frames: of every system and in every container, with other traffic on the bus.

use std::path::PathBuf;

use ecmsk::link::Dir;
use ecmsk::recording::{Address, RecordError, Recorded, Recording, Skipped, board_in};
use ecmsk::sk::BOARD_IDS;
use tempfile::TempDir;

use support::captures::convert::{Event, Parts, USB_LINUX, USB_LINUX_MMAPPED, USBPCAP, pcap, pcapng};
use support::captures::traffic::{TAKEN_BACK, Traffic, numbered};

/// Nothing is cut.
const WHOLE: usize = 65_535;

fn read(file: &[u8]) -> Vec<Recorded> {
    Recording::new(file, "x.pcap").expect("a capture").collect::<Result<_, _>>().expect("it is whole")
}

fn error(file: &[u8]) -> RecordError {
    let recording = Recording::new(file, "x.pcap").expect("a capture");
    recording.filter_map(Result::err).next().expect("an error")
}

fn brief(recorded: &[Recorded]) -> Vec<(Dir, u8)> {
    recorded.iter().map(|recorded| (recorded.dir, recorded.frame.bytes()[16])).collect()
}

fn skipped(file: &[u8]) -> Skipped {
    let mut recording = Recording::new(file, "x.pcap").expect("a capture");
    assert!(recording.by_ref().all(|frame| frame.is_ok()));
    recording.skipped()
}

/// The same traffic in every kind of file.
fn files(events: &[Event]) -> Vec<Vec<u8>> {
    let pcap = |link_type, parts| pcap(events, link_type, parts, WHOLE);
    vec![
        pcap(USB_LINUX, Parts::Two),
        pcap(USB_LINUX_MMAPPED, Parts::Two),
        pcap(USBPCAP, Parts::Two),
        pcap(USBPCAP, Parts::Three),
        pcapng(events, USB_LINUX),
        pcapng(events, USB_LINUX_MMAPPED),
        pcapng(events, USBPCAP),
    ]
}

fn frame(n: u8) -> [u8; 512] {
    *numbered(n).bytes()
}

/// A frame to the board counts when the host submits it, a report when it has arrived, for every capturing system and
/// any order in which pending transfers end.
#[test]
fn frames_are_read_from_every_kind_of_file() {
    let mut traffic = Traffic::default();
    traffic.descriptor(7, BOARD_IDS).write(7, &frame(1)).read(7, &frame(2));
    let (first, second) = (traffic.submitted(7, &frame(3)), traffic.submitted(7, &frame(4)));
    traffic.read(7, &frame(5)).completed(7, second, 0, 512).completed(7, first, 0, 512);
    traffic.write(7, &frame(6)[..504]).set_report(7, &[&[0], &frame(7)[..]].concat()).set_report(7, &frame(8));
    let expected = [(0, 1), (1, 2), (0, 3), (0, 4), (1, 5), (0, 6), (0, 7), (0, 8)]
        .map(|(dir, n)| (if dir == 0 { Dir::Write } else { Dir::Read }, n));
    for file in files(&traffic.events) {
        let recorded = read(&file);
        assert_eq!(brief(&recorded), expected);
        assert!(recorded.iter().all(|recorded| recorded.address() == Address { bus: 3, device: 7 }));
        // Third event: the first frame's submission; the fifth ends the first read.
        let times: Vec<u64> = recorded[..2].iter().map(|recorded| recorded.at_ns - 1_600_000_000_000_000_000).collect();
        assert_eq!(times, [2 * 125_000, 5 * 125_000]);
        assert_eq!(skipped(&file), Skipped { other_transfers: skipped(&file).other_transfers, ..Skipped::default() });
    }
}

/// A frame that the host cancelled did not reach the board, unless it was transferred all the same. Frames whose end
/// the capture lacks did reach it.
#[test]
fn frames_taken_back_are_none() {
    let mut traffic = Traffic::default();
    traffic.write(7, &frame(1));
    let back = traffic.submitted(7, &frame(2));
    traffic.read(7, &frame(3)).completed(7, back, TAKEN_BACK, 0);
    let without_end = traffic.submitted(7, &frame(4));
    let refused = traffic.submitted(7, &frame(5));
    traffic.completed(7, refused, -19, 0).events.last_mut().expect("an event").what = b'E';
    // The next transfer has the number of one whose end was lost.
    let again = traffic.submitted(7, &frame(6));
    for event in traffic.events.iter_mut().filter(|event| event.id == again) {
        event.id = without_end;
    }
    traffic.completed(7, without_end, 0, 512).read(7, &frame(7));
    traffic.submitted(7, &frame(8));
    for (i, file) in files(&traffic.events).into_iter().enumerate() {
        let numbers: Vec<u8> = brief(&read(&file)).iter().map(|(_, n)| *n).collect();
        assert_eq!(numbers, [1, 3, 4, 6, 7, 8], "file {i}");
        assert_eq!(skipped(&file).taken_back, 2, "file {i}");
    }
    // Only usbmon reports that bytes were transferred.
    let mut traffic = Traffic::default();
    let moved = traffic.submitted(7, &frame(1));
    traffic.completed(7, moved, TAKEN_BACK, 512);
    for link_type in [USB_LINUX, USB_LINUX_MMAPPED] {
        assert_eq!(brief(&read(&pcap(&traffic.events, link_type, Parts::Two, WHOLE))), [(Dir::Write, 1)]);
    }
}

/// Other traffic on a bus is left out and counted: other kinds of transfers, other lengths, reads without a report,
/// devices with other descriptors.
#[test]
fn other_traffic_is_left_out() {
    let mut traffic = Traffic::default();
    traffic.descriptor(4, (0x046D, 0xC52B)).write(4, &frame(100)).read(4, &frame(101)).read(4, &[0; 8]);
    traffic.read(5, &[1, 0, 0, 0]).bulk(6, &frame(102)).bulk(6, &[0; 31]);
    traffic.write(7, &frame(1)).write(7, &[0; 64]).read(7, &[0; 511]).read_ended(7, TAKEN_BACK, None);
    traffic.set_report(7, &[0; 8]).set_report(7, &[&[9], &frame(103)[..]].concat()).bulk(7, &frame(104));
    traffic.read(7, &frame(2)).read_ended(7, 0, Some(Vec::new()));
    for file in files(&traffic.events) {
        assert_eq!(brief(&read(&file)), [(Dir::Write, 1), (Dir::Read, 2)]);
        let skipped = skipped(&file);
        assert_eq!((skipped.taken_back, skipped.without_report, skipped.other_lengths), (0, 2, 2));
        assert!(skipped.other_transfers > 0 && skipped.other_devices >= 6, "{skipped:?}");
        let words = skipped.words().expect("something was left out");
        assert_eq!(words, "2 transfers as long as no frame");
    }
}

struct Kept {
    _folder: TempDir,
    file: PathBuf,
}

fn kept(events: &[Event]) -> Kept {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("x.pcapng");
    std::fs::write(&file, pcapng(events, USB_LINUX_MMAPPED)).expect("a file");
    Kept { _folder: folder, file }
}

fn found(traffic: &Traffic) -> Result<Option<u8>, RecordError> {
    board_in(&kept(&traffic.events).file).map(|address| address.map(|address| address.device))
}

/// The board is the device with its ids and frames in both directions; without descriptors, the one with frames in both
/// directions; else the one with any frames.
#[test]
fn the_board_is_found() {
    let mut traffic = Traffic::default();
    traffic.read(4, &frame(1));
    assert_eq!(found(&traffic), Ok(Some(4)), "reports alone");
    traffic.write(5, &frame(1)).read(5, &frame(2));
    assert_eq!(found(&traffic), Ok(Some(5)), "both ways");
    traffic.descriptor(6, BOARD_IDS).write(6, &frame(1)).read(6, &frame(2));
    assert_eq!(found(&traffic), Ok(Some(6)), "and the ids");
    traffic.descriptor(7, (1, 2)).write(7, &frame(1)).read(7, &frame(2));
    assert_eq!(found(&traffic), Ok(Some(6)), "another device");
}

/// Several devices that may be the board are listed, and one of them can be chosen, whatever its descriptor says.
#[test]
fn several_boards_are_listed() {
    let mut traffic = Traffic::default();
    traffic.write(5, &frame(1)).read(5, &frame(2)).write(9, &frame(3)).write(9, &frame(4)).read(9, &frame(5));
    let error = found(&traffic).expect_err("two");
    assert!(matches!(&error, RecordError::SeveralBoards { example: Address { bus: 3, device: 5 }, .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("3.5 (1 frames to it, 1 from it), 3.9 (2 frames to it, 1 from it)"), "{text}");
    assert!(text.ends_with("choose one with --device 3.5"), "{text}");

    traffic.descriptor(4, (1, 2)).read(4, &frame(6));
    let file = pcapng(&traffic.events, USBPCAP);
    for (device, expected) in [(9, vec![(Dir::Write, 3), (Dir::Write, 4), (Dir::Read, 5)]), (4, vec![(Dir::Read, 6)])] {
        let recording = Recording::new(&file[..], "x").expect("a capture").only(Address { bus: 3, device });
        assert_eq!(brief(&recording.map(Result::unwrap).collect::<Vec<_>>()), expected);
    }
    let recording = Recording::new(&file[..], "x.pcap").expect("a capture").only(Address { bus: 3, device: 1 });
    let error = recording.filter_map(Result::err).next().expect("an error");
    assert!(matches!(error, RecordError::NoSuchDevice { .. }) && error.to_string().contains("--device"), "{error}");
}

/// A capture without a board is an error that names its content.
#[test]
fn no_board_is_an_error() {
    let mut traffic = Traffic::default();
    traffic.descriptor(4, (0x046D, 0xC52B)).read(4, &[0; 8]).descriptor(7, BOARD_IDS);
    for file in files(&traffic.events) {
        let error = error(&file);
        let text = error.to_string();
        assert!(matches!(error, RecordError::NoBoard { .. }), "{text}");
        assert!(text.contains("3.4 (046d:c52b; 0 frames") && text.contains("3.7 (16c0:05df;"), "{text}");
        assert!(text.contains("while the program runs"), "{text}");
    }
    assert!(matches!(found(&traffic), Err(RecordError::NoBoard { .. })));
    assert!(matches!(error(&pcapng(&[], USBPCAP)), RecordError::NoBoard { .. }));
}

/// Truncated packets are reported, with the next step.
#[test]
fn cut_packets_are_an_error() {
    let mut traffic = Traffic::default();
    traffic.write(7, &frame(1));
    for (link_type, header) in [(USB_LINUX, 48), (USB_LINUX_MMAPPED, 64), (USBPCAP, 27)] {
        for snap in [header, header + 300, header + 511] {
            let error = error(&pcap(&traffic.events, link_type, Parts::Two, snap));
            let captured = snap - header;
            assert!(matches!(&error, RecordError::Cut { captured: c, length: 512, .. } if *c == captured), "{error}");
            assert!(error.to_string().contains("snap length 0"), "{error}");
        }
        assert_eq!(read(&pcap(&traffic.events, link_type, Parts::Two, header + 512)).len(), 1);
    }
}

/// For a pipe that was opened before the capture began USBPcap knows neither device nor endpoint: the position of the
/// bytes shows their direction.
#[test]
fn usbpcap_may_not_know_the_endpoint() {
    let mut traffic = Traffic::default();
    traffic.write(255, &frame(1)).read(255, &frame(2));
    for event in &mut traffic.events {
        (event.endpoint, event.transfer) = (0xFF, 3);
    }
    let file = pcap(&traffic.events, USBPCAP, Parts::Two, WHOLE);
    assert_eq!(brief(&read(&file)), [(Dir::Write, 1), (Dir::Read, 2)]);
}

/// A frame whose end never comes delays only a limited number of other frames, and at most to the end of the file.
#[test]
fn a_lost_end_does_not_hold_a_long_capture_back() {
    let mut traffic = Traffic::default();
    traffic.submitted(7, &frame(1));
    for _ in 0..5000 {
        traffic.read(7, &frame(2));
    }
    let file = pcap(&traffic.events, USB_LINUX, Parts::Two, WHOLE);
    let mut recording = Recording::new(&file[..], "x").expect("a capture");
    assert_eq!(*recording.next().expect("a frame").expect("whole").frame, numbered(1));
    assert!(recording.devices()[0].read < 5000, "it was not read to its end for that");
    assert_eq!(recording.count(), 5000);
}
