//! Sync managers: areas of a slave's memory that both sides exchange consistently.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{U16Le, bits};

/// Bytes of the registers of one sync manager.
pub const SYNC_MANAGER_LEN: usize = 8;

/// How the two sides of a sync manager take turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BufferMode {
    /// Three buffers: each side always has one, and the reader gets the newest.
    Buffered,
    /// One buffer: it is written when empty, and read when full.
    Mailbox,
    /// Modes 1 and 3, which have no meaning.
    Unknown,
}

/// Which side writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SmDirection {
    /// The master reads: inputs, answers.
    Read,
    /// The master writes: outputs, requests.
    Write,
    /// Directions 2 and 3, which have no meaning.
    Unknown,
}

bits! {
    /// The control byte: mode in bits 0 and 1, direction in bits 2 and 3, and flags.
    SmControl(u8) {
        /// Bit 4: an event for the master.
        ECAT_EVENT = 1 << 4;
        /// Bit 5: an event for the slave's own controller.
        AL_EVENT = 1 << 5;
        /// Bit 6: a write triggers the watchdog.
        WATCHDOG = 1 << 6;
        /// 0x26: the mailbox that the master writes, as most descriptions of slaves have it.
        MAILBOX_OUT = 0x26;
        /// 0x22: the mailbox that the master reads.
        MAILBOX_IN = 0x22;
        /// 0x64: outputs, with watchdog.
        OUTPUTS = 0x64;
        /// 0x20: inputs.
        INPUTS = 0x20;
    }

    /// The status byte: the buffer that was written last in bits 4 and 5, and flags.
    SmStatus(u8) {
        /// Bit 0: a buffer was written and not read yet.
        WRITTEN = 1 << 0;
        /// Bit 1: a buffer was read and not written yet.
        READ = 1 << 1;
        /// Bit 3: the mailbox is full.
        FULL = 1 << 3;
        /// Bits 4 and 5: 0 to 2, or 3 for none, in the mode with three buffers.
        LAST_BUFFER = 0b11 << 4;
        /// Bit 6: a buffer is being read.
        READING = 1 << 6;
        /// Bit 7: a buffer is being written.
        WRITING = 1 << 7;
    }

    /// The byte by which a master activates.
    SmActivate(u8) {
        /// Bit 0: the sync manager is enabled.
        ENABLE = 1 << 0;
        /// Bit 1: a change asks for the last message once more.
        REPEAT = 1 << 1;
        /// Bit 6: the event time is latched for accesses of the master.
        LATCH_ECAT = 1 << 6;
        /// Bit 7: the event time is latched for accesses of the slave.
        LATCH_PDI = 1 << 7;
    }

    /// The byte that belongs to the slave's own controller.
    SmPdiControl(u8) {
        /// Bit 0: the slave has deactivated the sync manager.
        DEACTIVATE = 1 << 0;
        /// Bit 1: equal to [`SmActivate::REPEAT`] once a repeat was done.
        REPEAT_ACKNOWLEDGE = 1 << 1;
    }
}

impl SmControl {
    /// The mode, bits 0 and 1.
    pub const fn mode(self) -> BufferMode {
        match self.0 & 0b11 {
            0 => BufferMode::Buffered,
            2 => BufferMode::Mailbox,
            _ => BufferMode::Unknown,
        }
    }

    /// The direction, bits 2 and 3.
    pub const fn direction(self) -> SmDirection {
        match self.0 >> 2 & 0b11 {
            0 => SmDirection::Read,
            1 => SmDirection::Write,
            _ => SmDirection::Unknown,
        }
    }
}

impl SmStatus {
    /// The status with the number of the buffer that was written last; 3 for none.
    #[must_use]
    pub const fn with_last_buffer(self, buffer: u8) -> Self {
        Self(self.0 & !Self::LAST_BUFFER.0 | (buffer & 0b11) << 4)
    }

    /// The buffer that was written last, 3 for none.
    pub const fn last_buffer(self) -> u8 {
        self.0 >> 4 & 0b11
    }
}

/// The registers as bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// 0.
    start: U16Le,
    /// 2.
    len: U16Le,
    /// 4.
    control: u8,
    /// 5.
    status: u8,
    /// 6.
    activate: u8,
    /// 7.
    pdi: u8,
}

const _: () = assert!(size_of::<Layout>() == SYNC_MANAGER_LEN && align_of::<Layout>() == 1);

/// The registers of one sync manager.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SyncManager {
    /// The address of its area.
    pub start: u16,
    /// The length of its area, bytes.
    pub len: u16,
    /// Mode, direction, events, watchdog.
    pub control: SmControl,
    /// What both sides have done.
    pub status: SmStatus,
    /// What the master wants.
    pub activate: SmActivate,
    /// What the slave wants.
    pub pdi: SmPdiControl,
}

impl SyncManager {
    /// The registers of an enabled sync manager as masters write them.
    pub const fn enabled(start: u16, len: u16, control: SmControl) -> Self {
        let (status, pdi) = (SmStatus::NONE, SmPdiControl::NONE);
        Self { start, len, control, status, activate: SmActivate::ENABLE, pdi }
    }

    /// Decodes the registers. Every pattern of bits is valid.
    pub fn decode(bytes: &[u8; SYNC_MANAGER_LEN]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        Self {
            start: layout.start.get(),
            len: layout.len.get(),
            control: SmControl(layout.control),
            status: SmStatus(layout.status),
            activate: SmActivate(layout.activate),
            pdi: SmPdiControl(layout.pdi),
        }
    }

    /// The registers as bytes.
    pub fn encode(&self) -> [u8; SYNC_MANAGER_LEN] {
        bytemuck::cast(Layout {
            start: self.start.into(),
            len: self.len.into(),
            control: self.control.0,
            status: self.status.0,
            activate: self.activate.0,
            pdi: self.pdi.0,
        })
    }

    /// Whether the master has enabled it.
    pub const fn is_enabled(&self) -> bool {
        self.activate.contains(SmActivate::ENABLE)
    }
}
