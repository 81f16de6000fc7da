//! Two network cards at both ends of a line of slaves: a ring, which continues when a cable is cut.
//!
//! Each frame of the master goes out through the first card. At the same time a probe goes out through the second card:
//! a frame that only reads one register, and whose answer is not used. The cards at which the frame and its probe come
//! back show the state of the ring:
//!
//! | frame comes back | probe comes back | the ring | action |
//! | --- | --- | --- | --- |
//! | at the second card | at the first card | [`RingState::Whole`] | none: the frame has passed all slaves |
//! | at the first card | at the second card | [`RingState::Open`] | the frame is forwarded: it goes out again through the second card, so that the slaves behind the cut process it too, and comes back there |
//! | at the first card | - | [`RingState::SecondDead`] | the frame is forwarded once, since its probe may only be late; if it does not come back either, it has passed all slaves that can be reached |
//! | - | at the second card | [`RingState::FirstDead`] | the frame is forwarded through the second card |
//!
//! So no slave processes a frame twice, the slaves process it in their order on the cable, and a cut costs no cycle. For
//! the next frame the last known state of the ring is assumed, so that no frame waits for a dead card.
//!
//! \[OURS] If only the frame or only its probe has come back, [`GRACE_NS`] limits the wait for the other.

use super::{CardPair, CardsGone, NicWires, RingState};
use crate::ethercat::registers::TYPE;
use crate::ethercat::{
    CableEnd, Command, DatagramHeader, FRAME_LEN_MAX, FRAME_LEN_MIN, Frame, FrameHeader, FrameWriter, Ns,
};
use crate::master::{FrameBuffer, Wire, WireDown};

/// The maximum time, ns, between the return of a frame and the return of its probe, whichever comes first. After this
/// time the missing frame or probe counts as lost. \[OURS] A frame passes 40 slaves in less than half of this time, so
/// a frame on a whole cable never counts as lost.
pub const GRACE_NS: Ns = 100_000;

/// A frame in flight. Its position in [`Ring::flights`] is the datagram index (0..=255) of its first datagram.
#[derive(Clone, Debug)]
struct Flight {
    is_used: bool,
    /// The frame as it was sent or, once it is back at the first card, as it came back.
    frame: FrameBuffer,
    len: usize,
    /// Whether `frame` holds an answer from the first card that the master may get. False again once the frame is
    /// forwarded behind a cut that its probe has shown, but not if it is forwarded because its probe is missing.
    is_back: bool,
    /// The end of the line at which the probe has come back; `None`: it has not come back.
    probe: Option<CableEnd>,
    /// Whether the frame was forwarded through the second card.
    is_forwarded: bool,
    /// When the missing frame or probe counts as lost; `None`: nothing is waited for.
    due: Option<Ns>,
}

impl Flight {
    const UNUSED: Self = Self {
        is_used: false,
        frame: [0; FRAME_LEN_MAX],
        len: 0,
        is_back: false,
        probe: None,
        is_forwarded: false,
        due: None,
    };
}

/// A ring as one wire for the master: a line of slaves with a network card at each end.
pub struct Ring<P> {
    pair: P,
    /// The source MAC address of the probes, by which they are recognised.
    probe_source: [u8; 6],
    flights: Vec<Flight>,
    /// The earliest time at which the missing frame or probe of a frame in flight counts as lost.
    next_due: Option<Ns>,
    state: RingState,
}

/// The kind of a received frame.
enum Came {
    /// A probe; its value is the index of the frame that it was sent with.
    Probe(u8),
    /// A frame of the master: its index, and whether it has passed a slave. A frame that has passed no slave is not an
    /// answer.
    Own(u8, bool),
    /// Neither a frame of the master nor a probe, but for example a frame of another master.
    Other,
}

impl<P: CardPair> Ring<P> {
    /// Makes a ring of these two cards.
    pub fn new(pair: P, probe_source: [u8; 6]) -> Self {
        Self { pair, probe_source, flights: vec![Flight::UNUSED; 256], next_due: None, state: RingState::default() }
    }

    /// The two network cards of the ring.
    pub const fn pair(&self) -> &P {
        &self.pair
    }

    /// The two cards, for causing faults in tests.
    pub const fn pair_mut(&mut self) -> &mut P {
        &mut self.pair
    }

