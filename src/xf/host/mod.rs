//! The driver of a host for the chip: which bytes to exchange next, and what the bytes that came back mean.
//!
//! It is pure: the time is an argument, bytes go in and out, nothing waits, nothing is allocated, no thread is started.
//! Who owns the wires asks [`Host::next`] what to do, does it, and gives [`Host::received`] what came back. [`Host::step`]
//! is that for wires that implement [`Wires`]:
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
//! Meanwhile commands are submitted at any time ([`Host::submit`], [`Host::submit_pair`]) and their results taken
//! ([`Host::take`]); process data have a way of their own ([`Host::process`], [`Host::take_report`], [`Host::inputs`]).
//!
//! # No command runs twice
//!
//! A packet is sent in every exchange until its answer is there. The chip takes the second of two consecutive packets
//! with the same index and code for INFO_UPDATE, so that the command runs once, whichever of the copies arrives whole,
//! and the answers to the others carry the NOP flag. Two of those without a sign that the chip rejected a packet say
//! that the command ran and its one answer was damaged: what only reads is asked again under a new index, anything else
//! never. The next command has the next index.
//!
//! # How to read it
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`Host`]: what a program calls |
//! | `wires.rs` | [`Wires`], and a step of the driver over them |
//! | `next.rs` | what is sent next |
//! | `received.rs` | what an answer means |
//! | `settle.rs` | what the end of a packet means for whom it was sent for |
//! | `flight.rs` | the packet that waits for its answer |
//! | `inbox.rs` | what came back, and the TxPDOs |
//! | `slots.rs` | the queues of commands |
//! | `process.rs` | process data; `fifo.rs`: the room in the RxFIFO |
//! | `search.rs`, `start.rs` | n and the beginning of packets; the steps of the start |
//! | `coverage.rs` | what a CRC-32 covers, found by trying |
//! | `pace.rs` | idle time and INT0 |
//! | `budget.rs` | what an exchange costs, and the n for process data |
//! | `config.rs`, `error.rs`, `counters.rs` | numbers to change, what goes wrong, what is counted |

mod budget;
mod config;
mod counters;
mod coverage;
mod error;
mod fifo;
mod flight;
mod inbox;
mod next;
mod pace;
mod process;
mod received;
mod search;
mod settle;
mod slots;
mod start;
mod wires;

pub use budget::{Budget, BudgetError, COMFORTABLE_SIZE};
pub use config::{Deadlines, HostConfig, Pacing};
pub use counters::Counters;
pub use error::HostError;
pub use process::{ProcessData, ProcessKind, ProcessOutcome, ProcessReport};
pub use slots::{IMMEDIATE_SLOTS, NON_IMMEDIATE_SLOTS, SLOT_BYTES, Ticket};
pub use start::StartStep;
pub use wires::{StepError, Wires};

use super::response::FirmwareVersion;
use super::{
    AnswerHeader, Call, CheckRule, CheckType, CommandCode, Coverages, DataSize, Errors, HEADER_LEN, Interrupts,
    MAX_PACKET, PacketError,
};
use crate::ethercat::Ns;
use coverage::CoverageSearch;
use fifo::RxRoom;
use flight::Flight;
use inbox::Inbox;
use pace::Pacer;
use process::Process;
use search::Search;
use slots::{SlotState, Slots};

/// What to do now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next<'h> {
    /// Clock these bytes out, and give [`Host::received`] as many that came back. If the exchange failed, give it none.
    Exchange(&'h [u8]),
    /// Nothing before this time, unless something is submitted.
    WaitUntil(Ns),
    /// Nothing before INT0's edge, which [`Host::ready`] takes, or this time.
    WaitForReady {
        /// Until then at the latest.
        until: Ns,
    },
}

/// How far the driver is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostState {
    /// The chip is being started; commands wait in their queues.
    Starting(StartStep),
    /// Commands are sent.
    Running,
    /// Packets are searched, since too many answers were damaged one after the other. It goes on afterwards.
    Searching,
    /// The driver has stopped; [`Host::restart`] begins anew.
    Stopped(HostError),
}

/// What the last exchange was for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outstanding {
    Filler,
    Packet,
}

