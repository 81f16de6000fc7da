//! Recordings that were not ended, or lack frames: the file records it, and the recorder reports it.

use std::sync::Arc;

use ecmsk::link::options::Clock;
use ecmsk::link::record::{RecordLink, make_room};
use ecmsk::link::{Link, Wait};
use ecmsk::recording::{Lacks, Recording, lacks_at_end};
use support::recording::{Echo, Memory, blocks, frame, meta, record_to, recording_of, u32_at};

/// What the recording lacks, according to the whole file.
fn lacks(bytes: &[u8]) -> Lacks {
    let mut recording = Recording::new(bytes, "bytes").unwrap();
    assert!(recording.by_ref().all(|frame| frame.is_ok()));
    recording.lacks()
}

/// The same according to its end only.
fn by_its_end(bytes: &[u8]) -> Lacks {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, bytes).unwrap();
    lacks_at_end(&path).unwrap()
}

/// The file up to block `n`.
fn up_to(bytes: &[u8], n: usize) -> &[u8] {
    let length = (0..n).fold(0, |at, _| at + u32_at(bytes, at + 4) as usize);
    &bytes[..length]
}

/// A recording without an end block was not ended, wherever it was cut; one with it was. For a file of several openings
/// the number of those that were not ended is known.
#[test]
fn a_recording_without_its_end_says_so() {
    let whole = recording_of(3);
    let all = blocks(&whole).len();
    assert_eq!(all, 2 + 6 + 1);
    assert_eq!((lacks(&whole), by_its_end(&whole)), (Lacks::default(), Lacks::default()));
    assert!(lacks(&whole).is_nothing());
    for n in 2..all {
        let cut = up_to(&whole, n);
        let found = lacks(cut);
        assert_eq!((found.not_ended, found.missing), (1, 0), "{n}");
        assert_eq!(by_its_end(cut).not_ended, 1, "{n}");
        assert!(found.to_string().contains("was not ended") && found.to_string().contains("let it end"), "{found}");
    }
    let twice = [up_to(&whole, 4), &whole].concat();
    assert_eq!(lacks(&twice).not_ended, 1);
    let thrice = [up_to(&whole, 4), &whole, up_to(&whole, 5)].concat();
    assert_eq!(lacks(&thrice).not_ended, 2);
    // Within a block, and before the first block.
    for length in [whole.len() - 1, whole.len() - 100, 10, 0] {
        assert_eq!(by_its_end(&whole[..length]).not_ended, 1, "{length}");
    }
}

/// Files of other programs are not judged: a recording rewritten by another program has another application in its
/// header, and so has a capture.
#[test]
fn recordings_of_other_programs_are_not_called_incomplete() {
    let whole = recording_of(3);
    let mut other = up_to(&whole, 5).to_vec();
    let at = other.windows(6).position(|bytes| bytes == b"ecmsk " && !bytes.starts_with(b"ecmsk s")).unwrap();
    let names: Vec<usize> = (0..other.len() - 6).filter(|at| other[*at..].starts_with(b"ecmsk 0")).collect();
    assert!(at > 0 && names.len() == 1, "the application's name");
    other[names[0]..names[0] + 5].copy_from_slice(b"Other");
    assert_eq!(lacks(&other), Lacks::default());
    let capture = std::fs::read("tests/recordings/usbmon_12.pcap").unwrap();
    assert_eq!(lacks(&capture), Lacks::default());
}

/// While it grows a recording is not ended; closed it is.
#[test]
fn a_recording_that_grows_is_not_ended() {
    let memory = Memory::default();
    let meta = meta(Clock::Virtual, 0);
    let link = RecordLink::to_sink(Arc::new(Echo::new(true)), "m", Box::new(memory.clone()), &meta, 4).unwrap();
    link.write(&frame(1), Wait::Now).unwrap();
    assert_eq!(lacks(&memory.bytes()).not_ended, 1);
    link.close();
    assert!(lacks(&memory.bytes()).is_nothing());
}

