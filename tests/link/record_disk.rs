//! Recordings on disks that are slow, full or missing, and in files that exist.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;
use std::time::Duration;

use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::recording::Recording;
use support::recording::{Echo, Memory, blocks, frame, frames, meta, options, read_file, record_to};

/// Blocks each write until the test lets it go on.
struct Gate {
    open: Receiver<()>,
    memory: Memory,
}

impl Gate {
    fn new(memory: &Memory) -> (Sender<()>, Self) {
        let (sender, open) = mpsc::channel();
        // The headers pass.
        sender.send(()).unwrap();
        (sender, Self { open, memory: memory.clone() })
    }
}

impl Write for Gate {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // Once the sender is dropped the gate stays open.
        let _ = self.open.recv();
        self.memory.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn on_the_real_clock_a_slow_disk_costs_frames_that_are_counted() {
    let memory = Memory::default();
    let (gate, sink) = Gate::new(&memory);
    let link = RecordLink::to_sink(Arc::new(Echo::new(false)), "m", Box::new(sink), &meta(Clock::Real, 0), 4).unwrap();
    let mut written = 0;
    while link.stats().record_dropped == 2 {
        link.write(&frame(written), Wait::Now).unwrap();
        written += 1;
    }
    drop(gate);
    link.close();

    let dropped = link.stats().record_dropped - 2;
    let bytes = memory.bytes();
    let mut recording = Recording::new(&bytes[..], "bytes").unwrap();
    let recorded: Vec<_> = recording.by_ref().map(Result::unwrap).collect();
    assert_eq!(recorded.len() as u64 + dropped, written);
    assert!(recorded.windows(2).all(|pair| pair[0].at_ns < pair[1].at_ns));
    assert_eq!(recording.missing(), dropped, "the file says so too");
    let statistics = blocks(&bytes).pop().unwrap().1;
    let comment = String::from_utf8(options(&statistics[12..])[&1].clone()).unwrap();
    assert!(comment.starts_with(&format!("{dropped} frames are missing")), "{comment}");
}

#[test]
fn on_a_virtual_clock_nothing_is_lost_however_slow_the_disk_is() {
    let memory = Memory::default();
    let (gate, sink) = Gate::new(&memory);
    let meta = meta(Clock::Virtual, 0);
    let link = RecordLink::to_sink(Arc::new(Echo::new(true)), "m", Box::new(sink), &meta, 1).unwrap();
    thread::scope(|scope| {
        scope.spawn(|| {
            for number in 0..3000 {
                link.write(&frame(number), Wait::Now).unwrap();
            }
            link.close();
        });
        scope.spawn(|| {
            while gate.send(()).is_ok() {
                thread::yield_now();
            }
        });
    });
    assert!(
        frames(&memory.bytes())
            .iter()
            .map(|recorded| &*recorded.frame)
            .eq((0..3000).map(frame).collect::<Vec<_>>().iter())
    );
    assert_eq!(link.stats().record_dropped, 2, "none but the two of the link inside");
}

/// Reports every write.
struct Telling(Sender<usize>);

impl Write for Telling {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.send(bytes.len()).unwrap();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn an_idle_recording_is_on_disk_without_a_close() {
    let (sender, written) = mpsc::channel();
    let sink = Box::new(Telling(sender));
    let link = RecordLink::to_sink(Arc::new(Echo::new(false)), "m", sink, &meta(Clock::Real, 0), 4).unwrap();
    assert!(written.recv().unwrap() > 0, "the headers");
    link.write(&frame(1), Wait::Now).unwrap();
    // The limit only ends a failing test.
    assert!(written.recv_timeout(Duration::from_secs(60)).expect("the frame") > 512);
}

/// Accepts that many bytes, the last write in part, and no more.
struct Limited {
    left: usize,
    memory: Memory,
}

impl Write for Limited {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.left == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let n = bytes.len().min(self.left);
        self.left -= n;
        self.memory.write(&bytes[..n])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn frames_that_a_full_disk_refuses_are_counted_and_the_link_goes_on() {
    let memory = Memory::default();
    let sink = Box::new(Limited { left: 100_000, memory: memory.clone() });
    let meta = meta(Clock::Virtual, 0);
    let link = RecordLink::to_sink(Arc::new(Echo::new(true)), "memory", sink, &meta, 4).unwrap();
    for number in 0..1000 {
        link.write(&frame(number), Wait::Now).unwrap();
    }
    link.close();
    assert_eq!(memory.bytes().len(), 100_000);
    let bytes = memory.bytes();
    let on_disk = Recording::new(&bytes[..], "bytes").unwrap().filter_map(Result::ok).count() as u64;
    let dropped = link.stats().record_dropped - 2;
    // Frames that the failed write has written in part count as missing.
    assert!(on_disk + dropped >= 1000 && dropped < 1000, "{on_disk} on disk, {dropped} dropped");
}

/// A real file with a full disk: the process' limit of file sizes.
#[cfg(unix)]
#[test]
fn a_frame_that_a_full_disk_has_cut_is_removed() {
    const PATH: &str = "ECMSK_TEST_FULL_DISK";
    const FRAMES: u64 = 2000;

    if let Some(path) = std::env::var_os(PATH) {
        let link = record_to(Path::new(&path), Clock::Virtual);
        for number in 0..FRAMES {
            link.write(&frame(number), Wait::Now).unwrap();
        }
        link.close();
        println!("dropped={}.", link.stats().record_dropped - 2);
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("recording");
    // An ignored signal stays ignored across exec: the write then fails instead.
    let child = std::process::Command::new("sh")
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 512; exec \"$0\" --exact --nocapture record_disk::a_frame_that_a_full_disk_has_cut_is_removed",
        ])
        .arg(std::env::current_exe().unwrap())
        .env(PATH, &path)
        .output()
        .unwrap();
    let words = String::from_utf8(child.stdout).unwrap();
    assert!(child.status.success(), "{words}{}", String::from_utf8_lossy(&child.stderr));
    let (_, rest) = words.split_once("dropped=").expect("the child's count");
    let dropped: u64 = rest.split_once('.').expect("its end").0.parse().unwrap();
    let recorded = read_file(&path);
    assert!(!recorded.is_empty() && dropped > 0);
    assert_eq!(recorded.len() as u64 + dropped, FRAMES);
    assert!(
        recorded
            .iter()
            .map(|recorded| &*recorded.frame)
            .eq((0..recorded.len() as u64).map(frame).collect::<Vec<_>>().iter())
    );
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut paths = vec![dir.path().join("no folder").join("file"), dir.path().to_path_buf()];
    if cfg!(target_os = "linux") {
        paths.push("/dev/full".into());
    }
    for path in paths {
        let failed = RecordLink::new(Arc::new(Echo::new(true)), &path, &meta(Clock::Virtual, 0)).err().unwrap();
        let LinkError::Io { what, message } = &failed else { panic!("{failed:?}") };
        assert!(what.contains(&path.display().to_string()), "{what}");
        assert!(message.contains("record="), "{message}");
    }
}

/// A board must be opened again after SW_RESET: the frames before it stay in the recording.
#[test]
fn the_first_recording_replaces_a_file_and_later_ones_append() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("recording");
    // An older recording of another process, longer than the new one.
    let older = dir.path().join("older");
    let link = record_to(&older, Clock::Virtual);
    for number in 0..100 {
        link.write(&frame(number), Wait::Now).unwrap();
    }
    link.close();
    std::fs::copy(&older, &path).unwrap();
    for number in 0..3 {
        let link = record_to(&path, Clock::Virtual);
        link.write(&frame(number), Wait::Now).unwrap();
        let second = RecordLink::new(Arc::new(Echo::new(true)), &path, &meta(Clock::Virtual, 0)).err().unwrap();
        assert!(second.to_string().contains("another recording"), "{second}");
        link.close();
        let recorded = read_file(&path);
        assert!(
            recorded.iter().map(|recorded| &*recorded.frame).eq((0..=number).map(frame).collect::<Vec<_>>().iter())
        );
    }
}

/// A file with other content is left unchanged, and the message says so; an empty one is used.
#[test]
fn other_files_are_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("drawing");
    let mut capture = vec![0x0A, 0x0D, 0x0D, 0x0A, 28, 0, 0, 0, 0x4D, 0x3C, 0x2B, 0x1A, 1, 0, 0, 0];
    capture.extend([[0xFF; 8].as_slice(), &[28, 0, 0, 0], b"ecmsk stands behind its header"].concat());
    for text in [b"G1 X10 Y20\n".as_slice(), b"e", b"ecmsk is named here", &[0x0A, 0x0D, 0x0D, 0x0A], &capture] {
        std::fs::write(&path, text).unwrap();
        for _ in 0..2 {
            let refused = RecordLink::new(Arc::new(Echo::new(true)), &path, &meta(Clock::Virtual, 0)).err().unwrap();
            let said = refused.to_string();
            assert!(said.contains("no recording of ecmsk") && said.contains("name another file"), "{said}");
            assert_eq!(std::fs::read(&path).unwrap(), text);
        }
    }
    std::fs::write(&path, b"").unwrap();
    record_to(&path, Clock::Virtual).close();
    assert_eq!(read_file(&path).len(), 0);
}
