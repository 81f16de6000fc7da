//! `spi:` against a bare loop on the same spidev and the same line. What the link does at its own pace is a cycle's work;
//! what it was given before it is closed it sends as fast as it can, and that is measured, by the controller's clock.

use std::cell::RefCell;
use std::os::fd::AsRawFd;
use std::time::Duration;

use ecmsk::link::{self, Share, Wait};
use ecmsk::sk::{Frame, SlotSize};
use gpiocdev::Request;
use gpiocdev::line::EdgeDetection;
use spidev::{Spidev, SpidevOptions};

use crate::common::{self, Demand};
use crate::counted::allocations;
use crate::spi_board::{Board, Busy, FRAMES, frame};

const LINK: &str = "spi:/dev/spidev0.0?busy=gpiochip0/BUSY";
const SPIDEV: &str = "/dev/spidev0.0";
const CHIP: &str = "/dev/gpiochip0";
const BUSY: u32 = 0;
/// The link's own speed.
const SPEED_HZ: u32 = 24_000_000;
const SIZE: SlotSize = SlotSize::Bytes12;
const LIMIT: Wait = Wait::For(Duration::from_secs(10));
const BLOCKS: usize = 9;
/// At least 0.95 of the baseline's exchanges per second.
const EXCHANGE_TARGET: f64 = 1.0 / 0.95;
const TO_START_TARGET: f64 = 1.1;

pub fn measure() {
    let demand = |name, target| Demand { name, target: Some(target), allowance: None, against: None };
    {
        let board = RefCell::new(Board::start(Busy::Never));
        let side = |block: fn()| {
            block();
            board.borrow_mut().block().0
        };
        let bare = || exchange_all(&mut bare_spidev(), || {});
        common::pair_of_blocks(demand("spi_exchange", EXCHANGE_TARGET), BLOCKS, || side(write_all), || side(bare));
        common::limited("spi_allocations", on_the_way() as f64, "in 400 reports", 0.0);
    }
    let board = RefCell::new(Board::start(Busy::AWhile));
    let side = |block: fn()| {
        block();
        board.borrow_mut().block().1
    };
    common::pair_of_blocks(
        demand("spi_busy_to_start", TO_START_TARGET),
        BLOCKS,
        || side(write_all),
        || side(bare_wait),
    );
}

/// All frames through the link, those that count after it is told to close.
fn write_all() {
    let board = link::open(LINK, Share::ByName).unwrap_or_else(|error| panic!("{error}"));
    for number in 1..=FRAMES {
        board.write(&frame(number), LIMIT).expect("it takes it");
    }
    board.close();
}

/// Allocations of the link while frames and reports pass.
fn on_the_way() -> u64 {
    let board = link::open(LINK, Share::ByName).unwrap_or_else(|error| panic!("{error}"));
    let (frame, mut report) = (Frame::new(), Frame::new());
    let mut pass = |count: u32| {
        for _ in 0..count {
            board.write(&frame, LIMIT).expect("it takes it");
            board.read(&mut report, LIMIT).expect("a report");
        }
    };
    pass(100);
    allocations(|| pass(400))
}

/// All frames, one `ioctl` each; `wait` is what lies between two.
fn exchange_all(device: &mut Spidev, mut wait: impl FnMut()) {
    for number in 1..=FRAMES {
        let (frame, mut answer) = (frame(number), [0; 512]);
        let tx = frame.wire(SIZE);
        let mut transfer = Transfer {
            tx: tx.as_ptr() as u64,
            rx: answer.as_mut_ptr() as u64,
            len: tx.len() as u32,
            ..Transfer::default()
        };
        // SAFETY: the structure is that of the kernel (its size is checked below), and both buffers have `len` bytes that
        // nobody else holds until the call returns.
        let moved = unsafe { libc::ioctl(device.inner().as_raw_fd(), MESSAGE, &raw mut transfer) };
        assert_eq!(moved, tx.len() as i32, "{}", std::io::Error::last_os_error());
        wait();
    }
}

/// `struct spi_ioc_transfer` of linux/spi/spidev.h.
#[repr(C)]
#[derive(Default)]
struct Transfer {
    tx: u64,
    rx: u64,
    len: u32,
    speed_hz: u32,
    delay_us: u16,
    bits: u8,
    cs_change: u8,
    tx_width: u8,
    rx_width: u8,
    word_delay_us: u8,
    pad: u8,
}

const _: () = assert!(size_of::<Transfer>() == 32);

/// `SPI_IOC_MESSAGE(1)`: `_IOW('k', 0, char[32])`.
const MESSAGE: u64 = 0x4020_6B00;

fn bare_spidev() -> Spidev {
    let mut device = Spidev::open(SPIDEV).expect("the kernel shows it");
    let options = SpidevOptions::new().bits_per_word(8).max_speed_hz(SPEED_HZ).build();
    device.configure(&options).expect("the controller can do it");
    device
}

/// All frames, each after the edge of BUSY that the one before has caused.
fn bare_wait() {
    let line = Request::builder()
        .on_chip(CHIP)
        .with_line(BUSY)
        .as_input()
        .with_edge_detection(EdgeDetection::FallingEdge)
        .request()
        .expect("nobody else has it");
    exchange_all(&mut bare_spidev(), || {
        assert!(line.wait_edge_event(Duration::from_secs(10)).expect("it waits"), "BUSY falls");
        line.read_edge_event().expect("an edge");
    });
}
