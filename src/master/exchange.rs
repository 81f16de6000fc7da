//! The frame layer: assigns indices to frames, matches answers with frames, and handles lost frames.
//!
//! Each frame has one of 256 indices, which all its datagrams carry. An answer is accepted if its frame is in flight
//! and each datagram has the command, length and address that were sent, except for address bits that slaves change.
//! All other frames are counted and dropped. The index of a lost frame is not reused for a while: otherwise the late
//! answer of that frame could be taken for the answer of a newer frame.

use std::collections::VecDeque;

use super::{Settings, Wire};
use crate::ethercat::{
    Addressing, Command, DATA_LEN_MAX, DATAGRAM_OVERHEAD, Datagram, DatagramHeader, FRAME_HEADER_LEN, FRAME_LEN_MAX,
    FRAME_LEN_MIN, Frame, FrameHeader, FrameWriter, MAX_SLAVES, Ns,
};

/// \[OURS] The number of frames that may be in flight.
const FLIGHTS: usize = 32;
/// \[OURS] How many acyclic datagrams have preallocated memory. Short datagrams: for each slave one of the watch, one
/// of a change of state and one of an abandoned change, and some more. Long datagrams: two for each mailbox, and some
/// more.
const SHORT_REQUESTS: usize = 3 * MAX_SLAVES + 16;
const LONG_REQUESTS: usize = 2 * MAX_SLAVES + 16;
/// \[OURS] The most bytes of data in a short datagram. Register accesses have fewer.
const SHORT_LEN: usize = 64;
/// \[OURS] The most acyclic datagrams in a frame.
const DATAGRAMS_MAX: usize = 64;

/// Counters of the frames of a master, by what happened to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Frames that were sent.
    pub sent: u64,
    /// Frames that the wire did not accept for sending.
    pub unsent: u64,
    /// Frames that came back.
    pub answered: u64,
    /// Frames that did not come back in time, including those that the wire did not accept.
    pub lost: u64,
    /// Lost frames that came back after the timeout.
    pub late: u64,
    /// Frames that came back a second time.
    pub doubled: u64,
    /// Frames with an index in use whose datagrams are not those that were sent.
    pub mismatched: u64,
    /// Frames with an index that this master has not used yet.
    pub unknown: u64,
    /// Frames of another master: their source address is not that of this master, with or without the bit that slaves
    /// set.
    pub foreign: u64,
    /// Frames of this master that came back without having passed a slave.
    pub unpassed: u64,
    /// Received frames that are not valid EtherCAT frames with datagrams.
    pub malformed: u64,
}

/// No frame came back in any of the tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lost;

/// The state of a frame index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum IndexUse {
    Free,
    /// The frame has come back, and the index was not reused since.
    Answered,
    /// The frame is in flight. The value is its index in `flights`.
    Flying(usize),
    /// The frame was lost. The index may be reused from `until` on.
    Resting {
        until: Ns,
    },
}

/// The receiver of a datagram's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    Request(usize),
    /// A datagram of the process data cycle, with its number in that cycle.
    Cycle(u8),
}

/// A datagram of a frame in flight.
#[derive(Clone, Copy, Debug)]
struct Sent {
    command: Command,
    address: u32,
    len: u16,
    owner: Owner,
}

impl Sent {
    /// Whether `header` can belong to the answer of this datagram. Slaves change the position in the address of some
    /// commands.
    fn is_answered_by(&self, header: &DatagramHeader) -> bool {
        let kept = match self.command.addressing() {
            Addressing::Position | Addressing::Broadcast => 0xFFFF_0000,
            _ => u32::MAX,
        };
        header.command == self.command && header.len == self.len && (header.address ^ self.address) & kept == 0
    }
}

/// A frame in flight, with the datagrams whose answers it brings back.
#[derive(Debug, Default)]
struct Flight {
    is_used: bool,
    is_cyclic: bool,
    index: u8,
    expires: Ns,
    datagrams: Vec<Sent>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum RequestState {
    #[default]
    Unused,
    Queued,
    Flying,
    /// The frame has come back. The field is the working counter of the datagram.
    Answered(u16),
    Lost,
}

/// An acyclic datagram: one that is not part of a cycle.
#[derive(Debug)]
struct Request {
    state: RequestState,
    command: Command,
    address: u32,
    data: Vec<u8>,
    /// Whether `data` has capacity for more than [`SHORT_LEN`] bytes.
    is_long: bool,
    /// How many more times the datagram may be sent.
    tries: u8,
    /// Whether the ticket was dropped, so that nothing waits for the answer.
    is_abandoned: bool,
}

impl Request {
    /// An unused request with memory for a long or a short datagram.
    fn new(is_long: bool) -> Self {
        let (state, command) = (RequestState::Unused, Command::Nop);
        let data = Vec::with_capacity(if is_long { DATA_LEN_MAX } else { SHORT_LEN });
        Self { state, command, address: 0, data, is_long, tries: 0, is_abandoned: false }
    }
}

/// The unused requests, by their indices in `requests`.
#[derive(Debug)]
struct Unused {
    short: Vec<usize>,
    long: Vec<usize>,
}

impl Unused {
    const fn of(&mut self, is_long: bool) -> &mut Vec<usize> {
        if is_long { &mut self.long } else { &mut self.short }
    }

