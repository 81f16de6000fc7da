//! Two network cards at the ends of a line of slaves: a ring, which goes on when a cable is cut.
//!
//! Each frame of the master goes out by the first card, and beside it a probe by the second one, which asks for nothing that
//! matters. What comes back where says how the ring is:
//!
//! | frame | probe | the ring | what is done |
//! | --- | --- | --- | --- |
//! | at the second card | at the first one | [`RingState::Whole`] | the frame has passed all slaves |
//! | at the first card | at the second one | [`RingState::Open`] | the frame goes out again by the second card, so that the slaves behind the gap work on it too, and comes back there |
//! | at the first card | - | [`RingState::SecondDead`] | nothing: it has passed all slaves that there are |
//! | - | at the second card | [`RingState::FirstDead`] | the frame goes out again by the second card |
//!
//! So no slave gets a frame twice, the slaves work on it in their order on the cable, and no cycle is lost where a cable is
//! cut. How the ring was last is taken for how it is, so that nothing waits for a card that is dead.
//!
//! \[OURS] How long is waited for the other of the two: [`GRACE_NS`].

use super::{CardPair, CardsGone, NicWires, RingState};
use crate::ethercat::registers::TYPE;
use crate::ethercat::{
    CableEnd, Command, DatagramHeader, FRAME_LEN_MAX, FRAME_LEN_MIN, Frame, FrameHeader, FrameWriter, Ns,
};
use crate::master::{FrameBuffer, Wire, WireDown};

/// How long after the frame its probe may come, or the other way round, until one of them is taken for lost, ns. \[OURS] A frame
/// passes 40 slaves in less than half of it.
pub const GRACE_NS: Ns = 100_000;

/// A frame on the way, by its index.
#[derive(Clone, Debug)]
struct Flight {
    is_used: bool,
    /// As it was sent, or as it came back at the first card.
    frame: FrameBuffer,
    len: usize,
    /// It is back at the first card, and waits for its probe.
    is_back: bool,
    /// Where its probe has come back.
    probe: Option<CableEnd>,
    /// It has gone out by the second card.
    is_forwarded: bool,
    /// When what is missing of it and its probe is taken for lost; `None`: nothing waits.
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

/// Two cards as one wire.
pub struct Ring<P> {
    pair: P,
    /// The source of the probes.
    probe_source: [u8; 6],
    flights: Vec<Flight>,
    /// The earliest time at which something is taken for lost.
    next_due: Option<Ns>,
    state: RingState,
}

/// What has come.
enum Came {
    /// A probe with that index.
    Probe(u8),
    /// A frame of ours with that index; whether it has passed a slave.
    Own(u8, bool),
    /// Something else.
    Other,
}

impl<P: CardPair> Ring<P> {
    /// These cards; frames have `source` from the first one, and probes `probe_source`, which has to be another one.
    pub fn new(pair: P, probe_source: [u8; 6]) -> Self {
        Self { pair, probe_source, flights: vec![Flight::UNUSED; 256], next_due: None, state: RingState::default() }
    }

    /// The cards, to look at.
    pub const fn pair(&self) -> &P {
        &self.pair
    }

    /// The cards, to change.
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
            // One that is not sent does not come back, which says the same.
            let _ = self.pair.send(CableEnd::Last, writer.finish());
        }
    }

    /// Something of that frame is missing: it is waited for so long.
    fn wait_for_rest(&mut self, index: u8) {
        let due = self.pair.now().saturating_add(GRACE_NS);
        self.flights[usize::from(index)].due.get_or_insert(due);
        self.next_due = Some(self.next_due.map_or(due, |next| next.min(due)));
    }

    /// The frame goes out by the second card.
    fn forward(&mut self, index: u8) -> bool {
        let flight = &mut self.flights[usize::from(index)];
        (flight.is_forwarded, flight.is_back, flight.due) = (true, false, None);
        self.pair.send(CableEnd::Last, &flight.frame[..flight.len]).is_ok()
    }

    /// Hands over a frame that was kept.
    fn hand_over(&mut self, index: u8, buffer: &mut FrameBuffer) -> usize {
        let flight = &mut self.flights[usize::from(index)];
        (flight.is_used, flight.due) = (false, None);
        buffer[..flight.len].copy_from_slice(&flight.frame[..flight.len]);
        flight.len
    }

    /// A frame has come at an end; its length if it is one for the master, in `buffer`.
    fn take(&mut self, end: CableEnd, buffer: &mut FrameBuffer, len: usize) -> Option<usize> {
        match self.judge(&buffer[..len]) {
            Came::Other => Some(len),
            Came::Probe(index) => {
                // Nothing but a whole ring lets a probe through.
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
                    // The slaves near the second card are there, and the frame may not have come to the first one.
                    self.wait_for_rest(index);
                }
                None
            }
            Came::Own(index, is_passed) => {
                let flight = &mut self.flights[usize::from(index)];
                match end {
                    CableEnd::Last if is_passed => {
                        let was_forwarded = flight.is_forwarded;
                        (flight.is_used, flight.due) = (false, None);
                        if !was_forwarded {
                            self.state = RingState::Whole;
                        }
                        Some(len)
                    }
                    // What went out by the second card has come round the whole ring untouched, or comes too late.
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

    /// A frame is back at the first card, and there are slaves at the second one.
    fn go_on_behind_gap(&mut self, index: u8, buffer: &mut FrameBuffer) -> Option<usize> {
        self.state = RingState::Open;
        if self.forward(index) { None } else { Some(self.hand_over(index, buffer)) }
    }

    /// What was waited for is taken for lost; the length of a frame that is handed over.
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

/// The source of a frame that is as long as one.
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
