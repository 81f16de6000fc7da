//! Transfers as a host submits them, and how they end.

/// The direction of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the device.
    Out,
    /// To the host.
    In,
}

/// The status of a completed transfer: 0 or a negative error number of Linux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Success.
    Done = 0,
    /// The endpoint has stalled (EPIPE).
    Stall = -32,
    /// The packet was longer than the transfer (EOVERFLOW).
    Overflow = -75,
    /// The host has unlinked the transfer (ECONNRESET).
    Unlinked = -104,
}

/// A transfer that a host submits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// The sequence number that the host has given the transfer. [`Ends::ended`] repeats it.
    pub sequence: u32,
    /// Whether data go to the device or to the host.
    pub direction: Direction,
    /// The number of the endpoint, 0..=15, without the direction bit.
    pub endpoint: u8,
    /// How many bytes the host accepts of an IN transfer, or sends in an OUT transfer.
    pub length: u32,
    /// The setup packet of a control transfer.
    pub setup: [u8; 8],
}

/// Receives the results of transfers, in the order in which these complete.
pub trait Ends {
    /// A transfer has completed. `moved` is the number of transferred bytes; for an IN transfer these bytes are in
    /// `data`, for an OUT transfer `data` is empty.
    fn ended(&mut self, sequence: u32, status: Status, moved: u32, data: &[u8]);

    /// The answer to a request to unlink a transfer: [`Status::Unlinked`] if the transfer was unlinked (then it has no
    /// result), or [`Status::Done`] if it had completed before.
    fn unlinked(&mut self, sequence: u32, status: Status);
}
