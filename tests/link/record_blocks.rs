//! Recordings in blocks, `FILE.ecmrec`: what a whole, a cut and a damaged file show, and stretches of long ones.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::link::{Link, Wait};
use ecmsk::recording::{Lacks, Recorded, Recording, WindowOf, lacks_at_end};
use ecmsk::sk::{Frame, MasterCommand, SlotSize};
use support::dice::Dice;
use support::recording::{Echo, Memory, frame, meta};
use tempfile::TempDir;

use crate::record_order::Late;

const MS: u64 = 1_000_000;
/// More frames than three blocks have.
const FRAMES: u64 = 3500;
/// The time of the first frame.
const BEGIN_NS: u64 = 1_700_000_000_000_000_000;
/// The most frames of a block, and those that wait for the next one.
const BLOCK_MAX: usize = 1024 + 128;

/// The length of a header, and of what stands around the bytes of a block.
const HEADER: usize = 64;
const AROUND: usize = HEADER + 4;
/// Kinds of blocks.
const PACKETS: u8 = 1;
const PIECE: u8 = 2;
const END: u8 = 4;

/// A frame of a motion: a command that moves on, beside bytes that are never the same.
fn moving(number: u64, dice: &mut Dice) -> Frame {
    let mut frame = frame(number);
    frame.bytes_mut()[0] = 0;
    frame.bytes_mut()[100..104].copy_from_slice(&(dice.below(1 << 30) as u32).to_le_bytes());
    frame
}

/// Records frames with these times to a file, and closes it.
fn record(path: &Path, clock: Clock, times: &[u64]) -> Vec<Frame> {
    let mut dice = Dice(times.len() as u64);
    let link = RecordLink::new(Arc::new(Late::at(times.to_vec())), path, &meta(clock, 0)).unwrap();
    let frames: Vec<Frame> = (0..times.len() as u64).map(|number| moving(number, &mut dice)).collect();
    for frame in &frames {
        link.write(frame, Wait::Now).unwrap();
    }
    link.close();
    assert_eq!(link.stats().record_dropped, 2, "none but the two of the link inside");
    frames
}

fn every_ms(frames: u64) -> Vec<u64> {
    (0..frames).map(|number| BEGIN_NS + number * MS).collect()
}

fn new_file() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.ecmrec");
    (folder, path)
}

/// The frames of a file in which all else is said by [`Lacks`], and what it lacks.
fn read(bytes: &[u8]) -> (Vec<Recorded>, Lacks) {
    let mut recording = Recording::new(bytes, "run").unwrap();
    let frames = recording.by_ref().map(|frame| frame.expect("damage is no error")).collect();
    (frames, recording.lacks())
}

/// Kind, offset and length of each block of a whole file.
fn blocks(bytes: &[u8]) -> Vec<(u8, usize, usize)> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let length = AROUND + u32::from_le_bytes(bytes[at + 16..at + 20].try_into().unwrap()) as usize;
        found.push((bytes[at + 9], at, length));
        at += length;
    }
    assert_eq!(at, bytes.len());
    found
}

/// CRC-32 (IEEE), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| crc >> 1 ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}

/// All frames are there with their bytes, times and metadata, the file says that it is whole, and it is small.
#[test]
fn what_was_recorded_is_read_back() {
    let (_folder, path) = new_file();
    let times = every_ms(FRAMES);
    let sent = record(&path, Clock::Real, &times);
    let bytes = std::fs::read(&path).unwrap();
    let (found, lacks) = read(&bytes);
    assert!(found.iter().map(|recorded| &*recorded.frame).eq(&sent));
    assert!(found.iter().map(|recorded| recorded.at_ns).eq(times));
    assert_eq!((lacks, lacks_at_end(&path).unwrap()), (Lacks::default(), Lacks::default()));
    assert_eq!(Recording::new(&bytes[..], "run").unwrap().meta(), Some(&meta(Clock::Real, 0)));
    // Four bytes of each frame are never the same.
    assert!(bytes.len() < 40 * FRAMES as usize, "{} bytes", bytes.len());
    let kinds: Vec<u8> = blocks(&bytes).iter().map(|(kind, ..)| *kind).collect();
    assert!(kinds.iter().filter(|kind| **kind == PACKETS).count() >= 3 && !kinds.contains(&PIECE), "{kinds:?}");
}

