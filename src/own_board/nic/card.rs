//! The frames and the clock of one network card, or of two cards in a ring.

use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::address::uri::{LinkUri, UriError};
use crate::ethercat::{CableEnd, ETHERTYPE, FRAME_LEN_MAX, Frame, Ns};
use crate::fieldbus::CardsGone;
use crate::fieldbus::nic::{CardPair, NicWires};
use crate::io::ethernet::{self, Claim, DefaultRoute, EthernetSocket, InterfaceError, MacAddress, SocketError};
use crate::link::LinkError;
use crate::master::{FrameBuffer, Wire, WireDown};

/// How long this program only listens on the card before it sends anything. Another master sends frames in each of its
/// cycles, so this program receives some of them in this time. \[OURS]
const LISTEN: Duration = Duration::from_millis(100);
/// The bit of the source address that each slave sets in a frame that passes it. In the address of a master the bit is 0.
const PASSED_SLAVE_BIT: u8 = 0x02;

/// A network card that is used exclusively by one master.
pub(crate) struct Card {
    name: String,
    socket: EthernetSocket,
    /// Whether the interface was found to no longer exist.
    is_gone: bool,
    /// The message for the case that the interface no longer exists.
    lost_message: CardsGone,
    source: MacAddress,
    begin: Instant,
    /// The claim that keeps other programs of ecmsk on this machine from opening the card.
    _claim: Claim,
}

impl Card {
    /// Opens the card that a link names.
    ///
    /// # Errors
    /// [`LinkError::Uri`] if the link names no card; otherwise the errors of [`Self::open`].
    pub(super) fn of(uri: &LinkUri) -> Result<Self, LinkError> {
        if uri.path().is_empty() {
            let path = uri.path().to_owned();
            return Err(
                UriError::BadPath { scheme: uri.scheme(), path, allowed: "nic:INTERFACE, e.g. nic:eth1" }.into()
            );
        }
        Self::open(uri.path(), &uri.to_string())
    }

    /// Opens a card exclusively for a master.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`]: the interface cannot be used, or another master sends on it; [`LinkError::InUse`]:
    /// another program of ecmsk on this machine uses it.
    pub(super) fn open(interface: &str, link: &str) -> Result<Self, LinkError> {
        let refused = |error: InterfaceError| match error {
            InterfaceError::InUse { .. } => LinkError::InUse {
                name: link.to_owned(),
                by: " by another program of ecmsk on this machine".into(),
                instead: "end that program, or share its board by `ecmsk serve tcp`",
            },
            error => LinkError::NoBoard { name: link.to_owned(), reason: error.to_string() },
        };
        let interface = ethernet::check(interface, DefaultRoute::Refused { override_option: None }).map_err(refused)?;
        let claim = Claim::new(&interface).map_err(refused)?;
        let socket = EthernetSocket::open(&interface, ETHERTYPE).map_err(refused)?;
        let mut source = interface.mac_address;
        source[0] &= !PASSED_SLAVE_BIT;
        let lost_message = CardsGone { text: gone_text(&interface.name, &[]).into(), is_all: true };
        let name = interface.name;
        let mut card =
            Self { name, socket, is_gone: false, lost_message, source, begin: Instant::now(), _claim: claim };
        if let Some(other) = card.other_master() {
            let other = other.map(|byte| format!("{byte:02X}")).join(":");
            return Err(LinkError::NoBoard {
                name: link.to_owned(),
                reason: format!(
                    "another master sends frames there (from {other}); nothing was sent. Stop it, or name the card that the \
                     slaves of this program are connected to"
                ),
            });
        }
        Ok(card)
    }

    /// The source address of the master's frames.
    pub(super) const fn source(&self) -> MacAddress {
        self.source
    }

    /// Marks the card as gone, if that is the reason why a frame could not be sent or received.
    const fn note(&mut self, error: &SocketError) {
        if matches!(error, SocketError::Gone) {
            self.is_gone = true;
        }
    }

