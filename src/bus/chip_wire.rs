//! Datagrams that an ECM-XF sends for its host. This crate's own master sends its frames as such datagrams. It needs
//! them for the mailbox services that the chip has no commands for, on slaves that the chip runs.

use std::collections::VecDeque;
use std::time::Duration;

use crate::ethercat::{Command, DatagramMut, Ns, each_datagram, mark_as_passed};
use crate::master::{FrameBuffer, Wire, WireDown};
use crate::xf::host::{HostError, Wires as _};
use crate::xf::request::{RAW_DATA_MAX, RAW_HEAD, RawGet, RawOperation, RawRequest};
use crate::xf_api::{Xf, XfError};

/// \[OURS] Timeout of the chip for one datagram.
pub(super) const DATAGRAM_MAX: Duration = Duration::from_millis(100);

/// The maximum number of data bytes in a datagram of this chip.
pub(super) fn bytes_max(xf: &Xf) -> usize {
    RAW_DATA_MAX.min(xf.host().size().bytes().saturating_sub(RAW_HEAD))
}

/// Lets the chip send a datagram. Returns its working counter and its data; `None` if it did not come back.
///
/// # Errors
/// [`XfError`]: the chip does not answer, or refuses the datagram for another reason than that it was lost.
pub(super) fn datagram(
    xf: &mut Xf,
    operation: RawOperation,
    address: u32,
    data: &[u8],
) -> Result<Option<(u16, Vec<u8>)>, XfError> {
    let [a, b, c, d] = address.to_le_bytes();
    let (adp, ado) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
    let timeout_us = i32::try_from(DATAGRAM_MAX.as_micros()).unwrap_or(i32::MAX);
    let request = RawRequest { operation, adp, ado, logical: 0, timeout_us, data };
    match xf.run_pair(&request, &RawGet, 2 * DATAGRAM_MAX) {
        Ok(answer) => {
            let counter = u16::try_from(answer.working_counter).ok();
            Ok(counter.map(|counter| (counter, answer.data.to_vec())))
        }
        Err(XfError::Chip(HostError::Failed { .. })) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Carries the frames of this crate's own master as datagrams of the chip. [`Wire::send`] waits until the frame is
/// back.
pub(super) struct ChipWire<'x> {
    xf: &'x mut Xf,
    /// Frames that have come back from the slaves, until the master receives them.
    received: VecDeque<Vec<u8>>,
    /// Why the chip cannot be reached any more, until [`ChipWire::wait`] returns this error.
    error: Option<XfError>,
}

impl<'x> ChipWire<'x> {
    pub(super) const fn new(xf: &'x mut Xf) -> Self {
        Self { xf, received: VecDeque::new(), error: None }
    }

    pub(super) fn now(&self) -> Ns {
        self.xf.link().now()
    }

    /// Waits for this time. Returns at once if a frame has come back that the master still has to receive.
    ///
    /// # Errors
    /// The chip cannot be reached any more.
    pub(super) fn wait(&mut self, time: Duration) -> Result<(), XfError> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        if self.received.is_empty() { self.xf.pass(time) } else { Ok(()) }
    }

    /// Sends a datagram, in several parts if it is longer than the chip can send. Parts are allowed because a mailbox
    /// counts as written, or read, only with the access to its last byte. `None` if the chip cannot send a datagram with
    /// this command, if a part did not come back, or if the parts came back with different working counters.
    fn send_datagram(&mut self, datagram: &mut DatagramMut<'_>) -> Result<Option<()>, XfError> {
        let header = datagram.header();
        let Some(operation) = operation(header.command) else { return Ok(None) };
        let part_len = bytes_max(self.xf);
        let mut counter = None;
        for (at, part) in (0..).step_by(part_len).zip(datagram.data.chunks_mut(part_len)) {
            let address = header.address.wrapping_add(at << 16);
            let Some((counted, data)) = self::datagram(self.xf, operation, address, part)? else { return Ok(None) };
            part.iter_mut().zip(data).for_each(|(to, from)| *to = from);
            // If the first part comes back with working counter 0, no slave has this address. The other parts are not
            // sent, and the datagram keeps counter 0.
            match counter {
                None if counted == 0 => return Ok(Some(())),
                Some(first) if first != counted => return Ok(None),
                _ => counter = Some(counted),
            }
        }
        datagram.count(counter.unwrap_or(0));
        Ok(Some(()))
    }
}

/// The chip's operation for a datagram of this crate's own master; `None` if it has none. FPRD and FPWR suffice, since
/// a master that joined a running network addresses slaves by station address only.
const fn operation(command: Command) -> Option<RawOperation> {
    match command {
        Command::Fprd => Some(RawOperation::Fprd),
        Command::Fpwr => Some(RawOperation::Fpwr),
        _ => None,
    }
}

impl Wire for ChipWire<'_> {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let mut frame = frame.to_vec();
        let mut is_back = true;
        let read = each_datagram(&mut frame, |mut datagram| {
            if self.error.is_none() && is_back {
                match self.send_datagram(&mut datagram) {
                    Ok(came) => is_back = came.is_some(),
                    Err(error) => self.error = Some(error),
                }
            }
        });
        if read.is_err() || self.error.is_some() {
            return Err(WireDown);
        }
        if is_back {
            mark_as_passed(&mut frame);
            self.received.push_back(frame);
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let frame = self.received.pop_front()?;
        buffer[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}