/// The driver. About 13 kB, all of it in itself.
#[derive(Clone, Debug)]
pub struct Host {
    config: HostConfig,
    state: HostState,
    size: DataSize,
    /// How the check words of commands are made.
    rule: CheckRule,
    coverages: CoverageSearch,
    /// CRC-32 was given up: it covers nothing that is known.
    gave_crc_up: bool,
    /// The chip has been set to CRC-32: an answer with the fixed word shows that it was reset.
    crc_on: bool,
    started: Ns,
    search: Search,
    pacer: Pacer,
    slots: Slots,
    process: Process,
    room: RxRoom,
    flight: Option<Flight>,
    /// The packet that goes out, which `current` says, and the one that the outputs of the next process data stand in.
    packets: [[u8; MAX_PACKET]; 2],
    current: usize,
    inbox: Inbox,
    index: u8,
    exchange: u64,
    /// The exchange of the newest answer.
    answered: u64,
    outstanding: Option<Outstanding>,
    /// INT0 came after the exchange that is outstanding.
    ready_seen: bool,
    header: Option<AnswerHeader>,
    /// The header of the first answer.
    found: Option<AnswerHeader>,
    /// Packets that the chip rejected, as far as was seen.
    rejections: u64,
    bad_in_row: u32,
    last_error: Option<PacketError>,
    /// Index, code and copies so far of the packets of the last two exchanges, the older one first.
    sent: [(u8, CommandCode, u32); 2],
    /// The answer of the last exchange is that to the packet of the one before: the chip was ready and lags no further.
    /// Of more than two copies nobody knows to which of them an answer is.
    in_step: bool,
    /// The error bits of `header` are those behind all packets that were sent: none ended without its answer since then.
    bits_known: bool,
    /// The chip is busy, or may be.
    busy: bool,
    /// The exchange in which the non-immediate command was seen to be accepted.
    accepted: u64,
    /// Errors that do not go away when they are cleared, and how often that was tried.
    stuck: Errors,
    clear_tries: u32,
    /// Those for which these tries were.
    cleared: Errors,
    /// The last packet that was no INFO_UPDATE was process data.
    process_last: bool,
    /// When the last packet was done.
    settled: Ns,
    /// What the header of each packet puts out.
    gpio_outputs: Option<u16>,
    /// What the header of the next packet clears: of the chip, of GPIO.
    interrupts_to_clear: (Interrupts, u16),
    version: Option<FirmwareVersion>,
    counters: Counters,
}