    /// Listens for frames of another master. Returns their source address; `None` if there are none.
    fn other_master(&mut self) -> Option<MacAddress> {
        let end = Ns::try_from(LISTEN.as_nanos()).unwrap_or(Ns::MAX).saturating_add(self.now());
        let mut buffer = [0; FRAME_LEN_MAX];
        loop {
            while let Some(len) = self.receive(&mut buffer) {
                if Frame::decode(&buffer[..len]).is_ok_and(|frame| frame.datagrams().is_some()) {
                    return buffer[6..12].try_into().ok();
                }
            }
            if self.now() >= end {
                return None;
            }
            self.wait(end);
        }
    }
}

impl Wire for Card {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.socket.send(frame).map_err(|error| {
            self.note(&error);
            WireDown
        })
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        // Frames that are too long for EtherCAT are skipped. After an error, no frame counts as received.
        loop {
            match self.socket.take(buffer) {
                Ok(Some(len)) if len > buffer.len() => {}
                Ok(taken) => return taken,
                Err(error) => {
                    self.note(&error);
                    return None;
                }
            }
        }
    }
}

/// Waits until a frame has arrived or `left_ns` has passed. An error of the wait is ignored, because the next read then
/// finds no frame.
fn wait_for_frames(fds: &mut [PollFd<'_>], left_ns: Ns) {
    let limit = Timespec::try_from(Duration::from_nanos(left_ns)).ok();
    let _ = poll(fds, limit.as_ref());
}

impl NicWires for Card {
    fn now(&self) -> Ns {
        Ns::try_from(self.begin.elapsed().as_nanos()).unwrap_or(Ns::MAX)
    }

    fn wait(&mut self, until: Ns) {
        let left_ns = until.saturating_sub(self.now());
        wait_for_frames(&mut [PollFd::new(&self.socket, PollFlags::IN)], left_ns);
    }

    fn is_real_time(&self) -> bool {
        true
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        self.is_gone.then(|| self.lost_message.clone())
    }
}

/// Two cards, one at each end of the slaves' cable.
pub(crate) struct Cards {
    first: Card,
    second: Card,
    /// The messages for the loss of the first card, of the second card, and of both cards.
    lost_message: Box<[CardsGone; 3]>,
}

impl Cards {
    pub(super) fn new(first: Card, second: Card) -> Self {
        let one = |card: &Card, other: &Card| {
            CardsGone {
            text: format!(
                "{}. The ring goes on by {}, and the next cut of a cable costs slaves; the card is used again when the board is opened \
                 again",
                gone_text(&card.name, &[]),
                other.name
            )
            .into(),
            is_all: false,
        }
        };
        let both = CardsGone { text: gone_text(&first.name, &[&second.name]).into(), is_all: true };
        Self { lost_message: Box::new([one(&first, &second), one(&second, &first), both]), first, second }
    }
}

/// A message that names the network cards that are gone, with the next step.
fn gone_text(first: &str, others: &[&str]) -> String {
    let names = [&[first], others].concat().join(" and ");
    let (card, was) = if others.is_empty() { ("card", "was") } else { ("cards", "were") };
    format!(
        "the network {card} {names} {was} pulled, or deleted: plug in what was pulled, and look for it with: ip link"
    )
}

impl CardPair for Cards {
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown> {
        match end {
            CableEnd::First => self.first.send(frame),
            CableEnd::Last => self.second.send(frame),
        }
    }

    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize> {
        match end {
            CableEnd::First => self.first.receive(buffer),
            CableEnd::Last => self.second.receive(buffer),
        }
    }

    fn now(&self) -> Ns {
        self.first.now()
    }

    fn wait(&mut self, until: Ns) {
        let left_ns = until.saturating_sub(self.first.now());
        let sockets = [&self.first.socket, &self.second.socket];
        wait_for_frames(&mut sockets.map(|socket| PollFd::new(socket, PollFlags::IN)), left_ns);
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        let [first, second, both] = &*self.lost_message;
        let gone = match (self.first.is_gone, self.second.is_gone) {
            (false, false) => return None,
            (true, false) => first,
            (false, true) => second,
            (true, true) => both,
        };
        Some(gone.clone())
    }

    fn is_real_time(&self) -> bool {
        true
    }
}
