//! The frames and the clock of a network card, and of two.

use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::ethercat::{CableEnd, ETHERTYPE, FRAME_LEN_MAX, Frame, Ns};
use crate::fieldbus::nic::{CardPair, NicWires};
use crate::io::ethernet::{self, Claim, DefaultRoute, InterfaceError, MacAddress, Socket};
use crate::link::LinkError;
use crate::link::uri::{LinkUri, UriError};
use crate::master::{FrameBuffer, Wire, WireDown};

/// For so long the card is listened to before anything is sent: another master sends within each of its cycles. \[OURS]
const LISTEN: Duration = Duration::from_millis(100);
/// The bit of a source address that slaves set in frames which pass them. A master's own address is without it.
const PASSED: u8 = 0x02;

/// A network card that one master alone uses.
pub(crate) struct Card {
    socket: Socket,
    source: MacAddress,
    begin: Instant,
    /// Nobody else on this machine has the card while this is open.
    _claim: Claim,
}

impl Card {
    /// Opens the card that a link names.
    ///
    /// # Errors
    /// [`LinkError::Uri`]: it names none; as [`Self::open`].
    pub(super) fn of(uri: &LinkUri) -> Result<Self, LinkError> {
        if uri.path().is_empty() {
            let path = uri.path().to_owned();
            return Err(
                UriError::BadPath { scheme: uri.scheme(), path, allowed: "nic:INTERFACE, e.g. nic:eth1" }.into()
            );
        }
        Self::open(uri.path(), &uri.to_string())
    }

    /// Opens the card of that name for a master.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`]: the interface cannot be used, or another master is there; [`LinkError::InUse`]: another program
    /// on this machine has it.
    pub(super) fn open(interface: &str, link: &str) -> Result<Self, LinkError> {
        let refused = |error: InterfaceError| match error {
            InterfaceError::InUse { .. } => LinkError::InUse {
                name: link.to_owned(),
                by: " by another program of ecmsk on this machine".into(),
                instead: "end that program, or share its board by `ecmsk serve tcp`",
            },
            error => LinkError::NoBoard { name: link.to_owned(), reason: error.to_string() },
        };
        let interface = ethernet::check(interface, DefaultRoute::Refused { insist: None }).map_err(refused)?;
        let claim = Claim::new(&interface).map_err(refused)?;
        let socket = Socket::open(&interface, ETHERTYPE).map_err(refused)?;
        let mut source = interface.mac_address;
        source[0] &= !PASSED;
        let mut card = Self { socket, source, begin: Instant::now(), _claim: claim };
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

    /// The source of its frames.
    pub(super) const fn source(&self) -> MacAddress {
        self.source
    }

    /// The source of a frame that somebody else sends; `None`: the wire is quiet.
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
        self.socket.send(frame).map_err(|_| WireDown)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        // A longer frame is none of EtherCAT, and one that cannot be taken is lost.
        loop {
            match self.socket.take(buffer) {
                Ok(Some(len)) if len > buffer.len() => {}
                Ok(taken) => return taken,
                Err(_) => return None,
            }
        }
    }
}

/// Waits until a frame is there or the time is up. If the wait fails, the calls after it find nothing.
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
}

/// Two cards, one at each end of the slaves' cable.
pub(crate) struct Cards {
    pub(super) first: Card,
    pub(super) second: Card,
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

    fn is_real_time(&self) -> bool {
        true
    }
}
