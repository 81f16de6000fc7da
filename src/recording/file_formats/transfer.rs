//! The contents of one packet of a USB transfer, in the same form for all capturing programs.

use crate::recording::address::Address;

/// The kind of a USB transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::recording) enum TransferKind {
    /// An interrupt transfer. A transfer whose endpoint the capture does not show counts as one too, since it may carry
    /// a frame; its length shows whether it does.
    Interrupt,
    Control,
    /// A bulk or isochronous transfer.
    Other,
}

/// The stage of a USB transfer at which a packet was captured.
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
    /// The setup packet of a control transfer. `None`: the packet has none.
    pub setup: Option<[u8; 8]>,
    /// The length of the transfer in bytes. The capture may have fewer bytes of it.
    pub length: u32,
    pub data: &'a [u8],
}
