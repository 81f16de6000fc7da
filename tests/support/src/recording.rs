//! A link that echoes, places to record to, and an independent reader of pcapng.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::path::Path;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex};

use ecmsk::link::options::Clock;
use ecmsk::link::record::RecordLink;
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::recording::{RecordMeta, Recorded, Recording};
use ecmsk::sk::{Frame, SlotSize};

pub const URI: &str = "sim:?slaves=drive*3&clock=virtual";

/// Returns every frame that is written. Its clock moves by 125 us with every call that moves one.
pub struct Echo {
    pub virtual_time: bool,
    state: Mutex<State>,
    changed: Condvar,
    /// Gets a message when a read begins to wait.
    pub waiting: Option<Sender<()>>,
}

struct State {
    echoes: VecDeque<Frame>,
    now: u64,
    closed: bool,
    cancelled: Vec<Dir>,
    stats: LinkStats,
}

impl Echo {
    pub fn new(virtual_time: bool) -> Self {
        let stats = LinkStats { reports_dropped: 3, record_dropped: 2, ..LinkStats::default() };
        let echoes = VecDeque::with_capacity(1024);
        let state = State { echoes, now: 1_000_000_000, closed: false, cancelled: Vec::new(), stats };
        Self { virtual_time, state: Mutex::new(state), changed: Condvar::new(), waiting: None }
    }

    pub fn cancelled(&self) -> Vec<Dir> {
        self.state.lock().unwrap().cancelled.clone()
    }
}

impl Link for Echo {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: URI.to_owned(),
            slot: Some(SlotSize::Bytes12),
            virtual_time: self.virtual_time,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Now,
        }
    }

    fn write(&self, frame: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        let mut state = self.state.lock().unwrap();
        if state.closed {
            return Err(LinkError::Closed);
        }
        state.now += 125_000;
        state.stats.written += 1;
        state.echoes.push_back(frame.clone());
        self.changed.notify_all();
        Ok(Stamp(state.now))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let mut state = self.state.lock().unwrap();
        loop {
            if state.closed {
                return Err(LinkError::Closed);
            }
            if let Some(frame) = state.echoes.pop_front() {
                *out = frame;
                state.now += 125_000;
                state.stats.read += 1;
                return Ok(ReadMeta { at: Stamp(state.now), sequence: state.stats.read - 1, dropped: 0 });
            }
            if wait != Wait::Forever {
                return Err(LinkError::Cancelled { dir: Dir::Read });
            }
            if let Some(waiting) = &self.waiting {
                waiting.send(()).unwrap();
            }
            state = self.changed.wait(state).unwrap();
        }
    }

    fn cancel(&self, dir: Dir) {
        self.state.lock().unwrap().cancelled.push(dir);
    }

    fn close(&self) {
        self.state.lock().unwrap().closed = true;
        self.changed.notify_all();
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.state.lock().unwrap().closed { Err(LinkError::Closed) } else { Ok(()) }
    }

    fn stats(&self) -> LinkStats {
        self.state.lock().unwrap().stats
    }
}

/// A file in memory.
#[derive(Clone, Default)]
pub struct Memory(Arc<Mutex<Vec<u8>>>);

impl Memory {
    pub fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub fn meta(clock: Clock, base_ns: u64) -> RecordMeta {
    RecordMeta { slot: Some(SlotSize::Bytes12), clock, base_ns, opened_ns: None, link: URI.to_owned(), machine: None }
}

/// A frame that differs from all others.
pub fn frame(number: u64) -> Frame {
    let mut frame = Frame::new();
    for (chunk, salt) in frame.bytes_mut().chunks_exact_mut(8).zip(0..) {
        chunk.copy_from_slice(&(number + salt * 0x0101_0101_0101).to_le_bytes());
    }
    frame
}

/// Records `pairs` frames and their echoes in virtual time.
pub fn recording_of(pairs: u64) -> Vec<u8> {
    let memory = Memory::default();
    let meta = meta(Clock::Virtual, 0);
    let link = RecordLink::to_sink(Arc::new(Echo::new(true)), "memory", Box::new(memory.clone()), &meta, 4).unwrap();
    let mut out = Frame::new();
    for number in 0..pairs {
        link.write(&frame(number), Wait::Now).unwrap();
        link.read(&mut out, Wait::Now).unwrap();
    }
    link.close();
    memory.bytes()
}

/// All frames of a recording that has no errors.
pub fn frames(bytes: &[u8]) -> Vec<Recorded> {
    Recording::new(bytes, "bytes").unwrap().collect::<Result<_, _>>().unwrap()
}

pub fn record_to(path: &Path, clock: Clock) -> RecordLink {
    RecordLink::new(Arc::new(Echo::new(clock == Clock::Virtual)), path, &meta(clock, 0)).unwrap()
}

pub fn read_file(path: &Path) -> Vec<Recorded> {
    frames(&std::fs::read(path).unwrap())
}

/// Splits a little-endian pcapng file into type and body of its blocks.
pub fn blocks(mut bytes: &[u8]) -> Vec<(u32, Vec<u8>)> {
    let mut blocks = Vec::new();
    while !bytes.is_empty() {
        let length = u32_at(bytes, 4) as usize;
        assert_eq!(length % 4, 0);
        assert_eq!(u32_at(bytes, length - 4) as usize, length, "the length stands at both ends");
        blocks.push((u32_at(bytes, 0), bytes[8..length - 4].to_vec()));
        bytes = &bytes[length..];
    }
    blocks
}

/// The options in the rest of a block's body.
pub fn options(mut bytes: &[u8]) -> BTreeMap<u16, Vec<u8>> {
    let mut options = BTreeMap::new();
    while !bytes.is_empty() {
        let (code, length) = (u16_at(bytes, 0), usize::from(u16_at(bytes, 2)));
        if code == 0 {
            assert_eq!(bytes.len(), 4, "opt_endofopt is the last");
            return options;
        }
        options.insert(code, bytes[4..4 + length].to_vec());
        bytes = &bytes[4 + length.next_multiple_of(4)..];
    }
    panic!("no opt_endofopt");
}

pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())
}

pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

pub fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// CRC-32 (IEEE), bit by bit.
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| crc >> 1 ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}
