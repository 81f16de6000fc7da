//! Recordings in blocks (`.ecmrec`) against pcapng, of axes that move through the native API on a virtual clock.
//!
//! `record_bytes_2`, `record_bytes_40`: the bytes of a stream of 2 and of 40 axes, as a part of those of pcapng.
//!
//! `record_cycle`: a cycle of 40 axes that is recorded in blocks, against one that is recorded as pcapng. On a virtual clock
//! the program waits for the recorder, so that its thread counts too.
//!
//! `record_lateness`: how late the cycles of a board with 40 axes on the real clock begin, 99 of 100, while they are recorded in
//! blocks, against those that are recorded as pcapng.
//!
//! `window_of_a_day`: 20 s out of a file of an hour, against all of a file of those 20 s.

#[path = "common/board.rs"]
mod board;
mod common;
#[path = "common/late.rs"]
mod late;

use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use common::Demand;
use ecmsk::ecm::{Config, Ecm, Stream};
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::record::{RecordLink, RecordingCopy};
use ecmsk::link::{self, Dir, Link, Share, Wait};
use ecmsk::recording::{Lacks, RecordMeta, Recorded, Recording, WindowOf};
use ecmsk::sk::{CommandId, Frame, MasterState, Motion, SlaveCommand, SlotSize};
use late::{Begins, Watched, p99_lateness};

const CYCLES: u32 = 10_000;
/// Frames that the program is ahead of the board.
const DEPTH: u16 = 16;
const S: i64 = 1_000_000_000;
/// How often the stream is repeated for the long file: an hour of cycles of 1 ms.
const REPEATS: u64 = 3600 * 1000 / CYCLES as u64;
const AXES: usize = 40;
const BLOCKS: usize = 9;
const BLOCK: Duration = Duration::from_secs(2);
/// More cycles than a block has.
const BLOCK_CYCLES_MAX: usize = 10_000;
const ALLOWANCE: Duration = Duration::from_micros(20);
const LIMIT: Wait = Wait::For(Duration::from_secs(10));

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    for (axes, name) in [(2, "record_bytes_2"), (40, "record_bytes_40")] {
        let bytes = ["pcapng", "ecmrec"].map(|ending| {
            let file = folder.path().join(format!("{axes}.{ending}"));
            let ecm = in_op(axes, &file);
            let mut program = Program::new(&ecm, axes);
            (0..CYCLES).for_each(|_| program.step());
            drop(program);
            drop(ecm);
            fs::metadata(&file).expect("it was recorded").len() as f64
        });
        common::limited(name, bytes[1] / bytes[0], "of pcapng", 1.0 / 25.0);
    }
    let [pcapng, blocks] = ["cycle.pcapng", "cycle.ecmrec"].map(|name| in_op(40, &folder.path().join(name)));
    let (mut baseline, mut ours) = (Program::new(&pcapng, 40), Program::new(&blocks, 40));
    common::pair("record_cycle", 1.05, || ours.step(), || baseline.step());
    drop((ours, baseline));
    drop([pcapng, blocks]);
    let demand =
        Demand { name: "record_lateness", target: Some(1.2), allowance: Some(ALLOWANCE), against: Some("pcapng") };
    let [pcapng, blocks] = ["late.pcapng", "late.ecmrec"].map(|name| folder.path().join(name));
    common::pair_of_blocks(demand, BLOCKS, || lateness(&blocks), || lateness(&pcapng));
    window_of_a_day(folder.path());
}

