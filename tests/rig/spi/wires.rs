//! The board's end of the wires: `/dev/ecm-board` of the module in `tests/rig/board`.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

const FILE: &str = "/dev/ecm-board";

/// `struct event`: kind, value, speed, mode, bits, transfers, time.
const HEADER: usize = 24;
const EXCHANGE: u32 = 1;
const RESET_LEVEL: u32 = 2;
const ANSWER: u8 = 1;
const BUSY_LEVEL: u8 = 2;
/// The limit of the module, and of the kernel for one message of spidev.
const LONGEST: usize = 4096;

/// An exchange under one chip select, with the controller's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    pub len: usize,
    pub speed_hz: u32,
    pub mode: u8,
    pub bits: u8,
    /// The host's transfers in this exchange.
    pub transfers: u16,
    /// Nanoseconds of CLOCK_MONOTONIC.
    pub at_ns: u64,
}

/// RESET has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    pub high: bool,
    /// Nanoseconds of CLOCK_MONOTONIC.
    pub at_ns: u64,
}

/// An action of the host.
pub enum Event {
    /// It expects as many bytes as it has sent.
    Exchange(Exchange, Vec<u8>),
    Reset(Reset),
}

/// The wires, which one board can use at a time.
pub struct Wires {
    file: File,
    event: Vec<u8>,
}

impl Wires {
    #[track_caller]
    pub fn open() -> Self {
        let file = OpenOptions::new().read(true).write(true).open(FILE);
        let file = file.expect("the module is loaded, and no other board has the wires");
        Self { file, event: vec![0; HEADER + LONGEST] }
    }

    /// Waits for the host's next action.
    pub fn next(&mut self, limit: Duration) -> io::Result<Option<Event>> {
        let limit = Timespec { tv_sec: limit.as_secs() as _, tv_nsec: limit.subsec_nanos() as _ };
        if poll(&mut [PollFd::new(&self.file, PollFlags::IN)], Some(&limit))? == 0 {
            return Ok(None);
        }
        let len = self.file.read(&mut self.event)?;
        let (header, bytes) = self.event[..len].split_at(HEADER);
        let word = |at: usize| u32::from_ne_bytes(header[at..at + 4].try_into().expect("4 bytes"));
        let at_ns = u64::from_ne_bytes(header[16..24].try_into().expect("8 bytes"));
        Ok(Some(match word(0) {
            EXCHANGE => {
                let (mode, bits) = (header[12], header[13]);
                let transfers = u16::from_ne_bytes([header[14], header[15]]);
                let exchange = Exchange { len: bytes.len(), speed_hz: word(8), mode, bits, transfers, at_ns };
                Event::Exchange(exchange, bytes.to_owned())
            }
            RESET_LEVEL => Event::Reset(Reset { high: word(4) != 0, at_ns }),
            other => panic!("an event of kind {other}"),
        }))
    }

    /// Ends the exchange with these bytes on MISO. An error: the host has given it up.
    pub fn answer(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(&[&[ANSWER], bytes].concat())
    }

    /// Sets the level of BUSY.
    #[track_caller]
    pub fn set_busy(&mut self, high: bool) {
        self.file.write_all(&[BUSY_LEVEL, u8::from(high)]).expect("a level is always taken");
    }
}
