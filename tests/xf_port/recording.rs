//! Recordings of a chip.

use std::fs::{self, File};
use std::path::Path;

use ecmsk::link::Dir;
use ecmsk::link::chip;
use ecmsk::link::uri::LinkUri;
use ecmsk::recording::exchanges::{Exchanges, RecordedBytes, is_of_chip};
use ecmsk::recording::{RecordError, Recording};
use ecmsk::xf::host::Wires;
use ecmsk::xf_api::Xf;

/// A link to a chip in virtual time that records to a file, with more keys.
fn uri(file: &Path, more: &str) -> String {
    format!("xf-sim:?slaves=drive&clock=virtual&chip_fw=old{more}&record={}", file.display())
}

fn read(file: &Path) -> (Vec<RecordedBytes>, bool) {
    let mut exchanges = Exchanges::new(File::open(file).expect("a file"), "run").expect("a recording");
    let found: Vec<_> = exchanges.by_ref().map(|bytes| bytes.expect("it is whole")).collect();
    (found, exchanges.lacks().is_nothing())
}

/// XF-15.1, XF-15.2 Every exchange is in the file: its bytes in both directions, with the times of its begin and end.
#[test]
fn every_exchange_is_recorded() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let (mut link, _) = chip::open(&uri(&file, "")).expect("a chip");
    let mut expected = Vec::new();
    for len in [144, 1, 1440, 7] {
        let to_chip: Vec<u8> = (0..len).map(|n| n as u8).collect();
        let mut from_chip = vec![0; len];
        let begin = link.now();
        link.exchange(&to_chip, &mut from_chip).expect("it passes");
        expected.push(RecordedBytes { at_ns: begin, dir: Dir::Write, bytes: to_chip });
        expected.push(RecordedBytes { at_ns: link.now(), dir: Dir::Read, bytes: from_chip });
    }
    assert!(expected[1].at_ns > expected[0].at_ns);
    drop(link);
    assert_eq!(read(&file), (expected, true));
}

/// XF-15.2 An exchange longer than a packet of a chip is recorded in parts, in order.
#[test]
fn a_long_exchange() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let (mut link, _) = chip::open(&uri(&file, "")).expect("a chip");
    let to_chip: Vec<u8> = (0..4000_u32).map(|n| (n / 7) as u8).collect();
    let mut from_chip = vec![0; 4000];
    link.exchange(&to_chip, &mut from_chip).expect("it passes");
    drop(link);
    let (found, _) = read(&file);
    let all = |dir| found.iter().filter(|part| part.dir == dir).flat_map(|part| part.bytes.clone()).collect::<Vec<_>>();
    assert_eq!((all(Dir::Write), all(Dir::Read)), (to_chip, from_chip));
}

/// XF-15.1 The bytes of the file: link type 162, and a byte 0 or 1 in front of those to and from the chip.
#[test]
fn the_bytes_of_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let (mut link, _) = chip::open(&uri(&file, "")).expect("a chip");
    link.exchange(&[0xA1, 0xB2, 0xC3], &mut [0; 3]).expect("it passes");
    drop(link);
    let bytes = fs::read(&file).expect("a file");
    let block = |at: usize| -> usize { u32::from_le_bytes(bytes[at + 4..at + 8].try_into().expect("4")) as usize };
    let interface = block(0);
    assert_eq!(bytes[interface..interface + 4], 1_u32.to_le_bytes(), "an interface description");
    assert_eq!(bytes[interface + 8..interface + 10], 162_u16.to_le_bytes());
    let packet = interface + block(interface);
    assert_eq!(bytes[packet..packet + 4], 6_u32.to_le_bytes(), "an enhanced packet");
    assert_eq!(bytes[packet + 20..packet + 32], [4, 0, 0, 0, 4, 0, 0, 0, 0, 0xA1, 0xB2, 0xC3]);
    let answer = packet + block(packet);
    assert_eq!(bytes[answer + 28], 1);
}

/// XF-15.3 A chip that is opened again continues the file of its process, and one of an earlier process is kept; a file that
/// is no recording is not touched.
#[test]
fn files() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    for _ in 0..2 {
        let (mut link, _) = chip::open(&uri(&file, "")).expect("a chip");
        link.exchange(&[0; 144], &mut [0; 144]).expect("it passes");
    }
    let (found, whole) = read(&file);
    assert_eq!((found.len(), whole), (4, true));
    assert!(found.is_sorted_by_key(|bytes| bytes.at_ns));
    let text = folder.path().join("text");
    fs::write(&text, "mine").expect("a file");
    let error = chip::open(&uri(&text, "")).err().expect("it is refused").to_string();
    assert!(error.contains("no recording of ecmsk") && error.contains("record="), "{error}");
    assert_eq!(fs::read_to_string(&text).expect("the file"), "mine");
}

/// XF-15.4 A recording that was not ended is recognised, and is read up to its end; a damaged one is an error.
#[test]
fn a_recording_that_was_not_ended() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let (mut link, _) = chip::open(&uri(&file, "")).expect("a chip");
    link.exchange(&[0; 144], &mut [0; 144]).expect("it passes");
    drop(link);
    let bytes = fs::read(&file).expect("a file");
    let end = u32::from_le_bytes(bytes[bytes.len() - 4..].try_into().expect("4")) as usize;
    let unended = &bytes[..bytes.len() - end];
    let mut exchanges = Exchanges::new(unended, "run").expect("a recording");
    assert_eq!(exchanges.by_ref().filter(Result::is_ok).count(), 2);
    assert_eq!(exchanges.lacks().not_ended, 1);
    let mut cut = Exchanges::new(&unended[..unended.len() - 10], "run").expect("a recording");
    assert_eq!(cut.by_ref().filter(Result::is_ok).count(), 1);
    assert!(matches!(
        Exchanges::new(&unended[..unended.len() - 10], "run").expect("a recording").last(),
        Some(Err(RecordError::Truncated { .. }))
    ));
}

/// XF-15.5 Reading such a file as a board's recording is an error that says what it is.
#[test]
fn no_recording_of_a_board() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    drop(Xf::open(&uri(&file, "")).expect("it starts"));
    assert!(is_of_chip(&fs::read(&file).expect("a file")));
    let last = Recording::open(&file).expect("a file").last().expect("an error");
    let error = last.expect_err("it is none").to_string();
    assert!(error.contains("the recording of a chip ECM-XF") && error.contains("`ecmsk dump`"), "{error}");
    let board = folder.path().join("board.pcapng");
    let link = format!("sim:?clock=virtual&record={}", board.display());
    drop(ecmsk::link::open(&link, ecmsk::link::Share::ByUri).expect("a board"));
    assert!(!is_of_chip(&fs::read(&board).expect("a file")));
}

/// XF-15.6 In OP an exchange that is recorded allocates nothing in the thread of the program.
#[test]
fn a_recorded_exchange_allocates_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    LinkUri::parse(&uri(&file, "")).expect("a link");
    let (mut link, _) =
        chip::open(&format!("xf-sim:?slaves=drive&speed=96M&record={}", file.display())).expect("a chip");
    let (to_chip, mut from_chip) = ([0; 1056], [0; 1056]);
    link.exchange(&to_chip, &mut from_chip).expect("it passes");
    let counted = allocation_counter::measure(|| {
        for _ in 0..100 {
            link.exchange(&to_chip, &mut from_chip).expect("it passes");
        }
    });
    assert_eq!(counted.count_total, 0);
}