/// How late the cycles of a board begin while a program sends its axes a target in each cycle and all is recorded, ns.
fn lateness(file: &Path) -> f64 {
    let begins = Begins::default();
    let noted = Arc::clone(&begins);
    let board = board::drives_in_op_over(AXES, |bus| Box::new(Watched { bus, begins: noted }));
    let options = RunOptions { virtual_time: false, ..RunOptions::default() };
    let link = Arc::new(EngineLink::open("bench:", board, options, None).expect("it talks"));
    let info = link.info();
    let meta = RecordMeta::now(&info, info.opened_at);
    let link = RecordLink::new(link, file, &meta).expect("a file");
    let (mut command, mut report, mut path) = (Frame::new(), Frame::new(), board::Path::default());
    *begins.lock().expect("nobody panics") = Vec::with_capacity(BLOCK_CYCLES_MAX);
    let start = Instant::now();
    while start.elapsed() < BLOCK {
        link.read(&mut report, LIMIT).expect("a report");
        path.advance();
        for slave in 1..=AXES {
            command.put_slave(board::SIZE, slave, &SlaveCommand::Csp(Motion::to(path.target)).into());
        }
        command.fill_crc(board::SIZE);
        link.write(&command, LIMIT).expect("it is taken");
    }
    let begins = std::mem::take(&mut *begins.lock().expect("nobody panics"));
    link.close();
    p99_lateness(begins.into_iter())
}

/// A recorded board in OP with all axes on.
fn in_op(axes: u8, file: &Path) -> Ecm {
    let link = format!("sim:?slaves=drive*{axes}&clock=virtual&record={}", file.display());
    let ecm = Ecm::over(link::open(&link, Share::ByName).expect("a board"), Default::default()).expect("it talks");
    ecm.configure(&Config::drives(axes.into())).expect("drives");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&(1..=axes).collect::<Vec<_>>()).expect("on");
    ecm
}

/// A program whose axes go to and fro, each by another way in another time.
struct Program<'a> {
    stream: Stream<'a>,
    axes: u8,
    n: u32,
}

impl<'a> Program<'a> {
    fn new(ecm: &'a Ecm, axes: u8) -> Self {
        Self { stream: ecm.stream(DEPTH).expect("a stream"), axes, n: 0 }
    }

    fn step(&mut self) {
        let seconds = f64::from(self.n) / 1000.0;
        for axis in 1..=self.axes {
            let (length, speed) = (20_000.0 * (1.0 + 0.1 * f64::from(axis)), 0.2 + 0.02 * f64::from(axis));
            let target = length * (1.0 - (std::f64::consts::TAU * speed * seconds).cos());
            self.stream.csp(axis, target as i32).expect("the guard lets it pass");
        }
        black_box(self.stream.step().expect("a board that runs"));
        self.n += 1;
    }
}

fn window_of_a_day(folder: &Path) {
    let mut stream = Recording::open(&folder.join("40.ecmrec")).expect("a recording");
    let frames: Vec<Recorded> = stream.by_ref().map(|frame| frame.expect("whole")).collect();
    let meta = stream.meta().expect("its metadata").clone();
    let (long, short) = (folder.join("long.ecmrec"), folder.join("short.ecmrec"));
    repeat(&frames, &meta, REPEATS, &long);
    repeat(&frames, &meta, 2, &short);
    let from = 1800 * S;
    let ours = || {
        let window = WindowOf::open(&long, from, from + 20 * S).expect("it is there").expect("a part of it");
        black_box(Recording::new(window, "long").expect("a recording").count());
    };
    common::pair("window_of_a_day", 1.5, ours, || {
        black_box(Recording::open(&short).expect("a recording").count());
    });
}

/// Writes the frames `times` times, one time after the other: the configuration of the board once, and then its cycles.
fn repeat(frames: &[Recorded], meta: &RecordMeta, times: u64, file: &Path) {
    let mut copy = RecordingCopy::new(file, meta);
    let is_configuration = |frame: &Recorded| {
        frame.dir == Dir::Write && frame.frame.slot(SlotSize::Bytes12, 0).id != CommandId::GetStatus.code()
    };
    let cycles = frames.iter().rposition(is_configuration).map_or(0, |last| last + 1);
    let length = frames.last().map_or(0, |last| last.at_ns) - frames[cycles].at_ns + S as u64 / 1000;
    for time in 0..times {
        for frame in &frames[if time == 0 { 0 } else { cycles }..] {
            let at_ns = frame.at_ns + time * length;
            copy.add(&Recorded { at_ns, ..frame.clone() }).expect("room on the disk");
        }
    }
    copy.end(&Lacks::default()).expect("room on the disk");
}
