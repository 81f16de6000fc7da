//! The received data: the newest packet, and the TxPDOs of the newest answer that contained any.

use crate::xf::{AnswerHeader, DataSize, HEADER_LEN, MAX_PACKET};

/// A double buffer for packets: the next packet is received in one buffer while the TxPDOs stay in the other, so that
/// they need not be copied.
#[derive(Clone, Debug)]
pub(super) struct ReceiveBuffer {
    packets: [[u8; MAX_PACKET]; 2],
    /// The index of the buffer into which the next packet is received. The other buffer holds the newest TxPDOs.
    current: usize,
    inputs_len: usize,
}

impl ReceiveBuffer {
    pub(super) const fn new() -> Self {
        Self { packets: [[0; MAX_PACKET]; 2], current: 0, inputs_len: 0 }
    }

    /// The buffer into which the caller receives the next packet.
    pub(super) const fn packet(&mut self) -> &mut [u8; MAX_PACKET] {
        &mut self.packets[self.current]
    }

    /// The first `len` bytes received; `None` if that is more than the buffer holds.
    pub(super) fn received(&self, len: usize) -> Option<&[u8]> {
        self.packets[self.current].get(..len)
    }

    /// The header of the packet received last.
    pub(super) fn header(&self) -> AnswerHeader {
        self.packets[self.current].first_chunk().map(|head| AnswerHeader::decode(head).1).unwrap_or_default()
    }

    /// The data segment of the packet received last.
    pub(super) fn data(&self, size: DataSize) -> &[u8] {
        &self.packets[self.current][HEADER_LEN..][..size.bytes()]
    }

    /// Keeps the first `len` bytes of the data segment as the newest TxPDOs.
    pub(super) const fn keep_inputs(&mut self, len: usize) {
        self.current = 1 - self.current;
        self.inputs_len = len;
    }

    /// The newest TxPDOs.
    pub(super) fn inputs(&self) -> &[u8] {
        &self.packets[1 - self.current][HEADER_LEN..][..self.inputs_len]
    }
}