/// A board that is opened again continues the file, and files may be joined.
#[test]
fn several_recordings_in_a_file_are_read_one_after_the_other() {
    let (_folder, path) = new_file();
    for _ in 0..3 {
        record(&path, Clock::Virtual, &every_ms(100));
    }
    let bytes = std::fs::read(&path).unwrap();
    let all: Vec<u64> = read(&bytes).0.iter().map(|recorded| recorded.at_ns).collect();
    assert!(all.len() == 300 && all.is_sorted() && all.starts_with(&every_ms(100)));
    let (found, lacks) = read(&[&bytes[..], &bytes].concat());
    assert!(lacks.is_nothing(), "{lacks}");
    assert!(found.iter().map(|recorded| recorded.at_ns).eq([&all[..], &all].concat()));
    // The first of two files was cut: the second one is read all the same.
    let cut = blocks(&bytes)[1].1 + 100;
    let (found, lacks) = read(&[&bytes[..cut], &bytes].concat());
    assert!(found.iter().map(|recorded| recorded.at_ns).eq(all));
    assert_eq!((lacks.not_ended, lacks.damage.count), (1, 1), "{lacks}");
}

/// A file that ends at any byte has the frames of all blocks before, and says that it was not ended.
#[test]
fn a_cut_file_is_read_up_to_the_cut() {
    let (_folder, path) = new_file();
    let times = every_ms(FRAMES);
    record(&path, Clock::Real, &times);
    let bytes = std::fs::read(&path).unwrap();
    let blocks = blocks(&bytes);
    let mut dice = Dice(42);
    let ends = blocks.iter().flat_map(|(_, at, length)| [*at, at + 1, at + HEADER, at + length - 1]);
    let anywhere: Vec<usize> = (0..40).map(|_| dice.below(bytes.len() as u64) as usize).collect();
    for end in ends.chain(anywhere).filter(|end| *end >= blocks[1].1) {
        let (found, lacks) = read(&bytes[..end]);
        assert!(found.iter().map(|recorded| recorded.at_ns).eq(times[..found.len()].iter().copied()), "{end}");
        let whole = blocks.iter().filter(|(kind, at, length)| *kind == PACKETS && at + length <= end);
        let least: u32 = whole.map(|(_, at, _)| u32::from_le_bytes(bytes[at + 24..at + 28].try_into().unwrap())).sum();
        assert_eq!(found.len(), least as usize, "{end}");
        assert_eq!(lacks.not_ended, 1, "{end}");
        let is_at_a_block = blocks.iter().any(|(_, at, _)| *at == end);
        assert_eq!(lacks.damage.count, u64::from(!is_at_a_block), "{end}: {lacks}");
    }
}

/// A wrong bit costs the frames of its block, and the message says of which time. All others are read.
#[test]
fn a_flipped_bit_costs_its_block_alone() {
    let (_folder, path) = new_file();
    let times = every_ms(FRAMES);
    record(&path, Clock::Real, &times);
    let bytes = std::fs::read(&path).unwrap();
    let mut dice = Dice(7);
    for (kind, at, length) in blocks(&bytes) {
        let any = |dice: &mut Dice| dice.below(length as u64) as usize;
        for offset in [0, 9, HEADER - 1, length - 1, any(&mut dice), any(&mut dice)] {
            let mut damaged = bytes.clone();
            damaged[at + offset] ^= 1 << dice.below(8);
            let (found, lacks) = read(&damaged);
            let found: Vec<u64> = found.iter().map(|recorded| recorded.at_ns).collect();
            let missing: Vec<u64> = times.iter().copied().filter(|at| found.binary_search(at).is_err()).collect();
            assert_eq!(lacks.damage.count, 1, "{kind} {offset}: {lacks}");
            assert_eq!(lacks.not_ended, u64::from(kind == END), "{kind} {offset}");
            assert!(found.is_sorted() && found.len() + missing.len() == times.len());
            assert_eq!(missing.is_empty(), kind != PACKETS, "{kind} {offset}");
            assert!(missing.len() <= BLOCK_MAX, "{kind} {offset}");
            let lost = lacks.damage.whole;
            for at in [missing.first(), missing.last()].into_iter().flatten() {
                let (from, to) = (lost.from_ns.unwrap_or(BEGIN_NS), lost.to_ns.unwrap_or(u64::MAX));
                assert!((from..=to).contains(at), "{kind} {offset}: {lost:?}");
            }
        }
    }
}