    /// Puts a request that is no longer needed back into the list of unused requests.
    fn take_back(&mut self, number: usize, request: &mut Request) {
        request.state = RequestState::Unused;
        self.of(request.is_long).push(number);
    }
}

/// The frame layer: all frame indices, frames in flight and acyclic datagrams.
#[derive(Debug)]
pub(super) struct Exchange {
    settings: Settings,
    indices: [IndexUse; 256],
    /// The index after the one that was used last. The search for a free index begins there, so that indices are used
    /// in turn.
    next_index: u8,
    flights: Vec<Flight>,
    requests: Vec<Request>,
    unused: Unused,
    queue: VecDeque<usize>,
    buffer: [u8; FRAME_LEN_MAX],
    pub(super) counters: FrameCounters,
    /// The source address of the newest frame of another master.
    pub(super) other_source: Option<[u8; 6]>,
}

/// A frame of the cycle while datagrams are added to it.
pub(super) struct CyclicFrame<'a> {
    writer: FrameWriter<'a>,
    datagrams: &'a mut Vec<Sent>,
    index: u8,
    counters: &'a mut FrameCounters,
}

impl CyclicFrame<'_> {
    /// Adds a datagram. Returns false if it does not fit.
    pub(super) fn push(&mut self, command: Command, address: u32, data: &[u8], number: u8) -> bool {
        let fits = self.writer.push(DatagramHeader::new(command, self.index, address), data).is_ok();
        if fits {
            self.datagrams.push(Sent { command, address, len: data.len() as u16, owner: Owner::Cycle(number) });
        }
        fits
    }

    /// Sends the frame. If the wire refuses it, the frame is counted as not sent, and later as lost.
    pub(super) fn send(self, wire: &mut (impl Wire + ?Sized)) {
        send(wire, self.writer, self.counters);
    }
}

fn send(wire: &mut (impl Wire + ?Sized), writer: FrameWriter<'_>, counters: &mut FrameCounters) {
    match wire.send(writer.finish()) {
        Ok(()) => counters.sent += 1,
        // The wire has not accepted the frame. It stays in flight and is later counted as lost too, like any frame that
        // does not come back.
        Err(_) => counters.unsent += 1,
    }
}

impl Exchange {
    pub(super) fn new(settings: Settings) -> Self {
        let flight = || Flight { datagrams: Vec::with_capacity(DATAGRAMS_MAX), ..Flight::default() };
        let mut exchange = Self {
            settings,
            indices: [IndexUse::Free; 256],
            next_index: 0,
            flights: (0..FLIGHTS).map(|_| flight()).collect(),
            requests: Vec::new(),
            unused: Unused { short: Vec::new(), long: Vec::new() },
            queue: VecDeque::new(),
            buffer: [0; FRAME_LEN_MAX],
            counters: FrameCounters::default(),
            other_source: None,
        };
        exchange.reserve(SHORT_REQUESTS, false);
        exchange.reserve(LONG_REQUESTS, true);
        exchange
    }

    /// Allocates memory for `more` short datagrams in addition to the [`SHORT_REQUESTS`] that [`Self::new`] allocates.
    pub(super) fn reserve_short(&mut self, more: usize) {
        let has = self.requests.iter().filter(|request| !request.is_long).count();
        self.reserve((SHORT_REQUESTS + more).saturating_sub(has), false);
    }

    /// Allocates memory for `more` datagrams: all of them long (`is_long`), or all of them short.
    fn reserve(&mut self, more: usize, is_long: bool) {
        let has = self.requests.len();
        let all = has + more;
        self.requests.extend((0..more).map(|_| Request::new(is_long)));
        self.queue.reserve(all - self.queue.len());
        let unused = self.unused.of(is_long);
        unused.extend(has..all);
        unused.reserve(all - unused.len());
    }

