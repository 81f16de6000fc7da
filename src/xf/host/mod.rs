//! The driver of a host for the chip: it decides which bytes to exchange next, and interprets the bytes received.
//!
//! The driver is pure: time is an argument, bytes are passed in and out, nothing waits or allocates, and no thread is
//! started. The owner of the wires asks [`Host::next`] what to do, does it, and passes the received bytes to
//! [`Host::received`]. [`Host::step`] does this for wires that implement [`Wires`]:
//!
//! ```
//! use ecmsk::xf::host::{Host, HostConfig, HostError, HostState, StepError, Wires};
//!
//! /// Wires to a chip that has no power.
//! struct Dead(u64);
//!
//! impl Wires for Dead {
//!     type Error = std::convert::Infallible;
//!
//!     fn now(&self) -> u64 {
//!         self.0
//!     }
//!     fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Self::Error> {
//!         self.0 += 333 * to_chip.len() as u64; // a byte takes 333 ns at 24 MHz
//!         from_chip.fill(0);
//!         Ok(())
//!     }
//!     fn wait_until(&mut self, time: u64) -> Result<(), Self::Error> {
//!         self.0 = self.0.max(time);
//!         Ok(())
//!     }
//!     fn wait_ready(&mut self, _: u64) -> Result<bool, Self::Error> {
//!         Ok(false)
//!     }
//! }
//!
//! let mut wires = Dead(0);
//! let mut host = Host::new(wires.now(), HostConfig::default());
//! let error = loop {
//!     if let Err(error) = host.step(&mut wires, u64::MAX) {
//!         break error;
//!     }
//! };
//! assert!(matches!(error, StepError::Host(HostError::Silent { .. })));
//! assert!(matches!(host.state(), HostState::Stopped(_)));
//! ```
//!
//! Commands can be submitted at any time ([`Host::submit`], [`Host::submit_pair`]) and their results taken later
//! ([`Host::take`]). Process data have functions of their own ([`Host::process`], [`Host::take_report`],
//! [`Host::inputs`]).
//!
//! # No command runs twice
//!
//! A packet is sent in every exchange until its answer has come. Of two consecutive packets with the same index and
//! code the chip treats the second as INFO_UPDATE. So the command runs once, whichever of the copies arrives intact,
//! and the answers to the other copies carry the NOP flag. If two such answers come without a sign that the chip
//! rejected a packet, the command ran and its only answer was damaged. A read-only command is then sent again under a
//! new index; any other command is not. The next command has the next index.
//!
//! # How to read it
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`Host`]: the functions that a program calls |
//! | `wires.rs` | [`Wires`], and a step of the driver over them |
//! | `next.rs` | the choice of the next packet |
//! | `received.rs` | the interpretation of an answer |
//! | `complete.rs` | the effects of a packet's end on its command or process data |
//! | `flight.rs` | the packet in flight |
//! | `receive_buffer.rs` | the received packet, and the TxPDOs |
//! | `commands.rs`, `slots.rs` | commands and their results, as a program queues and takes them; the queues |
//! | `process.rs` | process data; `fifo.rs`: the free entries of the RxFIFO |
//! | `search.rs`, `start.rs` | the search for n and the beginning of packets; the steps of the start |
//! | `coverage.rs` | the bytes that a CRC-32 covers, found by trying |
//! | `pace.rs` | idle time and INT0 |
//! | `budget.rs` | the duration of an exchange, and the n for process data |
//! | `config.rs`, `error.rs`, `counters.rs` | settings, errors, counters |

mod budget;
mod commands;
mod complete;
mod config;
mod counters;
mod coverage;
mod error;
mod fifo;
mod flight;
mod next;
mod pace;
mod process;
mod receive_buffer;
mod received;
mod search;
mod slots;
mod start;
mod wires;

pub use budget::{Budget, BudgetError, COMFORTABLE_SIZE};
pub use config::{HostConfig, HostPacing, Timeouts};
pub use counters::HostCounters;
pub use error::HostError;
pub use process::{ProcessKind, ProcessOutcome, ProcessReport, ProcessRequest};
pub use slots::{IMMEDIATE_SLOTS, NON_IMMEDIATE_SLOTS, SLOT_BYTES, Ticket};
pub use start::StartStep;
pub use wires::{StepError, Wires};

