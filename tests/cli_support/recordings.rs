//! Recordings for the tests of the tool: frames of one's own, recorded as any link's are.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex};

use ecmsk::link::options::Clock;
use ecmsk::link::record::{RecordLink, RecordMeta};
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::sk::{Frame, SlotSize};

/// Frames and when they pass, in the order in which the host's calls return.
#[derive(Default)]
pub struct Script(Vec<(u64, Dir, Frame)>);

impl Script {
    /// The host writes.
    pub fn command(&mut self, at_ns: u64, frame: Frame) -> &mut Self {
        self.0.push((at_ns, Dir::Write, frame));
        self
    }

    /// The host reads a report made at that time.
    pub fn response(&mut self, at_ns: u64, frame: Frame) -> &mut Self {
        self.0.push((at_ns, Dir::Read, frame));
        self
    }

    /// Records to `file`. `slot`: what the link knows of it.
    pub fn record(&self, file: &Path, link: &str, slot: Option<SlotSize>) {
        let meta = RecordMeta { slot, clock: Clock::Virtual, base_ns: 0, link: link.to_owned() };
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

/// A link on which the script passes, whatever the host writes.
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
