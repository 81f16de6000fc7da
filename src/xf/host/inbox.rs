//! What came back from the chip: the newest packet, and the TxPDOs of the newest answer that had any.

use crate::xf::{AnswerHeader, DataSize, HEADER_LEN, MAX_PACKET};

/// Room for two packets: the next one is received in one of them, while the TxPDOs stand in the other, so that nobody
/// copies them.
#[derive(Clone, Debug)]
pub(super) struct Inbox {
    packets: [[u8; MAX_PACKET]; 2],
    /// Where the next packet is received.
    current: usize,
    inputs_len: usize,
}

impl Inbox {
    pub(super) const fn new() -> Self {
        Self { packets: [[0; MAX_PACKET]; 2], current: 0, inputs_len: 0 }
    }

    /// Room for the packet that is received next; afterwards, that packet.
    pub(super) const fn packet(&mut self) -> &mut [u8; MAX_PACKET] {
        &mut self.packets[self.current]
    }

    /// The first `len` bytes that were received; `None` if there is no room for so many.
    pub(super) fn received(&self, len: usize) -> Option<&[u8]> {
        self.packets[self.current].get(..len)
    }

    /// The header of the packet that was received.
    pub(super) fn header(&self) -> AnswerHeader {
        self.packets[self.current].first_chunk().map(|head| AnswerHeader::decode(head).1).unwrap_or_default()
    }

    /// The data segment of the packet that was received.
    pub(super) fn data(&self, size: DataSize) -> &[u8] {
        &self.packets[self.current][HEADER_LEN..][..size.bytes()]
    }

    /// The first `len` bytes of the data segment are TxPDOs. They are kept until the next ones are.
    pub(super) const fn keep_inputs(&mut self, len: usize) {
        self.current = 1 - self.current;
        self.inputs_len = len;
    }

    /// The TxPDOs.
    pub(super) fn inputs(&self) -> &[u8] {
        &self.packets[1 - self.current][HEADER_LEN..][..self.inputs_len]
    }
}
