//! `usb:` against bare loops on libusb, each on a board of its own: a synchronous one, which begins its read after the write,
//! and which the targets are for; and, to know how far the link is from what can be had, an asynchronous one, which has
//! reads under way before the board answers, as the link has.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::Frame;

use crate::common::{self, Demand};
use crate::counted::allocations;
use crate::libusb::{Bare, Queued, Synchronous};
use crate::usb_board::{Which, plug_in};

const PAIRS: u64 = 300;
const PAIR_BLOCKS: usize = 11;
/// At least 0.95 of the baseline's pairs per second.
const PAIRS_TARGET: f64 = 1.0 / 0.95;
const CALLS: usize = 600;
const LATENCY_BLOCKS: usize = 7;
const LATENCY_TARGET: f64 = 1.1;
const LIMIT: Wait = Wait::For(Duration::from_secs(10));

/// Reports read of a board that sends by itself.
const REPORTS: u64 = 2000;
/// The program does something else after so many.
const BETWEEN_PAUSES: u64 = 100;
/// For so many reports: more than the 8 transfers that wait, fewer than the queue's 32.
const PAUSE: u32 = 20;

pub fn measure() {
    pairs();
    for (name, period) in [("1khz", Duration::from_millis(1)), ("4khz", Duration::from_micros(250))] {
        stream(name, period);
    }
}

fn open() -> Arc<dyn Link> {
    link::open("usb:", Share::ByName).unwrap_or_else(|error| panic!("{error}"))
}

/// What the link is compared with.
const SYNCHRONOUS: &str = "libusb's synchronous functions: write, then read";
const QUEUED: &str = "libusb's asynchronous functions, 8 reads under way";

fn pairs() {
    let _boards = [Which::Links, Which::Synchronous, Which::Queued].map(|which| plug_in(which, None));
    let mut ours = OnLink { board: open(), frame: Frame::new(), report: Frame::new(), number: 0 };
    let mut synchronous = OnLibusb::over(Synchronous::open(0x16C0, Which::Synchronous.product()));
    let mut queued = OnLibusb::over(Queued::open(0x16C0, Which::Queued.product()));
    for _ in 0..PAIRS {
        ours.pair();
        synchronous.pair();
        queued.pair();
    }
    measure_pairs(
        &mut ours,
        &mut || synchronous.pair(),
        ["usb_pairs", "usb_latency_p50", "usb_latency_p99"],
        SYNCHRONOUS,
        [Some(PAIRS_TARGET), Some(LATENCY_TARGET)],
    );
    measure_pairs(
        &mut ours,
        &mut || queued.pair(),
        ["usb_pairs_queued", "usb_latency_queued_p50", "usb_latency_queued_p99"],
        QUEUED,
        [None; 2],
    );
    let count = allocations(|| (0..PAIRS).for_each(|_| ours.pair()));
    common::limited("usb_allocations", count as f64, "in 300 pairs", 0.0);
}

fn measure_pairs(
    ours: &mut OnLink,
    bare: &mut impl FnMut(),
    names: [&'static str; 3],
    against: &'static str,
    [most_of_pairs, most_of_latency]: [Option<f64>; 2],
) {
    let demand = |name, target| Demand { name, target, allowance: None, against: Some(against) };
    let [pairs, p50, p99] = names;
    common::pair_of_blocks(
        demand(pairs, most_of_pairs),
        PAIR_BLOCKS,
        || common::per_call_ns(PAIRS, &mut || ours.pair()),
        || common::per_call_ns(PAIRS, &mut *bare),
    );
    for (name, share) in [(p50, 50), (p99, 99)] {
        common::pair_of_blocks(
            demand(name, most_of_latency),
            LATENCY_BLOCKS,
            || common::percentile(CALLS, share, || ours.pair()),
            || common::percentile(CALLS, share, &mut *bare),
        );
    }
}

/// A frame out, and the report that answers it.
struct OnLink {
    board: Arc<dyn Link>,
    frame: Frame,
    report: Frame,
    number: u64,
}

impl OnLink {
    fn pair(&mut self) {
        self.number += 1;
        self.frame.bytes_mut()[16..24].copy_from_slice(&self.number.to_le_bytes());
        self.board.write(&self.frame, LIMIT).expect("it takes it");
        self.board.read(&mut self.report, LIMIT).expect("a report");
        assert_eq!(self.report.bytes()[16..24], self.number.to_le_bytes());
    }
}

struct OnLibusb<B> {
    board: B,
    frame: [u8; 512],
    report: [u8; 512],
    number: u64,
}

impl<B: Bare> OnLibusb<B> {
    fn over(board: B) -> Self {
        Self { board, frame: [0; 512], report: [0; 512], number: 0 }
    }

    fn pair(&mut self) {
        self.number += 1;
        self.frame[16..24].copy_from_slice(&self.number.to_le_bytes());
        self.board.write(&mut self.frame);
        self.board.read(&mut self.report);
        assert_eq!(self.report[16..24], self.number.to_le_bytes());
    }
}

/// Of a board that sends a report each `period` none is missed, though the program does something else at times.
fn stream(name: &str, period: Duration) {
    let board = plug_in(Which::Links, Some(period));
    let link = open();
    let mut report = Frame::new();
    let mut read = || {
        link.read(&mut report, LIMIT).expect("a report");
        u64::from_le_bytes(*report.bytes().first_chunk().expect("8 bytes"))
    };
    // What a thread's first wait costs is no report's.
    (0..BETWEEN_PAUSES).for_each(|_| {
        read();
    });
    let (mut missed, mut took) = (0, Duration::ZERO);
    let allocated = allocations(|| (missed, took) = read_all(period, read));
    link.close();
    drop((link, board));
    let figure = |what: &str| format!("usb_{name}_{what}");
    common::fact(&figure("reports"), REPORTS as f64 / took.as_secs_f64(), "reports/s");
    common::limited(&figure("missed"), missed as f64, "of 2000 reports", 0.0);
    common::limited(&figure("allocations"), allocated as f64, "in 2000 reports", 0.0);

    // The same without a queue: what the kernel has no transfer for is lost.
    let _board = plug_in(Which::Synchronous, Some(period));
    let mut bare = Synchronous::open(0x16C0, Which::Synchronous.product());
    let mut report = [0; 512];
    let (missed, _) = read_all(period, || {
        bare.read(&mut report);
        u64::from_le_bytes(*report.first_chunk().expect("8 bytes"))
    });
    common::fact(&figure("missed_by_bare_loop"), missed as f64, "of 2000 reports");
}

/// Reads that many, with pauses; how many are missing among their numbers, and how long it took.
fn read_all(period: Duration, mut read: impl FnMut() -> u64) -> (u64, Duration) {
    let mut last = read();
    let begin = Instant::now();
    let mut missed = 0;
    for count in 0..REPORTS {
        if count % BETWEEN_PAUSES == BETWEEN_PAUSES / 2 {
            std::thread::sleep(PAUSE * period);
        }
        let number = read();
        assert!(number > last, "in order");
        missed += number - last - 1;
        last = number;
    }
    (missed, begin.elapsed())
}
