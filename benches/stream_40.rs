//! `stream_40`: 40 axes in CSP through the native API, `csp` for each and `step`, against a program that does the same with
//! raw frames over the same link: it encodes 40 CSP slots, fills the CRC, writes, reads one report and checks its CRC.
//! The raw program uses nothing else of the report: the API has the guard, statuswords, credit and underruns on top.
//! Virtual time, so that both sides wait for nothing; either side's time has the modelled board in it, which
//! `stream_40_board` tells: the same frame over and over, and no look at the reports.

mod common;

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use ecmsk::ecm::{Config, Ecm, Stream};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::{CrcPolicy, Frame, MasterResponse, MasterState, Motion, SlaveCommand, SlotSize, StateByte};

const SIZE: SlotSize = SlotSize::Bytes12;
const AXES: u8 = 40;
const LINK: &str = "sim:?slaves=drive*40&clock=virtual&name=";
/// Frames that both programs are ahead of the board.
const DEPTH: u16 = 16;
/// Counts in a cycle, and the cycles after which the axes turn back.
const STEP: i32 = 20;
const STROKE: i32 = 1000;

fn main() {
    let ecm = in_op("native");
    let mut native = Native { stream: ecm.stream(DEPTH).expect("a stream"), path: Path::default() };
    let mut raw = Raw::new(in_op("raw"));
    common::pair("stream_40", 1.2, || native.step(), || raw.step());

    let mut board = || {
        raw.link.write(black_box(&raw.command), Wait::For(LIMIT)).expect("it takes frames");
        raw.link.read(&mut raw.report, Wait::For(LIMIT)).expect("it makes reports");
    };
    common::fact("stream_40_board", common::per_call_ns(20_000, &mut board), "ns");
    let stats = native.stream.stats().expect("it is open");
    assert_eq!((stats.underruns, stats.losses), (0, 0), "the native stream ran well");
    raw.assert_well();
}

const LIMIT: Duration = Duration::from_secs(1);

/// A board in OP with all axes on.
fn in_op(name: &str) -> Ecm {
    let link = link::open(&format!("{LINK}{name}"), Share::ByName).expect("a simulated board");
    let ecm = Ecm::over(link, Default::default()).expect("it talks");
    ecm.configure(&Config::drives(AXES.into())).expect("40 drives");
    ecm.set_state(MasterState::Op).expect("OP");
    ecm.servo_on(&(1..=AXES).collect::<Vec<_>>()).expect("on");
    ecm
}

/// A target that goes to and fro.
#[derive(Default)]
struct Path {
    target: i32,
    n: i32,
}

impl Path {
    fn advance(&mut self) -> i32 {
        self.target += if self.n % (2 * STROKE) < STROKE { STEP } else { -STEP };
        self.n += 1;
        self.target
    }
}

struct Native<'a> {
    stream: Stream<'a>,
    path: Path,
}

impl Native<'_> {
    fn step(&mut self) {
        let target = self.path.advance();
        for slave in 1..=AXES {
            self.stream.csp(slave, black_box(target)).expect("the guard lets it pass");
        }
        black_box(self.stream.step().expect("a board that runs"));
    }
}

struct Raw {
    link: Arc<dyn Link>,
    path: Path,
    command: Frame,
    report: Frame,
}

impl Raw {
    /// Takes over the board of an [`Ecm`], which has switched the axes on.
    fn new(ecm: Ecm) -> Self {
        ecm.close(ecmsk::ecm::Close::Leave).expect("it is left as it is");
        let link = link::open(&format!("{LINK}raw"), Share::ByName).expect("the board is found again");
        let mut raw = Self { link, path: Path::default(), command: Frame::new(), report: Frame::new() };
        for _ in 0..DEPTH {
            raw.encode();
            raw.link.write(&raw.command, Wait::For(LIMIT)).expect("it takes frames");
        }
        raw
    }

    fn encode(&mut self) {
        let target = self.path.advance();
        for slave in 1..=usize::from(AXES) {
            self.command.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(black_box(target))).into());
        }
        self.command.fill_crc(SIZE);
    }

    fn step(&mut self) {
        self.encode();
        self.link.write(&self.command, Wait::For(LIMIT)).expect("it takes frames");
        self.link.read(&mut self.report, Wait::For(LIMIT)).expect("it makes reports");
        self.report.check_crc(SIZE, CrcPolicy::AbsentAllowed).expect("a right CRC");
        black_box(&self.report);
    }

    fn assert_well(&self) {
        let answer = MasterResponse::decode(&self.report.slot(SIZE, 0));
        assert_eq!((answer.state, answer.full_count), (StateByte::reached(MasterState::Op), 0));
        let board = self.link.stats().board.expect("a modelled board");
        assert_eq!((board.full, board.rejected_total(), board.discarded_before_enabled), (0, 0, 0));
    }
}
