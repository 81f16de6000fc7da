//! The virtual board as the host's USB stack sees it, transfer by transfer. This is state without I/O and waits: its
//! owner passes frames and reports between it and a board.
//!
//! A transfer that cannot be completed yet is kept pending, which is how a host sees an endpoint that answers NAK: an
//! IN transfer until the board has a report, an OUT transfer until the board takes the frame.

mod control;
mod transfers;

use super::descriptors::{Descriptors, IN, OUT};
use super::transfer::{Direction, Ends, Status, Transfer};
use crate::sk::{FRAME_LEN, Frame};
use transfers::Buffers;

/// The most transfers that a host may have pending in one direction; one more is refused with [`TooMany`]. \[OURS]
/// Drivers of the Linux kernel keep a few pending, programs that use libusb some ten.
pub const TRANSFERS_AT_ONCE: usize = 256;

/// The host has more transfers pending than [`TRANSFERS_AT_ONCE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the host has more than {TRANSFERS_AT_ONCE} transfers under way in one direction; wait for some of them first")]
pub struct TooMany;

/// Counters of a host's transfers since the board was attached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// The number of frames that the board has accepted.
    pub frames: u64,
    /// The number of reports that the host has received.
    pub reports: u64,
    /// The number of reports that were replaced by a newer one before the host fetched them.
    pub superseded: u64,
    /// The number of reports that were longer than the host's IN transfer, which then ends with an error.
    pub overflows: u64,
    /// The number of OUT packets of fewer than 512 bytes: 0 or 1, since the board hangs after the first one
    /// ([`Device::hangs`]).
    pub short_packets: u64,
    /// The number of OUT transfers that the host has unlinked before the board has accepted them.
    pub writes_unlinked: u64,
    /// The number of control requests that were answered with a stall.
    pub refused: u64,
}

/// A virtual board that is attached to a host. The results of the host's transfers are passed to `E`.
#[derive(Debug)]
pub struct Device<E> {
    descriptors: Descriptors,
    configured: bool,
    idle: u8,
    halted: Halted,
    /// Pending IN transfers, oldest first.
    reads: Buffers,
    /// Pending OUT transfers, oldest first.
    writes: Buffers,
    /// Whether a report is being read from the board.
    reading: bool,
    /// Whether the oldest frame is being written to the board.
    writing: bool,
    /// The host's request to unlink the transfer that is being written to the board. It is answered when the write has
    /// ended. `None`: the host has made no such request.
    unlinking: Option<Unlink>,
    /// The newest report that was read from the board.
    report: Frame,
    /// Whether no transfer has fetched the newest report yet.
    report_waits: bool,
    hangs: bool,
    counters: Counters,
    ends: E,
}

#[derive(Clone, Copy, Debug)]
struct Unlink {
    sequence: u32,
    victim: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Halted {
    reads: bool,
    writes: bool,
}

impl<E: Ends> Device<E> {
    /// A board that has just been attached. The results of its transfers are passed to `ends`.
    pub fn over(descriptors: Descriptors, ends: E) -> Self {
        Self {
            descriptors,
            configured: false,
            idle: 0,
            halted: Halted::default(),
            reads: Buffers::default(),
            writes: Buffers::default(),
            reading: false,
            writing: false,
            unlinking: None,
            report: Frame::new(),
            report_waits: false,
            hangs: false,
            counters: Counters::default(),
            ends,
        }
    }

    /// The host has selected the configuration, on a controller that handles SET_CONFIGURATION itself.
    pub const fn select_configuration(&mut self) {
        self.configured = true;
    }

    /// Whether the host has selected the configuration. Before that, the interrupt endpoints stall. \[OURS]
    pub const fn configured(&self) -> bool {
        self.configured
    }

    /// Whether the board hangs because of a short packet. It then takes no frame and makes no report until it is
    /// attached again, which simulates switching it off and on \[OURS]; endpoint 0 continues to work \[OURS].
    pub const fn hangs(&self) -> bool {
        self.hangs
    }

    /// The counters of transfers since the board was attached to this host.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// The host submits a transfer; `data` are the bytes of an OUT transfer.
    ///
    /// # Errors
    /// [`TooMany`]: the host already has [`TRANSFERS_AT_ONCE`] transfers pending in this direction.
    pub fn transfer(&mut self, transfer: &Transfer, data: &[u8]) -> Result<(), TooMany> {
        match (transfer.endpoint, transfer.direction) {
            (0, _) => self.control(transfer, data),
            (number, Direction::In) if number == IN & 0x0F && self.configured && !self.halted.reads => {
                self.reads.push(transfer.sequence, transfer.length as usize, &[])
            }
            (number, Direction::Out) if number == OUT && self.configured && !self.halted.writes => {
                self.submit_write(transfer.sequence, data)
            }
            _ => {
                self.stall(transfer.sequence);
                Ok(())
            }
        }
    }

    /// The host unlinks a transfer. Returns `true` if the frame of this transfer is being written to the board. Then
    /// the write should be cancelled; the call that ends the write answers the request to unlink.
    pub fn unlink(&mut self, sequence: u32, victim: u32) -> bool {
        if self.writing && self.unlinking.is_none() && self.writes.is_first(victim) {
            self.unlinking = Some(Unlink { sequence, victim });
            return true;
        }
        let was_there = if self.reads.remove(victim, 0) {
            true
        } else if self.writes.remove(victim, usize::from(self.writing)) {
            self.counters.writes_unlinked += 1;
            true
        } else {
            false
        };
        let status = if was_there { Status::Unlinked } else { Status::Done };
        self.ends.unlinked(sequence, status);
        if was_there {
            self.settle_writes();
        }
        false
    }