/// Blocks of a newer version are skipped, and the message names the reason.
#[test]
fn a_block_of_a_newer_version_is_skipped() {
    let (_folder, path) = new_file();
    record(&path, Clock::Real, &every_ms(FRAMES));
    let mut bytes = std::fs::read(&path).unwrap();
    let (_, at, _) = *blocks(&bytes).iter().filter(|(kind, ..)| *kind == PACKETS).nth(1).unwrap();
    bytes[at + 8] += 1;
    let crc = crc32(&bytes[at..at + HEADER - 4]).to_le_bytes();
    bytes[at + HEADER - 4..at + HEADER].copy_from_slice(&crc);
    let (found, lacks) = read(&bytes);
    assert_eq!(found.len() + lacks.damage.whole.packets as usize, FRAMES as usize);
    assert!(lacks.damage.whole.is_newer && lacks.to_string().contains("a newer version"), "{lacks}");
    assert!(lacks.to_string().contains("from 1.024 s to 2.047 s"), "{lacks}");
}

/// A clock that goes back is recorded as it went, in the order of the calls.
#[test]
fn a_clock_may_go_back() {
    let (_folder, path) = new_file();
    let times: Vec<u64> = (0..3000).map(|number| BEGIN_NS - number / 1000 * 3_600_000 * MS + number * MS).collect();
    record(&path, Clock::Virtual, &times);
    let (found, lacks) = read(&std::fs::read(&path).unwrap());
    assert!(lacks.is_nothing() && found.iter().map(|recorded| recorded.at_ns).eq(times), "{lacks}");
    assert!(WindowOf::open(&path, 0, 1000).unwrap().is_none(), "a stretch of time is none of the file");
}

/// A recording that is not ended has all frames that the recorder has handed to the system, as when its program is
/// killed: those of the last block stand in pieces.
#[test]
fn a_recording_that_grows_has_all_frames() {
    let (_folder, path) = new_file();
    let link = RecordLink::new(Arc::new(Echo::new(false)), &path, &meta(Clock::Real, 0)).unwrap();
    let mut dice = Dice(1);
    for number in 0..3000 {
        link.write(&moving(number, &mut dice), Wait::Now).unwrap();
    }
    // The recorder's thread needs a while. A timeout would only end a hang.
    while read(&std::fs::read(&path).unwrap()).0.len() < 3000 {
        std::thread::yield_now();
    }
    let (_, lacks) = read(&std::fs::read(&path).unwrap());
    assert_eq!((lacks.not_ended, lacks.damage.count), (1, 0), "{lacks}");
    assert_eq!(lacks_at_end(&path).unwrap().not_ended, 1);
    link.close();
    assert!(lacks_at_end(&path).unwrap().is_nothing());
}

/// A pipe gets each frame at once, as a piece.
#[test]
fn a_pipe_gets_frames_at_once() {
    let memory = Memory::default();
    let meta = meta(Clock::Virtual, 0);
    let sink = Box::new(memory.clone());
    let link = RecordLink::to_sink(Arc::new(Echo::new(true)), "pipe.ecmrec", sink, &meta, 4).unwrap();
    for number in 0..2500 {
        link.write(&frame(number), Wait::Now).unwrap();
    }
    link.close();
    let (found, lacks) = read(&memory.bytes());
    assert!(
        lacks.is_nothing() && found.iter().map(|found| &*found.frame).eq(&(0..2500).map(frame).collect::<Vec<_>>())
    );
    assert!(blocks(&memory.bytes()).iter().all(|(kind, ..)| *kind != PACKETS));
}

