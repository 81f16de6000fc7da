//! One sync manager: its registers, and which of its buffers the writer and the reader use.

use crate::ethercat::registers::{BufferMode, RAM, SmDirection, SmPdiControl, SmStatus, SyncManager};

/// One sync manager: its registers, and which of its buffers are in use.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Manager {
    pub(super) registers: SyncManager,
    /// The last written buffer; `None` if no buffer was written.
    pub(super) last: Option<u8>,
    /// The buffer that the writer has opened; `None` if there is none.
    pub(super) writing: Option<u8>,
    /// The buffer that the reader has opened; `None` if there is none.
    pub(super) reading: Option<u8>,
    /// The distance between the three buffers, bytes: the length of one buffer; or 0 for a length of one byte, where all three
    /// are the same byte.
    pub(super) distance: u16,
}

/// The two sides of a sync manager: one writes its buffer, the other reads it. The control byte determines which side is
/// the network and which the slave's processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Writer,
    Reader,
}

impl Manager {
    pub(super) fn area(&self) -> std::ops::Range<usize> {
        let start = usize::from(self.registers.start);
        start..start + usize::from(self.registers.len)
    }

    pub(super) fn is_active(&self) -> bool {
        self.registers.is_enabled() && self.registers.len > 0
    }

    /// Whether the slave's processor may use the sync manager: it is active and not placed over registers.
    pub(super) fn is_usable(&self) -> bool {
        self.is_active() && self.registers.start >= RAM
    }

    pub(super) fn is_mailbox(&self) -> bool {
        self.registers.control.mode() == BufferMode::Mailbox
    }

    /// The address of the first byte of a buffer.
    pub(super) fn buffer_start(&self, buffer: u8) -> usize {
        usize::from(self.registers.start) + usize::from(buffer) * usize::from(self.distance)
    }

    /// Opens a buffer for the writer or the reader and returns its number: 0 in mailbox mode, 0 to 2 in buffered mode. `None`
    /// if the writer finds the mailbox full, or the reader finds it empty.
    pub(super) fn open(&mut self, side: Side) -> Option<u8> {
        let is_full = self.registers.status.contains(SmStatus::FULL);
        let buffer = match (side, self.is_mailbox()) {
            (Side::Writer, true) if is_full => return None,
            (Side::Reader, true) if !is_full => return None,
            (_, true) => 0,
            (Side::Writer, false) => {
                (0..3).find(|buffer| Some(*buffer) != self.last && Some(*buffer) != self.reading)?
            }
            (Side::Reader, false) => self.last.unwrap_or(0),
        };
        let status = &mut self.registers.status;
        match side {
            Side::Writer => {
                self.writing = Some(buffer);
                *status = status.without(SmStatus::READ).with(SmStatus::WRITING);
            }
            Side::Reader => {
                self.reading = Some(buffer);
                *status = status.without(SmStatus::WRITTEN).with(SmStatus::READING);
            }
        }
        Some(buffer)
    }

    /// Closes the buffer of a side after its last byte was accessed.
    pub(super) fn close(&mut self, side: Side) {
        let is_mailbox = self.is_mailbox();
        let status = &mut self.registers.status;
        match side {
            Side::Writer => {
                *status = status.without(SmStatus::WRITING).with(SmStatus::WRITTEN);
                let buffer = self.writing.take();
                if is_mailbox {
                    *status = status.with(SmStatus::FULL);
                } else {
                    self.last = buffer;
                    *status = status.with_last_buffer(buffer.unwrap_or(3));
                }
            }
            Side::Reader => {
                self.reading = None;
                *status = status.without(SmStatus::READING).with(SmStatus::READ);
                if is_mailbox {
                    *status = status.without(SmStatus::FULL);
                }
            }
        }
    }

    /// Marks the next of the three buffers as written and returns its address, at which the caller writes the whole data.
    /// The caller is the network or the slave's processor.
    #[inline]
    pub(super) fn fill(&mut self) -> usize {
        let is_taken = |buffer| Some(buffer) == self.last || Some(buffer) == self.reading;
        let buffer = if !is_taken(0) {
            0
        } else if !is_taken(1) {
            1
        } else {
            2
        };
        (self.last, self.writing) = (Some(buffer), None);
        let status = self.registers.status.without(SmStatus::READ).without(SmStatus::WRITING);
        self.registers.status = status.with(SmStatus::WRITTEN).with_last_buffer(buffer);
        self.buffer_start(buffer)
    }

    /// Marks the newest of the three buffers as read and returns its address, from which the caller reads the whole data.
    /// The caller is the network or the slave's processor.
    #[inline]
    pub(super) fn drain(&mut self) -> usize {
        self.reading = None;
        let status = self.registers.status.without(SmStatus::WRITTEN).without(SmStatus::READING);
        self.registers.status = status.with(SmStatus::READ);
        self.buffer_start(self.last.unwrap_or(0))
    }

    /// Whether the network may access the sync manager as its writer or as its reader: the direction in the control
    /// byte assigns this side to the network, the mode is valid, and the slave has not deactivated the sync manager.
    pub(super) fn is_open_to(&self, side: Side) -> bool {
        let SyncManager { control, pdi, .. } = self.registers;
        let wanted = if side == Side::Writer { SmDirection::Write } else { SmDirection::Read };
        control.direction() == wanted
            && control.mode() != BufferMode::Unknown
            && !pdi.contains(SmPdiControl::DEACTIVATE)
    }

    /// The buffer that a side accesses at `offset` bytes from the start of the area; offset 0 opens a buffer. `None` if no
    /// buffer is open or can be opened.
    pub(super) fn buffer(&mut self, side: Side, offset: usize) -> Option<u8> {
        if offset == 0 {
            return self.open(side);
        }
        match side {
            Side::Writer => self.writing,
            Side::Reader => self.reading,
        }
    }
}
