//! Recordings for the tests of the tool: frames made by a test, recorded as those of any link.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex};

use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::recording::RecordMeta;
use ecmsk::sk::{Frame, SlotSize};

/// The frames of a recording with their times in nanoseconds and directions, in the order in which the host's calls return.
#[derive(Default)]
pub struct Script(Vec<(u64, Dir, Frame)>);

impl Script {
    /// The host writes a frame at this time.
    pub fn command(&mut self, at_ns: u64, frame: Frame) -> &mut Self {
        self.0.push((at_ns, Dir::Write, frame));
        self
    }

    /// The host reads a report that was made at this time.
    pub fn response(&mut self, at_ns: u64, frame: Frame) -> &mut Self {
        self.0.push((at_ns, Dir::Read, frame));
        self
    }

    /// Delays the read of every report until `commands` further commands were written. They then come before the report in the
    /// recording, although they are later.
    pub fn read_late(&mut self, commands: usize) -> &mut Self {
        let mut late = VecDeque::new();
        let mut order = Vec::new();
        for frame in self.0.drain(..) {
            if frame.1 == Dir::Read {
                late.push_back((frame, 0));
                continue;
            }
            order.push(frame);
            late.iter_mut().for_each(|(_, passed)| *passed += 1);
            while late.front().is_some_and(|(_, passed)| *passed == commands) {
                order.extend(late.pop_front().map(|(frame, _)| frame));
            }
        }
        order.extend(late.into_iter().map(|(frame, _)| frame));
        self.0 = order;
        self
    }

    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.0.len()
    }

    /// Removes the CRCs of the frames: byte 3 becomes 0.
    pub fn leave_crc_out(&mut self) -> &mut Self {
        self.0.iter_mut().for_each(|(_, _, frame)| frame.bytes_mut()[3] = 0);
        self
    }

    /// Records the frames to `file`, as those of the link `link`. `slot` is the slot size that the link knows.
    pub fn record(&self, file: &Path, link: &str, slot: Option<SlotSize>) {
        let meta = RecordMeta {
            slot,
            clock: Clock::Virtual,
            base_ns: 0,
            opened_ns: None,
            link: link.to_owned(),
            machine: None,
        };
        let queue = Mutex::new(self.0.iter().cloned().collect());
        let recorder = RecordLink::new(Arc::new(Scripted(queue)), file, &meta).expect("the recording begins");
        for (_, dir, frame) in &self.0 {
            match dir {
                Dir::Write => recorder.write(frame, Wait::Now).map(|_| ()).expect("a write"),
                Dir::Read => recorder.read(&mut Frame::new(), Wait::Now).map(|_| ()).expect("a read"),
            }
        }
        recorder.close();
        assert_eq!(recorder.stats().record_dropped, 0);
    }
}

/// Makes a recording look like a capture of usbmon: without the marks of a recording, and with packet k from the device
/// `devices[k]`.
pub fn make_capture(file: &Path, devices: &[u8]) {
    let mut bytes = std::fs::read(file).expect("a recording");
    let comment = bytes.windows(6).position(|six| six == b"ecmsk ").expect("a comment");
    bytes[comment..comment + 5].fill(b'x');
    // The beginnings of a packet in the format of usbmon: event, kind of transfer, endpoint and device (Linux, usbmon.rst).
    let starts = |four: &[u8]| matches!(four, [b'S', 1, 0x02, 1] | [b'C', 1, 0x81, 1]);
    let packets: Vec<_> =
        (0..bytes.len() - 8).filter(|at| starts(&bytes[*at..at + 4]) && bytes[at + 6] == b'-').collect();
    assert_eq!(packets.len(), devices.len(), "packets");
    for (packet, device) in packets.into_iter().zip(devices) {
        bytes[packet + 3] = *device;
    }
    std::fs::write(file, bytes).expect("a capture");
}

/// Records `frames` frames to `file` while the disk takes no bytes; returns the number of frames that were lost because the
/// recorder's queue was full.
pub fn record_to_a_slow_disk(file: &Path, frames: u64) -> u64 {
    let gate = Arc::new((Mutex::new(Disk::Headers), Condvar::new()));
    let sink = SlowDisk { file: File::create(file).expect("a file"), gate: Arc::clone(&gate) };
    let meta = RecordMeta {
        slot: Some(SlotSize::Bytes12),
        clock: Clock::Real,
        base_ns: 0,
        opened_ns: None,
        link: "sim:".to_owned(),
        machine: None,
    };
    let queue = Mutex::new((0..frames).map(|n| (n, Dir::Write, Frame::new())).collect());
    let recorder = RecordLink::to_sink(Arc::new(Scripted(queue)), "slow", Box::new(sink), &meta, 4);
    let recorder = recorder.expect("the recording begins");
    *gate.0.lock().expect("no panic") = Disk::Shut;
    for _ in 0..frames {
        recorder.write(&Frame::new(), Wait::Now).expect("a write");
    }
    *gate.0.lock().expect("no panic") = Disk::Open;
    gate.1.notify_all();
    recorder.close();
    recorder.stats().record_dropped
}

#[derive(PartialEq, Eq)]
enum Disk {
    Headers,
    Shut,
    Open,
}

/// A file that takes no bytes while it is blocked.
struct SlowDisk {
    file: File,
    gate: Arc<(Mutex<Disk>, Condvar)>,
}

impl Write for SlowDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let state = self.gate.0.lock().expect("no panic");
        drop(self.gate.1.wait_while(state, |state| *state == Disk::Shut).expect("no panic"));
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A link that takes the times of writes, and the reports with their times, from the script, whatever the host writes.
struct Scripted(Mutex<VecDeque<(u64, Dir, Frame)>>);

impl Scripted {
    fn next(&self) -> (u64, Frame) {
        let (at_ns, _, frame) = self.0.lock().expect("one thread").pop_front().expect("the script goes on");
        (at_ns, frame)
    }
}

impl Link for Scripted {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "scripted".into(),
            slot: None,
            virtual_time: true,
            opened_at: Stamp::default(),
            read_wait: Wait::Now,
            write_wait: Wait::Now,
        }
    }

    fn write(&self, _: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        Ok(Stamp(self.next().0))
    }

    fn read(&self, out: &mut Frame, _: Wait) -> Result<ReadMeta, LinkError> {
        let (at_ns, frame) = self.next();
        *out = frame;
        Ok(ReadMeta { at: Stamp(at_ns), ..ReadMeta::default() })
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}