    fn judge(&self, bytes: &[u8]) -> Came {
        let Ok(frame) = Frame::decode(bytes) else { return Came::Other };
        let Some(Ok(first)) = frame.datagrams().and_then(|mut datagrams| datagrams.next()) else { return Came::Other };
        let index = first.header.index;
        let [first, rest @ ..] = frame.header.source;
        let is_passed = first & FrameHeader::PASSED_A_SLAVE != 0;
        let [probe_first, probe_rest @ ..] = self.probe_source;
        if (first & !FrameHeader::PASSED_A_SLAVE, rest) == (probe_first, probe_rest) {
            return Came::Probe(index);
        }
        let sent = &self.flights[usize::from(index)];
        let [sent_first, sent_rest @ ..] = source_of(&sent.frame);
        let mask = !FrameHeader::PASSED_A_SLAVE;
        if sent.is_used && (first & mask, rest) == (sent_first & mask, sent_rest) {
            Came::Own(index, is_passed)
        } else {
            Came::Other
        }
    }

    fn probe(&mut self, index: u8) {
        let mut buffer = [0; FRAME_LEN_MIN];
        let header = FrameHeader::datagrams(self.probe_source);
        let Ok(mut writer) = FrameWriter::new(&mut buffer, header) else { return };
        if writer.push(DatagramHeader::new(Command::Brd, index, u32::from(TYPE) << 16), &[0]).is_ok() {
            // An error is ignored: a probe that was not sent does not come back, and a missing probe already shows that
            // the second card cannot be used.
            let _ = self.pair.send(CableEnd::Last, writer.finish());
        }
    }

    /// Starts the timeout for the missing frame or probe, unless it runs already.
    fn wait_for_rest(&mut self, index: u8) {
        let due = self.pair.now().saturating_add(GRACE_NS);
        self.flights[usize::from(index)].due.get_or_insert(due);
        self.next_due = Some(self.next_due.map_or(due, |next| next.min(due)));
    }

    /// Sends the frame through the second card. Returns whether it was sent.
    fn forward(&mut self, index: u8) -> bool {
        let flight = &mut self.flights[usize::from(index)];
        (flight.is_forwarded, flight.is_back, flight.due) = (true, false, None);
        self.pair.send(CableEnd::Last, &flight.frame[..flight.len]).is_ok()
    }

    /// Copies the frame with this index, as it came back at the first card, from `flights` into `buffer` for the
    /// master. Returns its length. The frame is then no longer in flight.
    fn hand_over(&mut self, index: u8, buffer: &mut FrameBuffer) -> usize {
        let flight = &mut self.flights[usize::from(index)];
        (flight.is_used, flight.due) = (false, None);
        buffer[..flight.len].copy_from_slice(&flight.frame[..flight.len]);
        flight.len
    }

    /// Evaluates a frame that was received at `end`. If it is for the master (an answer, or a frame of another sender),
    /// puts it into `buffer` and returns its length. `None`: it was a probe, or the ring keeps or drops it.
    fn take(&mut self, end: CableEnd, buffer: &mut FrameBuffer, len: usize) -> Option<usize> {
        match self.judge(&buffer[..len]) {
            Came::Other => Some(len),
            Came::Probe(index) => {
                // A probe from the second card reaches the first card only if no cable is cut.
                match end {
                    CableEnd::First => self.state = RingState::Whole,
                    CableEnd::Last if self.state == RingState::SecondDead => self.state = RingState::Open,
                    CableEnd::Last => {}
                }
                let flight = &mut self.flights[usize::from(index)];
                if !flight.is_used {
                    return None;
                }
                flight.probe = Some(end);
                if end == CableEnd::Last && !flight.is_forwarded {
                    if flight.is_back {
                        return self.go_on_behind_gap(index, buffer);
                    }
                    // The slaves near the second card can be reached. It is not known yet whether the frame has reached
                    // those near the first card.
                    self.wait_for_rest(index);
                }
                None
            }
            Came::Own(index, is_passed) => {
                let flight = &mut self.flights[usize::from(index)];
                match end {
                    CableEnd::Last if is_passed => {
                        match (flight.is_forwarded, flight.is_back) {
                            (false, _) => self.state = RingState::Whole,
                            // `give_up` has forwarded the frame because its probe was missing, but the probe was only
                            // late.
                            (true, true) => self.state = RingState::Open,
                            (true, false) => {}
                        }
                        (flight.is_used, flight.due) = (false, None);
                        Some(len)
                    }
                    // Not for the master: a forwarded frame came back to the first card without being processed, or the
                    // frame has passed no slave at all.
                    _ if !is_passed => None,
                    CableEnd::First if flight.is_forwarded => {
                        self.state = RingState::Open;
                        None
                    }
                    _ => {
                        flight.frame[..len].copy_from_slice(&buffer[..len]);
                        (flight.len, flight.is_back) = (len, true);
                        if flight.probe.is_some() {
                            return self.go_on_behind_gap(index, buffer);
                        }
                        if self.state == RingState::SecondDead {
                            return Some(self.hand_over(index, buffer));
                        }
                        self.wait_for_rest(index);
                        None
                    }
                }
            }
        }
    }