    /// Whether an IN transfer waits for a report and the board does not hang.
    pub fn wants_report(&self) -> bool {
        !self.hangs && !self.reads.is_empty()
    }

    /// Whether [`Self::begin_write`] would return a frame: one waits, no other one is being written, and the board does
    /// not hang.
    pub fn has_frame(&self) -> bool {
        !self.hangs && !self.writing && !self.writes.is_empty()
    }

    /// Whether a report is kept that no transfer has fetched yet.
    pub const fn report_waits(&self) -> bool {
        self.report_waits
    }

    /// Whether the caller has to read a report from the board now: an IN transfer is pending, and no other thread is
    /// reading. The caller then has to call [`Self::report`] or [`Self::deliver`].
    pub fn begin_read(&mut self) -> bool {
        let begins = !self.reading && self.wants_report();
        self.reading |= begins;
        begins
    }

    /// Stores a report that was read from the board, and passes it to the oldest pending IN transfer. Without such a
    /// transfer the report is kept until [`Self::deliver`] or a newer report. Ends the read of [`Self::begin_read`].
    pub fn report(&mut self, report: &Frame) {
        self.reading = false;
        if self.hangs {
            return;
        }
        self.counters.superseded += u64::from(self.report_waits);
        self.report.clone_from(report);
        self.report_waits = true;
        self.deliver();
    }

    /// Ends the read of [`Self::begin_read`] without a new report from the board: a kept report that no transfer has
    /// fetched goes to the oldest pending IN transfer.
    pub fn deliver(&mut self) {
        self.reading = false;
        if !self.report_waits || self.hangs {
            return;
        }
        let Some(read) = self.reads.first() else { return };
        self.report_waits = false;
        if read.room() < FRAME_LEN {
            self.counters.overflows += 1;
            self.end_read(Status::Overflow);
            return;
        }
        read.bytes.extend_from_slice(self.report.bytes());
        self.counters.reports += 1;
        if read.room() == 0 {
            self.end_read(Status::Done);
        }
    }

    /// Copies the next frame for the board into `frame`. Returns false if there is none, or another frame is being
    /// written. After true the caller has to write the frame, and then call [`Self::written`], [`Self::refused`] or
    /// [`Self::not_written`].
    pub fn begin_write(&mut self, frame: &mut Frame) -> bool {
        if !self.has_frame() {
            return false;
        }
        let Some(write) = self.writes.first() else { return false };
        frame.set_prefix(&write.bytes[write.moved..]);
        self.writing = true;
        true
    }

    /// The board has accepted the frame of [`Self::begin_write`]. Completes the host's OUT transfer if this was its
    /// last packet.
    pub fn written(&mut self) {
        self.writing = false;
        self.counters.frames += 1;
        if let Some(write) = self.writes.first() {
            write.moved += FRAME_LEN;
        }
        self.settle_writes();
        // If the transfer is complete, its result comes before the answer to the unlink request; otherwise its
        // remaining packets are unlinked.
        self.unlink_now();
    }

    /// The link has refused the frame of [`Self::begin_write`], and would refuse it again. Completes the host's OUT
    /// transfer with a stall; the other packets of the transfer are dropped. The endpoint is not halted: the host's
    /// next frame is a new attempt. \[OURS]
    pub fn refused(&mut self) {
        self.writing = false;
        let ends = &mut self.ends;
        self.writes.end_first(|write| ends.ended(write.sequence, Status::Stall, write.moved as u32, &[]));
        self.settle_writes();
        self.unlink_now();
    }

    /// The board has not accepted the frame of [`Self::begin_write`]. The frame is kept for the next attempt, unless
    /// the host has asked to unlink its transfer.
    pub fn not_written(&mut self) {
        self.writing = false;
        self.unlink_now();
    }

    /// The receiver of the transfers' results.
    pub const fn ends(&self) -> &E {
        &self.ends
    }

    /// The receiver of the transfers' results, so that the caller can take those that have arrived.
    pub const fn ends_mut(&mut self) -> &mut E {
        &mut self.ends
    }

    fn unlink_now(&mut self) {
        if let Some(Unlink { sequence, victim }) = self.unlinking.take() {
            self.unlink(sequence, victim);
        }
    }

    fn submit_write(&mut self, sequence: u32, data: &[u8]) -> Result<(), TooMany> {
        self.writes.push(sequence, 0, data)?;
        self.settle_writes();
        Ok(())
    }

    /// Completes OUT transfers whose packets have all been taken, and those whose last packet is short.
    fn settle_writes(&mut self) {
        while !self.writing && !self.hangs {
            let Some(write) = self.writes.first() else { return };
            let rest = write.bytes.len() - write.moved;
            if rest >= FRAME_LEN {
                return;
            }
            // A transfer without bytes is one packet without bytes: a short one, which hangs the board. A transfer
            // whose packets are all full ends with the last of them, without an empty packet.
            if rest > 0 || write.bytes.is_empty() {
                self.hang();
            }
            self.end_write();
        }
    }

    /// SK-9: a short OUT packet makes the board's firmware hang.
    fn hang(&mut self) {
        self.hangs = true;
        self.report_waits = false;
        self.counters.short_packets += 1;
    }

    fn end_read(&mut self, status: Status) {
        let ends = &mut self.ends;
        self.reads.end_first(|read| ends.ended(read.sequence, status, read.bytes.len() as u32, &read.bytes));
    }

    fn end_write(&mut self) {
        let ends = &mut self.ends;
        self.writes.end_first(|write| ends.ended(write.sequence, Status::Done, write.bytes.len() as u32, &[]));
    }

    fn stall(&mut self, sequence: u32) {
        self.ends.ended(sequence, Status::Stall, 0, &[]);
    }
}