use super::response::FirmwareVersion;
use super::{
    AnswerHeader, CheckRule, CheckType, CommandCode, CrcCoverages, DataSize, Errors, HEADER_LEN, Interrupts,
    MAX_PACKET, PacketError,
};
use crate::ethercat::Ns;
use coverage::CoverageSearch;
use fifo::RxFreeEstimate;
use flight::Flight;
use pace::HostPacer;
use process::Process;
use receive_buffer::ReceiveBuffer;
use search::Search;
use slots::CommandSlots;

/// What the owner of the wires has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next<'h> {
    /// Clock these bytes out, and pass the same number of received bytes to [`Host::received`]; if the exchange failed,
    /// pass none.
    Exchange(&'h [u8]),
    /// Send nothing before this time, unless a command or process data are submitted earlier.
    WaitUntil(Ns),
    /// Wait for the edge of INT0, to be reported with [`Host::ready`].
    WaitForReady {
        /// The time at which the wait ends if INT0 does not become active.
        until: Ns,
    },
}

/// Whether the driver starts the chip, runs, searches for packets or has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostState {
    /// The chip is being started; commands wait in their queues.
    Starting(StartStep),
    /// The chip is started, and the driver sends queued commands and process data.
    Running,
    /// The driver searches for packets, since too many answers in a row were damaged. It continues afterwards.
    Searching,
    /// The driver has stopped; [`Host::restart`] starts it again.
    Stopped(HostError),
}

/// The content of the present exchange, whose received bytes are still to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PendingExchange {
    Filler,
    Packet,
}

/// The driver of a host for one chip. Its size is about 13 kB, and it allocates nothing.
#[derive(Clone, Debug)]
pub struct Host {
    config: HostConfig,
    state: HostState,
    size: DataSize,
    /// How the check word of a command is computed: its type, and the bytes that a CRC-32 covers.
    rule: CheckRule,
    coverages: CoverageSearch,
    /// Whether CRC-32 was given up because it fits no known coverage.
    gave_crc_up: bool,
    /// Whether the chip has been set to CRC-32, so that an answer with the fixed word shows a reset of the chip.
    crc_on: bool,
    started: Ns,
    search: Search,
    pacer: HostPacer,
    slots: CommandSlots,
    process: Process,
    rx_estimate: RxFreeEstimate,
    flight: Option<Flight>,
    /// Two packet buffers: `current` is the index of the packet being sent; the outputs of the next process data are
    /// written into the other buffer.
    packets: [[u8; MAX_PACKET]; 2],
    current: usize,
    receive_buffer: ReceiveBuffer,
    index: u8,
    exchange: u64,
    /// The number of the exchange in which the newest answer was received.
    answered: u64,
    pending_exchange: Option<PendingExchange>,
    /// Whether INT0 has become active since the present exchange began. The pacer takes it into account when the owner
    /// of the wires reports the end of the exchange.
    ready_seen: bool,
    header: Option<AnswerHeader>,
    /// The header of the first answer since the driver was created, for [`Self::found`].
    found: Option<AnswerHeader>,
    /// Number of packets that the chip rejected, as far as its answers show.
    rejections: u64,
    bad_in_row: u32,
    last_error: Option<PacketError>,
    /// Index, code and number of copies of the packets in the last two exchanges, the older one first.
    sent: [(u8, CommandCode, u32); 2],
    /// Whether the newest answer belongs to the packet of the previous exchange. If so, the chip was ready for that
    /// packet, and with pipelined writes the next process data may follow. False if more than two copies of that packet
    /// were sent, since the answer cannot be assigned to one of them.
    in_step: bool,
    /// Whether the error bits of `header` include the effects of all packets sent so far. False from the sending of a
    /// packet until its answer has come.
    bits_known: bool,
    /// Whether the chip is busy with a non-immediate command, or may be.
    busy: bool,
    /// The number of the exchange whose answer showed that the non-immediate command was accepted.
    accepted: u64,
    /// Error bits that stay set although the driver has tried several times to clear them. They are ignored until they
    /// disappear.
    stuck: Errors,
    clear_tries: u32,
    /// The error bits that the driver tries to clear at present; `clear_tries` is the number of attempts since the
    /// newest of them was added.
    cleared: Errors,
    /// Whether the last packet other than INFO_UPDATE was process data. If so, a waiting command has its turn before
    /// the next process data.
    process_last: bool,
    /// The time at which the last packet was answered or its timeout passed. The interval to the next poll of the
    /// header begins at this time.
    completed_at: Ns,
    /// The GPIO outputs that the header of each packet carries; `None` if the program has set none.
    gpio_outputs: Option<u16>,
    /// The interrupt flags that the header of the next packet clears: first the flags of the chip, then the flags of
    /// GPIO 0 to 15.
    interrupts_to_clear: (Interrupts, u16),
    version: Option<FirmwareVersion>,
    counters: HostCounters,
}