/// A stretch of a long recording: all frames of it and the commands that explain it, from a small part of the file. The
/// same without the end of the file, which has the index.
#[test]
fn a_stretch_is_read_without_the_rest() {
    const FRAMES: u64 = 36_000;
    let (folder, path) = new_file();
    let times = every_ms(FRAMES);
    let link = RecordLink::new(Arc::new(Late::at(times.clone())), &path, &meta(Clock::Virtual, 0)).unwrap();
    let mut dice = Dice(3);
    for number in 0..FRAMES {
        let mut frame = moving(number, &mut dice);
        if number == 12_000 {
            frame.put_master(SlotSize::Bytes12, &MasterCommand::SoftReset);
        }
        link.write(&frame, Wait::Now).unwrap();
    }
    link.close();
    let whole = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.ecmrec");
    std::fs::write(&cut, &whole[..whole.len() - 10]).unwrap();
    for (path, not_ended) in [(&path, 0), (&cut, 1)] {
        let mut window = WindowOf::open(path, 24_000 * MS as i64, 24_500 * MS as i64).unwrap().expect("a part");
        assert_eq!(window.frames(), FRAMES);
        let mut bytes = Vec::new();
        window.read_to_end(&mut bytes).unwrap();
        assert!(bytes.len() * 6 < whole.len(), "{} of {}", bytes.len(), whole.len());
        let (found, lacks) = read(&bytes);
        // The end that was cut is read, too.
        assert_eq!((lacks.not_ended, lacks.damage.count), (not_ended, not_ended), "{lacks}");
        let found: Vec<u64> = found.iter().map(|recorded| recorded.at_ns).collect();
        let needed = [&[times[0], times[12_000]], &times[24_000..=24_500]].concat();
        assert!(found.is_sorted() && needed.iter().all(|at| found.binary_search(at).is_ok()), "{not_ended}");
    }
}

/// A real file with a full disk: the process' limit of file sizes. What fits is there, the file is ended, and says how many
/// frames are missing and why.
#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_recording() {
    const PATH: &str = "ECMSK_TEST_FULL_DISK_BLOCKS";
    const FRAMES: u64 = 1500;
    const FIRST_FRAMES: u64 = 400;
    /// The bytes of the first frames, some 580 each in pieces, less those of frames that a thread without a turn may lose.
    const IN_PIECES: u64 = 210_000;
    /// The same frames in a block, which is a little shorter than the pieces that it replaces.
    const ON_DISK: u64 = 200_000;

    if let Some(path) = std::env::var_os(PATH) {
        let path = Path::new(&path);
        let link = RecordLink::new(Arc::new(Echo::new(true)), path, &meta(Clock::Virtual, 0)).unwrap();
        let mut dice = Dice(5);
        for n in 1..=FRAMES {
            let mut frame = Frame::new();
            frame.bytes_mut().iter_mut().for_each(|byte| *byte = dice.roll() as u8);
            link.write(&frame, Wait::Now).unwrap();
            // These fit: they are on the disk before a single write has more frames than fit.
            while n == FIRST_FRAMES && std::fs::metadata(path).unwrap().len() < IN_PIECES {
                std::thread::yield_now();
            }
        }
        link.close();
        return;
    }
    for limit in ["511", "512", "1200"] {
        let (_folder, path) = new_file();
        let child = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f \"$1\"; exec \"$0\" --exact --nocapture \"$2\""])
            .arg(std::env::current_exe().unwrap())
            .args([limit, "record_blocks::a_full_disk_ends_the_recording"])
            .env(PATH, &path)
            .output()
            .unwrap();
        let said = String::from_utf8(child.stderr).unwrap();
        assert!(child.status.success(), "{said}");
        let (found, lacks) = read(&std::fs::read(&path).unwrap());
        assert_eq!((lacks.not_ended, lacks.damage.count), (0, 0), "{limit}: {lacks}");
        assert_eq!(found.len() as u64 + lacks.missing, FRAMES, "{limit}: {lacks}");
        let bytes = std::fs::metadata(&path).unwrap().len();
        assert!(bytes >= ON_DISK, "{limit}: {bytes} bytes, {lacks}");
        assert_eq!(lacks.why.as_deref(), Some("File too large (os error 27)"), "{limit}: {said}");
        assert!(said.contains("has stopped: File too large"), "{limit}: {said}");
    }
}
