//! What a packet of a capture tells of a USB transfer, whoever captured it.

use crate::recording::address::Address;

/// Kind of transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum Kind {
    /// Interrupt, or one of which the capture does not know the endpoint.
    Interrupt,
    Control,
    /// Bulk or isochronous.
    Other,
}

/// What has happened to a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum Stage {
    /// It was handed to the controller.
    Submitted,
    /// It has ended; whether it was carried out.
    Ended { done: bool },
}

/// One packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) struct Event<'a> {
    pub at: Address,
    pub kind: Kind,
    pub stage: Stage,
    pub to_host: bool,
    /// The same in all packets of a transfer while it is under way.
    pub id: u64,
    /// The setup packet of a control transfer.
    pub setup: Option<[u8; 8]>,
    /// Bytes that were moved or are to be; a capture may hold fewer of them.
    pub length: u32,
    pub data: &'a [u8],
}