impl Host {
    /// A driver that begins to start the chip at the time `now`.
    pub fn new(now: Ns, config: HostConfig) -> Self {
        let mut host = Self {
            state: HostState::Searching,
            size: config.size.unwrap_or(DataSize::MANUAL),
            rule: CheckRule::FIXED,
            coverages: CoverageSearch::new(config.coverages),
            gave_crc_up: false,
            crc_on: false,
            started: now,
            search: Search::new(now),
            pacer: HostPacer::new(&config),
            slots: CommandSlots::new(),
            process: Process::new(),
            rx_estimate: RxFreeEstimate::new(config.rx_entries),
            flight: None,
            packets: [[0; MAX_PACKET]; 2],
            current: 0,
            receive_buffer: ReceiveBuffer::new(),
            index: 0,
            exchange: 0,
            answered: 0,
            pending_exchange: None,
            ready_seen: false,
            header: None,
            found: None,
            rejections: 0,
            bad_in_row: 0,
            last_error: None,
            sent: [(0, CommandCode::InfoUpdate, 0); 2],
            in_step: false,
            bits_known: false,
            busy: true,
            accepted: 0,
            stuck: Errors::NONE,
            clear_tries: 0,
            cleared: Errors::NONE,
            process_last: false,
            completed_at: now,
            gpio_outputs: None,
            interrupts_to_clear: (Interrupts::NONE, 0),
            version: None,
            counters: HostCounters::default(),
            config,
        };
        host.begin_start(now);
        host
    }

    /// Starts the chip again. Pending commands end with [`HostError::ChipReset`]; counters continue.
    pub fn restart(&mut self, now: Ns) {
        self.begin_start(now);
        // An exchange may just have ended, so the chip needs its idle time.
        self.pacer.hold(now.saturating_add(self.config.idle_ns));
    }

    fn begin_start(&mut self, now: Ns) {
        if matches!(self.state, HostState::Stopped(_)) {
            // After a stop another chip may be connected, whose coverages are unknown.
            self.coverages = CoverageSearch::new(self.config.coverages);
        }
        self.forget_all();
        self.pending_exchange = None;
        self.pacer = HostPacer::new(&self.config);
        self.started = now;
        self.bad_in_row = 0;
        match self.config.size {
            Some(size) => {
                self.size = size;
                self.state = HostState::Starting(StartStep::CheckType);
            }
            None => self.begin_search(now, HostState::Starting(StartStep::Search)),
        }
    }

    /// Sets the interval at which the header is polled while there is nothing else to do: [`HostConfig::poll_ns`].
    pub const fn set_poll_ns(&mut self, poll_ns: Ns) {
        self.config.poll_ns = poll_ns;
    }

    /// Sets the interval at which the header is polled while a non-immediate command runs:
    /// [`HostConfig::busy_poll_ns`].
    pub const fn set_busy_poll_ns(&mut self, busy_poll_ns: Ns) {
        self.config.busy_poll_ns = busy_poll_ns;
    }

    /// Makes the driver search for the chip's data segment size n at the next start and not change it:
    /// [`HostConfig::size`] and [`HostConfig::wanted_size`] become `None`.
    pub const fn keep_size(&mut self) {
        (self.config.size, self.config.wanted_size) = (None, None);
    }

    /// Starts the chip again and sets it to another data segment size n (SPI_RECONFIG_OP). As after every start without
    /// [`HostConfig::keep_fifo`], the RxFIFO is off and empty afterwards; the driver's value for the number of its
    /// entries stays. An ECM-XFU refuses this.
    pub fn resize(&mut self, now: Ns, size: DataSize) {
        (self.config.size, self.config.wanted_size) = (Some(self.size), Some(size));
        let entries = self.rx_estimate.entries;
        self.restart(now);
        self.rx_estimate = RxFreeEstimate::new(entries);
    }

    /// The settings of the driver, with all changes made since it was created.
    pub const fn config(&self) -> &HostConfig {
        &self.config
    }

    /// Whether the driver starts the chip, runs, searches for packets or has stopped; with the error if it has stopped.
    pub const fn state(&self) -> HostState {
        self.state
    }

    /// The n (size of the data segment) of packets; before it is found, the driver's assumption.
    pub const fn size(&self) -> DataSize {
        self.size
    }

    /// The present check type of packets: the fixed word before CRC-32 was set and if [`Self::gave_crc_up`], otherwise
    /// CRC-32.
    pub const fn check(&self) -> CheckType {
        self.rule.kind
    }