/// A real file with a full disk: the process' limit of file sizes. The recorder reports it on standard error when it
/// begins and at the end, and the file has the number of missing frames and the reason.
#[cfg(unix)]
#[test]
fn a_full_disk_is_told_at_once_and_at_the_end() {
    const PATH: &str = "ECMSK_TEST_FULL_DISK_TOLD";
    const FRAMES: u64 = 2000;

    if let Some(path) = std::env::var_os(PATH) {
        for _ in 0..2 {
            // The disk may be so full that a second recording cannot be begun.
            let board = Arc::new(Echo::new(true));
            let link = match RecordLink::new(board, std::path::Path::new(&path), &meta(Clock::Virtual, 0)) {
                Ok(link) => link,
                Err(error) => {
                    assert!(error.to_string().contains("File too large"), "{error}");
                    break;
                }
            };
            eprintln!("begun");
            for number in 0..FRAMES / 2 {
                link.write(&frame(number), Wait::Now).unwrap();
            }
            eprintln!("closing");
            link.close();
        }
        return;
    }
    for limit in ["512", "511", "513", "700", "900"] {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recording");
        let child = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f \"$1\"; exec \"$0\" --exact --nocapture \"$2\""])
            .arg(std::env::current_exe().unwrap())
            .args([limit, "record_end::a_full_disk_is_told_at_once_and_at_the_end"])
            .env(PATH, &path)
            .output()
            .unwrap();
        let said = String::from_utf8(child.stderr).unwrap();
        assert!(child.status.success(), "{said}");
        let bytes = std::fs::read(&path).unwrap();
        let mut recording = Recording::new(&bytes[..], "bytes").unwrap();
        let there = recording.by_ref().map(Result::unwrap).count() as u64;
        let found = recording.lacks();
        let stopped = said.lines().filter(|line| line.contains("has stopped: File too large")).count();
        assert!((1..=2).contains(&stopped), "{limit}: {said}");
        // Every section that was begun is ended.
        assert_eq!(found.not_ended, 0, "{limit}: {found}");
        assert_eq!(found.why.as_deref(), Some("File too large (os error 27)"), "{limit}: {said}");
        let begun = said.lines().filter(|line| *line == "begun").count() as u64;
        assert!((1..=2).contains(&begun), "{limit}: {said}");
        assert_eq!(there + found.missing, begun * FRAMES / 2, "{limit}: {found}");
        let at_end = format!("frames are missing: {}", found.why.unwrap());
        assert_eq!(said.lines().filter(|line| line.contains(&at_end)).count(), stopped, "{limit}: {said}");
        let (at_once, closing) = (said.find("has stopped").unwrap(), said.rfind("closing").unwrap());
        assert!(at_once < closing, "{said}");
        assert!(!by_its_end(&bytes).is_nothing());
    }
}

/// An existing recording is kept beside a new one, as `FILE.1`, which replaces an older one of that name. A `FILE.1`
/// that is no recording stays, and then nothing is recorded.
#[test]
fn a_recording_that_was_there_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.pcapng");
    let kept = dir.path().join("run.pcapng.1");
    for number in 1..=3 {
        // A recording of another process: this process would append to its own.
        let other = dir.path().join(format!("other {number}"));
        let link = record_to(&other, Clock::Virtual);
        (0..number).for_each(|n| {
            link.write(&frame(n), Wait::Now).unwrap();
        });
        link.close();
        std::fs::copy(other, &path).unwrap();
        let before = std::fs::read(&path).unwrap();
        // Each time another spelling of the path, which the process takes for a new file.
        let spelled = dir.path().join("x/../".repeat(number as usize)).join("run.pcapng");
        std::fs::create_dir_all(dir.path().join("x")).unwrap();
        record_to(&spelled, Clock::Virtual).close();
        assert!(std::fs::read(&kept).unwrap() == before, "{number}: another file");
        assert_eq!(support::recording::read_file(&path).len(), 0);
    }
    std::fs::write(&kept, "a letter").unwrap();
    let refused = RecordLink::new(
        Arc::new(Echo::new(true)),
        &dir.path().join("x/../x/../x/../x/../run.pcapng"),
        &meta(Clock::Virtual, 0),
    );
    let said = refused.err().unwrap().to_string();
    assert!(said.contains("run.pcapng.1 is there and is no recording"), "{said}");
    assert_eq!(std::fs::read(&kept).unwrap(), b"a letter");
}

/// The path of a recording is free, or is freed by removing a recording if requested, and no other file.
#[test]
fn only_a_recording_is_removed_for_a_new_one() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.pcapng");
    for overwrite in [false, true] {
        make_room(&path, overwrite).unwrap();
    }
    assert!(!path.exists());
    record_to(&path, Clock::Virtual).close();
    let refused = make_room(&path, false).unwrap_err();
    assert_eq!(refused.kind(), std::io::ErrorKind::AlreadyExists);
    assert!(std::fs::metadata(&path).unwrap().len() > 0);
    make_room(&path, true).unwrap();
    assert!(!path.exists());
    std::fs::write(&path, "").unwrap();
    make_room(&path, false).unwrap();
    std::fs::write(&path, "a letter").unwrap();
    for overwrite in [false, true] {
        assert!(make_room(&path, overwrite).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"a letter");
    }
}
