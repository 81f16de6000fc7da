//! The frames and the clock of a network card.

use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::ethercat::{ETHERTYPE, FRAME_LEN_MAX, Frame, Ns};
use crate::fieldbus::nic::NicWires;
use crate::io::ethernet::{self, Claim, DefaultRoute, InterfaceError, MacAddress, Socket};
use crate::link::LinkError;
use crate::master::{FrameBuffer, Wire, WireDown};

/// For so long the card is listened to before anything is sent: another master sends within each of its cycles. \[OURS]
const LISTEN: Duration = Duration::from_millis(100);
/// The bit of a source address that slaves set in frames which pass them. A master's own address is without it.
const PASSED: u8 = 0x02;

/// A network card that one master alone uses.
pub(super) struct Card {
    socket: Socket,
    source: MacAddress,
    begin: Instant,
    /// Nobody else on this machine has the card while this is open.
    _claim: Claim,
}

impl Card {
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

impl NicWires for Card {
    fn now(&self) -> Ns {
        Ns::try_from(self.begin.elapsed().as_nanos()).unwrap_or(Ns::MAX)
    }

    fn wait(&mut self, until: Ns) {
        let left = Duration::from_nanos(until.saturating_sub(self.now()));
        let limit = Timespec::try_from(left).ok();
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        // If the wait fails, the calls after it find nothing.
        let _ = poll(&mut fds, limit.as_ref());
    }

    fn is_real_time(&self) -> bool {
        true
    }
}