    /// Which bytes a CRC-32 covers, as far as that was found.
    pub fn coverages(&self) -> CrcCoverages {
        self.coverages.coverages()
    }

    /// Whether the chip was set back to the fixed check word because its CRC-32 fits no known coverage. Bit errors on
    /// the wire and resets of the chip then go unnoticed.
    pub const fn gave_crc_up(&self) -> bool {
        self.gave_crc_up
    }

    /// The header of the newest answer, with errors, FIFO levels, interrupt flags and GPIO. `None` before the first
    /// answer since the driver last began to start the chip.
    pub const fn header(&self) -> Option<&AnswerHeader> {
        self.header.as_ref()
    }

    /// The header of the first answer since the driver was created, before the start has cleared errors. If the driver
    /// searched for packets, the chip has counted the bytes of the search as one or two packets with a wrong start or
    /// end word. `None` before the first answer.
    pub const fn found(&self) -> Option<&AnswerHeader> {
        self.found.as_ref()
    }

    /// The firmware version that the chip reported at the start; `None` before that.
    pub const fn version(&self) -> Option<FirmwareVersion> {
        self.version
    }

    /// The numbers of exchanges, errors and process data since the driver was created.
    pub const fn counters(&self) -> HostCounters {
        self.counters
    }

    /// Sets the outputs of GPIO 0 to 15 that the header of every packet carries from now on, as in
    /// [`CommandHeader::gpio_outputs`](super::CommandHeader::gpio_outputs); `None`, the initial value, sets none.
    pub const fn set_gpio_outputs(&mut self, outputs: Option<u16>) {
        self.gpio_outputs = outputs;
    }

    /// Clears these interrupt flags with the next packet: `chip` are flags of the chip, and bit k of `gpio` is the flag
    /// of GPIO k.
    pub fn clear_interrupts(&mut self, chip: Interrupts, gpio: u16) {
        let (chip_before, gpio_before) = self.interrupts_to_clear;
        self.interrupts_to_clear = (chip_before | chip, gpio_before | gpio);
    }

    /// Reports that INT0 has become active.
    pub fn ready(&mut self, _now: Ns) {
        match self.pending_exchange {
            Some(_) => self.ready_seen = true,
            None => self.pacer.ready(),
        }
    }

    /// The number of entries of the RxFIFO, as far as the driver knows.
    pub const fn rx_entries(&self) -> u8 {
        self.rx_estimate.entries
    }

    /// Submits process data for the next exchange. Returns their sequence number, with which [`Self::take_report`]
    /// reports their outcome.
    ///
    /// # Errors
    /// Earlier process data are still waiting, the data are longer than the data segment, the RxFIFO may have no room
    /// ([`Self::rx_free`]), or the driver has stopped; then the error is the reason of the stop.
    pub fn process(&mut self, data: ProcessRequest<'_>) -> Result<u32, HostError> {
        let (kind, outputs) = data.parts();
        self.process_in_place(kind, outputs.len(), |place| place.copy_from_slice(outputs))
    }

    /// Like [`Self::process`], for a program whose outputs are in pieces: `write` gets the `len` bytes of the next
    /// packet that carry the RxPDOs. They have old content, so `write` has to set each byte. It is not called if there
    /// is an error.
    ///
    /// # Errors
    /// As with [`Self::process`].
    pub fn process_in_place(
        &mut self,
        kind: ProcessKind,
        len: usize,
        write: impl FnOnce(&mut [u8]),
    ) -> Result<u32, HostError> {
        self.running_or_error()?;
        let (needed, free) = (kind.queued(), self.rx_estimate.free());
        if needed > free {
            return Err(HostError::FifoFull { needed, free });
        }
        let segment = &mut self.packets[1 - self.current][HEADER_LEN..][..self.size.bytes()];
        self.process.submit(kind, len, segment, write)
    }

    /// The number of RxFIFO entries that are certainly free. The chip's counts lag two exchanges behind, so recent
    /// writes are subtracted.
    pub fn rx_free(&self) -> u8 {
        self.rx_estimate.free()
    }

    /// Takes the oldest report about the outcome of process data. The driver keeps 4 reports.
    pub fn take_report(&mut self) -> Option<ProcessReport> {
        self.process.take_report()
    }

    /// The TxPDOs of the newest answer that contained any; empty before the first such answer.
    pub fn inputs(&self) -> &[u8] {
        self.receive_buffer.inputs()
    }
}