    /// Queues a datagram with at most [`DATA_LEN_MAX`] bytes. Returns its number for [`Self::answer`].
    pub(super) fn request(&mut self, command: Command, address: u32, data: &[u8], tries: u8) -> usize {
        let is_long = data.len() > SHORT_LEN;
        let number = self.unused.of(is_long).pop().unwrap_or_else(|| {
            self.reserve(1, is_long);
            self.unused.of(is_long).pop().unwrap_or_default()
        });
        let request = &mut self.requests[number];
        (request.command, request.address) = (command, address);
        request.data.clear();
        request.data.extend_from_slice(&data[..data.len().min(DATA_LEN_MAX)]);
        (request.tries, request.is_abandoned, request.state) = (tries.max(1), false, RequestState::Queued);
        self.queue.push_back(number);
        number
    }

    /// The working counter of an answer, whose data are copied into `data`; `None`: it has not come yet.
    pub(super) fn answer(&self, number: usize, data: &mut [u8]) -> Option<Result<u16, Lost>> {
        let request = self.requests.get(number)?;
        match request.state {
            RequestState::Answered(counter) => {
                data.iter_mut().zip(&request.data).for_each(|(byte, came)| *byte = *came);
                Some(Ok(counter))
            }
            RequestState::Lost => Some(Err(Lost)),
            _ => None,
        }
    }

    /// Abandons a datagram: its answer is not needed.
    pub(super) fn release(&mut self, number: usize) {
        let Some(request) = self.requests.get_mut(number) else { return };
        request.is_abandoned = true;
        if matches!(request.state, RequestState::Answered(_) | RequestState::Lost) {
            self.unused.take_back(number, request);
        }
    }

    /// Whether any frame is in flight.
    pub(super) fn is_flying(&self) -> bool {
        self.flights.iter().any(|flight| flight.is_used)
    }

    /// Whether a frame with acyclic datagrams is in flight.
    pub(super) fn is_acyclic_flying(&self) -> bool {
        self.flights.iter().any(|flight| flight.is_used && !flight.is_cyclic)
    }

    /// Claims a frame index, and an unused element of `flights` for its frame. `None`: [`FLIGHTS`] frames are in flight
    /// already.
    fn claim(&mut self, now: Ns, is_cyclic: bool) -> Option<usize> {
        let place = self.flights.iter().position(|flight| !flight.is_used)?;
        let is_free = |index: &u8| match self.indices[usize::from(*index)] {
            IndexUse::Free | IndexUse::Answered => true,
            IndexUse::Flying(_) => false,
            IndexUse::Resting { until } => now >= until,
        };
        // If no index is free because too many frames were lost, the index that was lost first is reused early.
        let is_resting = |index: &u8| matches!(self.indices[usize::from(*index)], IndexUse::Resting { .. });
        let mut all = (0..=u8::MAX).map(|n| self.next_index.wrapping_add(n));
        let index = all.clone().find(is_free).or_else(|| all.find(is_resting))?;
        self.next_index = index.wrapping_add(1);
        self.indices[usize::from(index)] = IndexUse::Flying(place);
        let flight = &mut self.flights[place];
        flight.datagrams.clear();
        (flight.is_used, flight.is_cyclic, flight.index) = (true, is_cyclic, index);
        flight.expires = now.saturating_add(self.settings.frame_timeout_ns);
        Some(place)
    }

