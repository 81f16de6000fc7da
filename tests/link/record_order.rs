//! The order and the times of a recording's frames: threads that are late, boards that are opened again.

use std::path::Path;
use std::sync::{Arc, Mutex};

use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::link::{self, Dir, Layer, Link, LinkError, ReadMeta, Share, Stamp, Wait};
use ecmsk::recording::{Recorded, Recording};
use ecmsk::sk::Frame;
use support::recording::{Echo, frame, meta, read_file};

/// A link on the real clock whose calls return when the test makes them, with any times of their frames.
pub struct Late {
    echo: Echo,
    times: Mutex<std::vec::IntoIter<u64>>,
}

impl Late {
    pub fn at(times: Vec<u64>) -> Self {
        Self { echo: Echo::new(false), times: Mutex::new(times.into_iter()) }
    }

    fn next(&self) -> Stamp {
        Stamp(self.times.lock().unwrap().next().expect("a time for each call"))
    }
}

impl Layer for Late {
    fn inner(&self) -> &dyn Link {
        &self.echo
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.echo.write(frame, wait).map(|_| self.next())
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        Ok(ReadMeta { at: self.next(), ..self.echo.read(out, wait)? })
    }
}

/// Records calls (`true`: a write) whose frames have passed at these times; waits for the disk after each call if
/// `one_by_one`.
fn recorded(path: &Path, clock: Clock, calls: &[(bool, u64)], one_by_one: bool) -> Vec<(Dir, u64)> {
    let times: Vec<u64> = calls.iter().map(|(_, at)| *at).collect();
    let link = RecordLink::new(Arc::new(Late::at(times)), path, &meta(clock, 0)).unwrap();
    let link: &dyn Link = &link;
    let mut out = Frame::new();
    let mut length = std::fs::metadata(path).unwrap().len();
    for (number, (writes, _)) in (0..).zip(calls) {
        if *writes {
            link.write(&frame(number), Wait::Now).unwrap();
        } else {
            link.read(&mut out, Wait::Now).unwrap();
        }
        // The recorder's thread may take several frames at once; one frame at a time is the harder case.
        while one_by_one && std::fs::metadata(path).unwrap().len() == length {
            std::thread::yield_now();
        }
        length = std::fs::metadata(path).unwrap().len();
    }
    link.close();
    read_file(path).into_iter().map(|recorded: Recorded| (recorded.dir, recorded.at_ns)).collect()
}

/// On the real clock a recording has its frames in the order of their times, however late a frame's thread records it:
/// a command comes before its answer, a report before the commands that were sent after it was made. Of two frames with
/// the same time the report comes first. On a virtual clock they have the order of the calls.
#[test]
fn frames_are_in_the_order_of_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let (write, read) = (true, false);
    let calls = [
        (write, 100),
        (write, 400),
        // Made before the second command, read after it.
        (read, 300),
        (write, 900),
        (write, 600),
        (read, 600),
        (write, 700),
        (read, 200),
        (write, 1000),
    ];
    let expected = [
        (Dir::Write, 100),
        (Dir::Read, 200),
        (Dir::Read, 300),
        (Dir::Write, 400),
        (Dir::Read, 600),
        (Dir::Write, 600),
        (Dir::Write, 700),
        (Dir::Write, 900),
        (Dir::Write, 1000),
    ];
    let in_order = calls.map(|(writes, at)| (if writes { Dir::Write } else { Dir::Read }, at));
    for ending in ["pcapng", "ecmrec"] {
        for one_by_one in [true, false] {
            let path = folder.path().join(format!("real {one_by_one}.{ending}"));
            assert_eq!(recorded(&path, Clock::Real, &calls, one_by_one), expected);
        }
        let path = folder.path().join(format!("virtual.{ending}"));
        assert_eq!(recorded(&path, Clock::Virtual, &calls, true), in_order);
    }
    // A frame that comes later than the recorder sorts stays at the end, and the file is valid.
    let mut many: Vec<_> = (0..1000).map(|n| (true, 1000 + n)).collect();
    many.push((true, 5));
    many.push((true, 1900));
    let got = recorded(&folder.path().join("many"), Clock::Real, &many, true);
    assert_eq!(got.len(), 1002);
    assert!(got.contains(&(Dir::Write, 5)) && got[..850].is_sorted_by_key(|(_, at)| *at), "{got:?}");
}

/// The sections of a file: the base of its times, and the times of its frames.
fn sections(path: &Path) -> Vec<(u64, Vec<u64>)> {
    let mut recording = Recording::open(path).unwrap();
    let mut sections: Vec<(u64, Vec<u64>)> = Vec::new();
    while let Some(recorded) = recording.next() {
        let (base_ns, at_ns) = (recording.meta().unwrap().base_ns, recorded.unwrap().at_ns);
        match sections.last_mut() {
            Some((base, times)) if *base == base_ns && times.last() <= Some(&at_ns) => times.push(at_ns),
            _ => sections.push((base_ns, vec![at_ns])),
        }
    }
    sections
}

/// The recording of a board that is opened again continues by the board's own clock: with `rate=` there is no gap by
/// which the wall clock was ahead.
#[test]
fn times_continue_by_the_boards_clock_when_it_is_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.pcapng");
    let uri = format!("sim:?slaves=drive&rate=0.1&record={}", path.display());
    let mut frame = Frame::new();
    for _ in 0..3 {
        let link = link::open(&uri, Share::ByUri).unwrap();
        (0..5).for_each(|_| {
            link.read(&mut frame, Wait::Forever).unwrap();
        });
        link.close();
    }
    // One base, and continuous times: the board's own.
    let sections = sections(&path);
    assert_eq!(sections.len(), 1, "{sections:?}");
    assert_eq!(sections[0].1.len(), 15);
}

/// A new board, as one without a name is, continues in the recording too: no time occurs twice.
#[test]
fn times_of_a_new_board_follow_those_recorded_before() {
    let folder = tempfile::tempdir().unwrap();
    for (clock, passed) in [("virtual", 0), ("real", 1)] {
        let path = folder.path().join(clock);
        let uri = format!("sim:?slaves=drive&clock={clock}&record={}", path.display());
        let mut frame = Frame::new();
        for _ in 0..3 {
            let link = link::open(&uri, Share::ByName).unwrap();
            (0..5).for_each(|_| {
                link.read(&mut frame, Wait::Forever).unwrap();
            });
            link.close();
        }
        let frames = read_file(&path);
        assert_eq!(frames.len(), 15);
        assert!(frames.is_sorted_by_key(|recorded| recorded.at_ns), "{clock}: {frames:?}");
        if passed == 0 {
            let spans: Vec<u64> = frames.windows(2).map(|two| two[1].at_ns - two[0].at_ns).collect();
            assert!(spans.iter().all(|span| *span <= 1_000_000), "{spans:?}");
        }
    }
}