    /// Forwards a frame that is back at the first card, because its probe shows that there are slaves behind the cut. If
    /// this fails the frame is handed over to the master, and its length returned.
    fn go_on_behind_gap(&mut self, index: u8, buffer: &mut FrameBuffer) -> Option<usize> {
        self.state = RingState::Open;
        if self.forward(index) { None } else { Some(self.hand_over(index, buffer)) }
    }

    /// Handles each frame in flight whose timeout for the missing frame or probe is over: forwards the frame through
    /// the second card, or hands it over to the master in `buffer` and returns its length.
    fn give_up(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let now = self.pair.now();
        if self.next_due.is_none_or(|due| now < due) {
            return None;
        }
        for index in 0..=u8::MAX {
            let flight = &mut self.flights[usize::from(index)];
            if flight.due.is_none_or(|due| now < due) {
                continue;
            }
            flight.due = None;
            if !flight.is_used {
                continue;
            }
            if flight.is_back {
                if !flight.is_forwarded && self.state != RingState::SecondDead && self.forward(index) {
                    self.flights[usize::from(index)].is_back = true;
                    self.wait_for_rest(index);
                    continue;
                }
                self.state = RingState::SecondDead;
                return Some(self.hand_over(index, buffer));
            }
            self.state = RingState::FirstDead;
            self.forward(index);
        }
        self.next_due = self.flights.iter().filter(|flight| flight.is_used).filter_map(|flight| flight.due).min();
        None
    }
}

/// The source MAC address of the frame in a buffer.
const fn source_of(frame: &FrameBuffer) -> [u8; 6] {
    [frame[6], frame[7], frame[8], frame[9], frame[10], frame[11]]
}

impl<P: CardPair> Wire for Ring<P> {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let index = Frame::decode(frame).ok().and_then(|frame| Some(frame.datagrams()?.next()?.ok()?.header.index));
        let Some(index) = index.filter(|_| frame.len() <= FRAME_LEN_MAX) else {
            return self.pair.send(CableEnd::First, frame);
        };
        let flight = &mut self.flights[usize::from(index)];
        flight.frame[..frame.len()].copy_from_slice(frame);
        (flight.len, flight.is_used, flight.is_back) = (frame.len(), true, false);
        (flight.probe, flight.is_forwarded, flight.due) = (None, false, None);
        let sent = self.pair.send(CableEnd::First, frame);
        self.probe(index);
        if sent.is_err() || self.state == RingState::FirstDead {
            self.state = RingState::FirstDead;
            return if self.forward(index) { Ok(()) } else { sent };
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        for end in CableEnd::BOTH {
            while let Some(len) = self.pair.receive(end, buffer) {
                let taken = self.take(end, buffer, len.min(buffer.len()));
                if taken.is_some() {
                    return taken;
                }
            }
        }
        self.give_up(buffer)
    }
}

impl<P: CardPair> NicWires for Ring<P> {
    fn now(&self) -> Ns {
        self.pair.now()
    }

    fn wait(&mut self, until: Ns) {
        self.pair.wait(self.next_due.map_or(until, |due| due.min(until)));
    }

    fn is_real_time(&self) -> bool {
        self.pair.is_real_time()
    }

    fn ring(&self) -> Option<RingState> {
        Some(self.state)
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        self.pair.cards_gone()
    }
}