impl Host {
    /// A driver that starts the chip, from time `now` on.
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
            pacer: Pacer::new(&config),
            slots: Slots::new(),
            process: Process::new(),
            room: RxRoom::new(config.rx_entries),
            flight: None,
            packets: [[0; MAX_PACKET]; 2],
            current: 0,
            inbox: Inbox::new(),
            index: 0,
            exchange: 0,
            answered: 0,
            outstanding: None,
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
            settled: now,
            gpio_outputs: None,
            interrupts_to_clear: (Interrupts::NONE, 0),
            version: None,
            counters: Counters::default(),
            config,
        };
        host.begin_start(now);
        host
    }

    /// Starts the chip anew. Commands that are not done end with [`HostError::ChipReset`]; counters go on.
    pub fn restart(&mut self, now: Ns) {
        self.begin_start(now);
        // An exchange may have ended just now.
        self.pacer.hold(now.saturating_add(self.config.idle_ns));
    }

    fn begin_start(&mut self, now: Ns) {
        if matches!(self.state, HostState::Stopped(_)) {
            // It may be another chip.
            self.coverages = CoverageSearch::new(self.config.coverages);
        }
        self.forget_all();
        self.outstanding = None;
        self.pacer = Pacer::new(&self.config);
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

    /// How often the header is asked for while there is nothing else to do: [`HostConfig::poll_ns`].
    pub const fn set_poll_ns(&mut self, poll_ns: Ns) {
        self.config.poll_ns = poll_ns;
    }

    /// How often the header is asked for while a non-immediate command runs: [`HostConfig::busy_poll_ns`].
    pub const fn set_busy_poll_ns(&mut self, busy_poll_ns: Ns) {
        self.config.busy_poll_ns = busy_poll_ns;
    }

    /// From the next start on the chip keeps the n that it is found with: [`HostConfig::wanted_size`] is `None`.
    pub const fn keep_size(&mut self) {
        (self.config.size, self.config.wanted_size) = (None, None);
    }

    /// Starts anew with another n, to which the chip is set (SPI_RECONFIG_OP). As with every start, the RxFIFO is off and
    /// empty afterwards, with the entries that it had; an ECM-XFU refuses.
    pub fn resize(&mut self, now: Ns, size: DataSize) {
        (self.config.size, self.config.wanted_size) = (Some(self.size), Some(size));
        let entries = self.room.entries;
        self.restart(now);
        self.room = RxRoom::new(entries);
    }

    /// The configuration, as it is now.
    pub const fn config(&self) -> &HostConfig {
        &self.config
    }

    /// How far the driver is.
    pub const fn state(&self) -> HostState {
        self.state
    }

    /// The n of packets; before it is found, what the driver takes it for.
    pub const fn size(&self) -> DataSize {
        self.size
    }

    /// The check word that packets have now. It is the fixed one before CRC-32 was set, and where [`Self::gave_crc_up`].
    pub const fn check(&self) -> CheckType {
        self.rule.kind
    }

    /// What a CRC-32 covers, as far as it was found.
    pub fn coverages(&self) -> Coverages {
        self.coverages.coverages()
    }

    /// Whether the chip was set back to the fixed check word, since its CRC-32 covers nothing that is known. Bits that flip on the
    /// wires go unnoticed then, and so does a reset of the chip.
    pub const fn gave_crc_up(&self) -> bool {
        self.gave_crc_up
    }

    /// The header of the newest answer: errors, levels, interrupt flags, GPIO. `None` before the first one.
    pub const fn header(&self) -> Option<&AnswerHeader> {
        self.header.as_ref()
    }

    /// The header of the first answer since the driver was made, before the start has cleared errors. Where packets were
    /// searched, the chip has counted that as a packet or two with wrong words. `None` before the first answer.
    pub const fn found(&self) -> Option<&AnswerHeader> {
        self.found.as_ref()
    }

    /// What the chip said about itself at the start.
    pub const fn version(&self) -> Option<FirmwareVersion> {
        self.version
    }

    /// What was counted.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// What the header of every packet puts out on GPIO 0 to 15 from now on, as
    /// [`CommandHeader::gpio_outputs`](super::CommandHeader::gpio_outputs) has it; `None`, as at first: nothing.
    pub const fn set_gpio_outputs(&mut self, outputs: Option<u16>) {
        self.gpio_outputs = outputs;
    }

    /// The next packet that is made clears these interrupt flags: those of the chip, and those of GPIO 0 to 15 as bits.
    pub fn clear_interrupts(&mut self, chip: Interrupts, gpio: u16) {
        let (chip_before, gpio_before) = self.interrupts_to_clear;
        self.interrupts_to_clear = (chip_before | chip, gpio_before | gpio);
    }

    /// INT0 has become active.
    pub fn ready(&mut self, _now: Ns) {
        match self.outstanding {
            Some(_) => self.ready_seen = true,
            None => self.pacer.ready(),
        }
    }

    /// Puts a command into its queue: one for immediate commands, one for the others, of which one runs at a time while
    /// immediate ones go on.
    ///
    /// # Errors
    /// The queue is full, the command is too long or one of the driver's own, its data are not what the chip takes, or
    /// the driver has stopped, for the reason that is told.
    pub fn submit<'d, C: Call<'d>>(&mut self, now: Ns, call: &C) -> Result<Ticket, HostError> {
        self.submit_within(now, call, self.config.deadlines.busy_ns)
    }

    /// As [`Self::submit`], with `busy_ns` for the time in nanoseconds that a non-immediate command may run, as for
    /// files and for the network's initialisation.
    ///
    /// # Errors
    /// As with [`Self::submit`].
    pub fn submit_within<'d, C: Call<'d>>(&mut self, now: Ns, call: &C, busy_ns: Ns) -> Result<Ticket, HostError> {
        self.running_or_error()?;
        self.room_for(call)?;
        self.slots.submit(now, busy_ns, call, None)
    }

    /// Puts two commands into the queue of which the second one reads the result of the first: SDO_REQ and SDO_GET,
    /// PDO_CONFIG_REQ and _GET, EEPROM_REQ and _GET, RAW_ECAT_FUNC_REQ and _GET, FOE_FUNC_REQ and _GET, STATE_UPDATE
    /// and STATE_GET. Nothing else that would change the result runs between them. The ticket is that of the second
    /// one; if the first one fails, that is the result.
    ///
    /// # Errors
    /// As with [`Self::submit`]; or the second command does not just read.
    pub fn submit_pair<'d, 'e, C: Call<'d>, R: Call<'e>>(
        &mut self,
        now: Ns,
        call: &C,
        read: &R,
        busy_ns: Ns,
    ) -> Result<Ticket, HostError> {
        self.running_or_error()?;
        let read = slots::read_of(read)?;
        self.room_for(call)?;
        self.slots.submit(now, busy_ns, call, Some(read))
    }

    /// Whether the command of a ticket is done. A ticket whose result was taken is.
    pub fn is_done(&self, ticket: Ticket) -> bool {
        let slot = &self.slots.all[ticket.slot];
        slot.sequence != ticket.sequence || matches!(slot.state, SlotState::Free | SlotState::Done(_))
    }

    /// The result of a command, which makes its place in the queue free; `None` while it is not done. `call` is what
    /// was submitted, of a pair the second one.
    pub fn take<'h, 'd, C: Call<'d>>(
        &'h mut self,
        ticket: Ticket,
        call: &C,
    ) -> Option<Result<C::Answer<'h>, HostError>> {
        let slot = &mut self.slots.all[ticket.slot];
        if slot.sequence != ticket.sequence || slot.state == SlotState::Free {
            return Some(Err(HostError::UnknownTicket));
        }
        let expected = slot.answering();
        let parameter = slot.read.map_or(slot.arguments, |read| read.arguments).parameter;
        if expected != C::CODE || C::FUNCTION.is_some_and(|function| function != parameter) {
            return Some(Err(HostError::OtherCommand { expected, found: C::CODE }));
        }
        let SlotState::Done(result) = slot.state else { return None };
        slot.state = SlotState::Free;
        let slot = &self.slots.all[ticket.slot];
        let decode = || {
            slots::whole(slot)?;
            Ok(call.answer(slot.returned, &slot.bytes[..slot.held])?)
        };
        Some(result.and_then(|()| decode()))
    }

    /// Drops a command whose result nobody will take: its place in the queue is free once it is done. One that was not
    /// sent yet is not sent any more.
    pub fn abandon(&mut self, ticket: Ticket) {
        let slot = &mut self.slots.all[ticket.slot];
        if slot.sequence == ticket.sequence {
            slot.abandon();
        }
    }

    /// Drops all commands, as [`Self::abandon`] does, and all results: for what has to go before everything else.
    pub fn abandon_all(&mut self) {
        self.slots.all.iter_mut().for_each(slots::Slot::abandon);
    }

    /// The entries of the RxFIFO, as far as the driver knows.
    pub const fn rx_entries(&self) -> u8 {
        self.room.entries
    }

    /// Takes process data for the next exchange and gives the number by which [`Self::take_report`] tells what became
    /// of them.
    ///
    /// # Errors
    /// Others are waiting, the data are longer than n, the RxFIFO may have no room ([`Self::rx_free`]), or the driver has
    /// stopped, for the reason that is told.
    pub fn process(&mut self, data: ProcessData<'_>) -> Result<u32, HostError> {
        let (kind, outputs) = data.parts();
        self.process_in_place(kind, outputs.len(), |place| place.copy_from_slice(outputs))
    }

    /// As [`Self::process`], for a program that has its outputs in pieces: `write` is given the `len` bytes of the next
    /// packet in which the RxPDOs go out, with whatever stood there before, and has to write each of them. It is not
    /// called if there is an error.
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
        let (needed, free) = (kind.queued(), self.room.free());
        if needed > free {
            return Err(HostError::FifoFull { needed, free });
        }
        let segment = &mut self.packets[1 - self.current][HEADER_LEN..][..self.size.bytes()];
        self.process.submit(kind, len, segment, write)
    }

    /// How many PDOs the RxFIFO has room for at least. The chip's counts lag two exchanges behind: what has been
    /// written since is taken off.
    pub fn rx_free(&self) -> u8 {
        self.room.free()
    }

    /// What became of process data, the oldest first. 4 reports are kept.
    pub fn take_report(&mut self) -> Option<ProcessReport> {
        self.process.take_report()
    }

    /// The TxPDOs of the last answer that had any.
    pub fn inputs(&self) -> &[u8] {
        self.inbox.inputs()
    }

    /// Whether a command fits into a packet, once n is known.
    fn room_for<'d, C: Call<'d>>(&self, call: &C) -> Result<(), HostError> {
        let found = usize::from(call.encode(&mut [0; SLOT_BYTES])?.len);
        let most = self.size.bytes();
        if self.state == HostState::Running && found > most && C::CODE != CommandCode::SpiReconfig {
            return Err(HostError::TooLong { code: C::CODE, found, most });
        }
        Ok(())
    }
}