    /// Begins a frame of the cycle; `None`: too many frames are in flight.
    pub(super) fn begin_cyclic(&mut self, now: Ns) -> Option<CyclicFrame<'_>> {
        let place = self.claim(now, true)?;
        let Self { flights, buffer, counters, settings, .. } = self;
        let flight = &mut flights[place];
        let writer = FrameWriter::new(buffer, FrameHeader::datagrams(settings.source)).ok()?;
        Some(CyclicFrame { writer, index: flight.index, datagrams: &mut flight.datagrams, counters })
    }

    /// Sends queued datagrams in one frame of at most `bytes_max` bytes, but at least one datagram. Returns whether a
    /// frame was sent.
    pub(super) fn send_queued(&mut self, now: Ns, bytes_max: usize, wire: &mut (impl Wire + ?Sized)) -> bool {
        while let Some(number) = self.queue.front().copied()
            && self.requests[number].is_abandoned
        {
            self.unused.take_back(number, &mut self.requests[number]);
            self.queue.pop_front();
        }
        let Some(first) = self.queue.front() else { return false };
        let needed = FRAME_HEADER_LEN + DATAGRAM_OVERHEAD + self.requests[*first].data.len();
        let bytes_max = bytes_max.max(needed).clamp(FRAME_LEN_MIN, FRAME_LEN_MAX);
        let Some(place) = self.claim(now, false) else { return false };
        let Self { flights, buffer, counters, settings, queue, requests, unused, .. } = self;
        let flight = &mut flights[place];
        let header = FrameHeader::datagrams(settings.source);
        let Ok(mut writer) = FrameWriter::new(&mut buffer[..bytes_max], header) else { return false };
        while let Some(number) = queue.front().copied() {
            let request = &mut requests[number];
            if request.is_abandoned {
                unused.take_back(number, request);
            } else {
                let header = DatagramHeader::new(request.command, flight.index, request.address);
                if flight.datagrams.len() == DATAGRAMS_MAX || writer.push(header, &request.data).is_err() {
                    break;
                }
                let (command, address, len) = (request.command, request.address, request.data.len() as u16);
                flight.datagrams.push(Sent { command, address, len, owner: Owner::Request(number) });
                request.state = RequestState::Flying;
                request.tries -= 1;
            }
            queue.pop_front();
        }
        send(wire, writer, counters);
        true
    }

    /// Handles a received frame. For each datagram of the process data cycle in the frame, calls `cycle` with the
    /// number of the datagram in its cycle.
    pub(super) fn receive(&mut self, bytes: &[u8], mut cycle: impl FnMut(u8, &Datagram<'_>)) {
        let Ok(frame) = Frame::decode(bytes) else {
            self.counters.malformed += 1;
            return;
        };
        let Some(datagrams) = frame.datagrams() else {
            self.counters.malformed += 1;
            return;
        };
        if !self.is_ours(frame.header.source) {
            return;
        }
        let Some(Ok(first)) = datagrams.clone().next() else {
            self.counters.malformed += 1;
            return;
        };
        let index = first.header.index;
        let place = match self.indices[usize::from(index)] {
            IndexUse::Flying(place) => place,
            IndexUse::Free => {
                self.counters.unknown += 1;
                return;
            }
            IndexUse::Answered => {
                self.counters.doubled += 1;
                return;
            }
            IndexUse::Resting { .. } => {
                self.counters.late += 1;
                self.indices[usize::from(index)] = IndexUse::Answered;
                return;
            }
        };
        let flight = &mut self.flights[place];
        let mut sent = flight.datagrams.iter();
        let is_match = datagrams.clone().all(|datagram| {
            datagram.is_ok_and(|datagram| {
                datagram.header.index == index && sent.next().is_some_and(|sent| sent.is_answered_by(&datagram.header))
            })
        });
        if !is_match || sent.next().is_some() {
            self.counters.mismatched += 1;
            return;
        }
        flight.is_used = false;
        self.indices[usize::from(index)] = IndexUse::Answered;
        self.counters.answered += 1;
        for (sent, datagram) in flight.datagrams.iter().zip(datagrams.flatten()) {
            match sent.owner {
                Owner::Cycle(number) => cycle(number, &datagram),
                Owner::Request(number) => {
                    let request = &mut self.requests[number];
                    if request.is_abandoned {
                        self.unused.take_back(number, request);
                        continue;
                    }
                    request.data.clear();
                    request.data.extend_from_slice(datagram.data);
                    request.state = RequestState::Answered(datagram.working_counter);
                }
            }
        }
    }

    /// Whether a frame with that source address is one of this master that has passed a slave. All others are counted.
    fn is_ours(&mut self, source: [u8; 6]) -> bool {
        let ours = self.settings.source;
        let passed = [ours[0] | FrameHeader::PASSED_A_SLAVE, ours[1], ours[2], ours[3], ours[4], ours[5]];
        let is_ours = source == passed;
        if source == ours && !is_ours {
            self.counters.unpassed += 1;
        } else if !is_ours {
            self.counters.foreign += 1;
            self.other_source = Some(source);
        }
        is_ours
    }

    /// Gives up frames whose timeout has passed.
    pub(super) fn expire(&mut self, now: Ns) {
        for place in 0..self.flights.len() {
            if self.flights[place].is_used && now >= self.flights[place].expires {
                self.give_up(place, now);
            }
        }
    }

    /// Gives up the frames of the cycle that are in flight.
    pub(super) fn expire_cyclic(&mut self, now: Ns) {
        for place in 0..self.flights.len() {
            if self.flights[place].is_used && self.flights[place].is_cyclic {
                self.give_up(place, now);
            }
        }
    }

    fn give_up(&mut self, place: usize, now: Ns) {
        let flight = &mut self.flights[place];
        flight.is_used = false;
        self.counters.lost += 1;
        let until = now.saturating_add(self.settings.index_rest_ns);
        self.indices[usize::from(flight.index)] = IndexUse::Resting { until };
        for sent in &flight.datagrams {
            let Owner::Request(number) = sent.owner else { continue };
            let request = &mut self.requests[number];
            if request.is_abandoned {
                self.unused.take_back(number, request);
            } else if request.tries > 0 {
                request.state = RequestState::Queued;
                self.queue.push_back(number);
            } else {
                request.state = RequestState::Lost;
            }
        }
    }
}
