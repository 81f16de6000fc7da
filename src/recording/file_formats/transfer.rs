//! What a packet of a capture shows of a USB transfer, independent of the capturing program.

use crate::recording::address::Address;

/// The kind of a USB transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum TransferKind {
    /// An interrupt transfer, or one whose endpoint the capture does not know.
    Interrupt,
    Control,
    /// A bulk or isochronous transfer.
    Other,
}

/// The stage of a transfer that a packet shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum Stage {
    /// The transfer was handed to the host controller.
    Submitted,
    /// The transfer has ended; `done`: whether it succeeded.
    Ended { done: bool },
}

/// One packet of a USB transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) struct UsbEvent<'a> {
    pub at: Address,
    pub kind: TransferKind,
    pub stage: Stage,
    pub to_host: bool,
    /// The id of the transfer, the same in all its packets while it is in flight.
    pub id: u64,
    /// The setup packet of a control transfer.
    pub setup: Option<[u8; 8]>,
    /// The bytes that were, or are to be, transferred; a capture may have fewer of them.
    pub length: u32,
    pub data: &'a [u8],
}
