//! A board on SPI that answers each exchange the same: it is in PREOP. Frames with a number in their first slave's slot
//! are those that are measured.

use std::thread;
use std::time::Duration;

use ecmsk::sk::{Frame, SlotSize};
use rustix::time::{ClockId, clock_gettime};

use crate::other::{Other, READY};
use crate::wires::{Event, Wires};

const SIZE: SlotSize = SlotSize::Bytes12;
/// Frames in a block, numbered from 1.
pub const FRAMES: u32 = 160;
/// The link sends the first ones a cycle apart, until it is closed.
const FIRST: u32 = 40;
/// Where a frame's number is.
const NUMBER: std::ops::Range<usize> = 16..20;
/// How long a board is busy after an exchange.
const PROCESSING: Duration = Duration::from_micros(100);
const LOOK: Duration = Duration::from_secs(1);

/// When BUSY falls.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Busy {
    /// Before the exchange is over.
    Never,
    /// When the board has processed the frame.
    AWhile,
}

/// A board until it is dropped.
pub struct Board {
    process: Other,
}

impl Board {
    pub fn start(busy: Busy) -> Self {
        let word = if busy == Busy::Never { "never" } else { "a-while" };
        Self { process: Other::start(&["spi-board", word]) }
    }

    /// Of the block that has ended: time of an exchange, mean, and from BUSY's edge to the next start, median; nanoseconds.
    pub fn block(&mut self) -> (f64, f64) {
        let line = self.process.line();
        let mut numbers = line.split(' ').map(|number| number.parse().expect("a number"));
        (numbers.next().expect("the first"), numbers.next().expect("the second"))
    }
}

/// The numbered frame.
pub fn frame(number: u32) -> Frame {
    let mut frame = Frame::new();
    frame.bytes_mut()[NUMBER].copy_from_slice(&number.to_le_bytes());
    frame.fill_crc(SIZE);
    frame
}

/// The process that is the board.
pub fn run(words: &[&str]) {
    let busy = if words == ["never"] { Busy::Never } else { Busy::AWhile };
    let mut wires = Wires::open();
    println!("{READY}");
    let mut answer = Frame::new();
    // GET_STATUS, PREOP.
    answer.bytes_mut()[2] = 2;
    answer.fill_crc(SIZE);
    let mut block = Block::default();
    let mut edge_ns = None;
    loop {
        let (exchange, mosi) = match wires.next(LOOK).expect("the module is there") {
            Some(Event::Exchange(exchange, mosi)) => (exchange, mosi),
            Some(Event::Reset(reset)) => panic!("no link here has that line: {reset:?}"),
            None => continue,
        };
        wires.set_busy(true);
        if busy == Busy::Never {
            wires.set_busy(false);
        }
        // A host that was killed waits for no answer.
        let _ = wires.answer(answer.wire(SIZE));
        let number = u32::from_le_bytes(mosi[NUMBER].try_into().expect("4 bytes"));
        let done = block.heard(number, exchange.at_ns, edge_ns);
        if busy == Busy::AWhile {
            thread::sleep(PROCESSING);
            edge_ns = Some(now_ns());
            wires.set_busy(false);
        }
        if let Some((exchange_ns, to_start_ns)) = done {
            println!("{exchange_ns} {to_start_ns}");
            block = Block::default();
        }
    }
}

fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

#[derive(Default)]
struct Block {
    last: u32,
    first_ns: u64,
    to_start: Vec<f64>,
}

impl Block {
    /// The figures, when it is whole.
    fn heard(&mut self, number: u32, at_ns: u64, edge_ns: Option<u64>) -> Option<(f64, f64)> {
        if number == 0 {
            assert!(self.last < FIRST, "one that is not measured came after {}", self.last);
            return None;
        }
        assert_eq!(number, self.last + 1, "all come, in order");
        self.last = number;
        if number == FIRST {
            self.first_ns = at_ns;
        }
        if number > FIRST
            && let Some(edge_ns) = edge_ns
        {
            self.to_start.push(at_ns as f64 - edge_ns as f64);
        }
        (number == FRAMES).then(|| {
            let exchange_ns = (at_ns - self.first_ns) as f64 / f64::from(FRAMES - FIRST);
            self.to_start.sort_by(f64::total_cmp);
            (exchange_ns, self.to_start.get(self.to_start.len() / 2).copied().unwrap_or_default())
        })
    }
}
