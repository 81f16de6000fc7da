//! Sync managers: areas of a slave's memory through which master and slave exchange consistent data.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{U16Le, bits};

/// Length in bytes of the registers of one sync manager.
pub const SYNC_MANAGER_LEN: usize = 8;

/// The operation mode of a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BufferMode {
    /// Buffered mode with three buffers: each side always has a buffer, and the reader gets the newest data.
    Buffered,
    /// Mailbox mode with one buffer: it can be written only when empty and read only when full.
    Mailbox,
    /// Modes 1 and 3, which are reserved.
    Unknown,
}

/// The transfer direction of a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SmDirection {
    /// The master reads the area: inputs or mailbox responses.
    Read,
    /// The master writes the area: outputs or mailbox requests.
    Write,
    /// Directions 2 and 3, which are reserved.
    Unknown,
}

bits! {
    /// The control byte: mode in bits 0 and 1, direction in bits 2 and 3, and flags.
    SmControl(u8) {
        /// Bit 4: accesses raise an event for the master.
        ECAT_EVENT = 1 << 4;
        /// Bit 5: accesses raise an event for the slave's processor.
        AL_EVENT = 1 << 5;
        /// Bit 6: a write triggers the watchdog.
        WATCHDOG = 1 << 6;
        /// 0x26: the control byte that most slaves use for the mailbox that the master writes.
        MAILBOX_OUT = 0x26;
        /// 0x22: the control byte that most slaves use for the mailbox that the master reads.
        MAILBOX_IN = 0x22;
        /// 0x64: the control byte for outputs, with watchdog trigger.
        OUTPUTS = 0x64;
        /// 0x20: the control byte for inputs.
        INPUTS = 0x20;
    }

    /// The status byte: the last written buffer in bits 4 and 5, and flags.
    SmStatus(u8) {
        /// Bit 0: a buffer has been written and not read yet.
        WRITTEN = 1 << 0;
        /// Bit 1: a buffer has been read and not written yet.
        READ = 1 << 1;
        /// Bit 3: the mailbox is full.
        FULL = 1 << 3;
        /// Bits 4 and 5, in buffered mode: the last written buffer, 0 to 2, or 3 for none.
        LAST_BUFFER = 0b11 << 4;
        /// Bit 6: a buffer is being read.
        READING = 1 << 6;
        /// Bit 7: a buffer is being written.
        WRITING = 1 << 7;
    }

    /// The activate byte, which the master writes.
    SmActivate(u8) {
        /// Bit 0: the sync manager is enabled.
        ENABLE = 1 << 0;
        /// Bit 1: toggled by the master to request the last mailbox message again.
        REPEAT = 1 << 1;
        /// Bit 6: the controller latches the time at which the master accesses the buffer (registers from 0x09F0).
        LATCH_ECAT = 1 << 6;
        /// Bit 7: the controller latches the time at which the slave accesses the buffer (registers from 0x09F0).
        LATCH_PDI = 1 << 7;
    }

    /// The PDI control byte, which the slave's processor writes.
    SmPdiControl(u8) {
        /// Bit 0: the slave has deactivated the sync manager.
        DEACTIVATE = 1 << 0;
        /// Bit 1: the slave sets it equal to [`SmActivate::REPEAT`] once it has repeated the message.
        REPEAT_ACKNOWLEDGE = 1 << 1;
    }
}

impl SmControl {
    /// The operation mode, bits 0 and 1.
    pub const fn mode(self) -> BufferMode {
        match self.0 & 0b11 {
            0 => BufferMode::Buffered,
            2 => BufferMode::Mailbox,
            _ => BufferMode::Unknown,
        }
    }

    /// The transfer direction, bits 2 and 3.
    pub const fn direction(self) -> SmDirection {
        match self.0 >> 2 & 0b11 {
            0 => SmDirection::Read,
            1 => SmDirection::Write,
            _ => SmDirection::Unknown,
        }
    }
}

impl SmStatus {
    /// This status with another last written buffer, 0 to 2; 3 for none.
    #[must_use]
    pub const fn with_last_buffer(self, buffer: u8) -> Self {
        Self(self.0 & !Self::LAST_BUFFER.0 | (buffer & 0b11) << 4)
    }

    /// The last written buffer, 0 to 2; 3 for none.
    pub const fn last_buffer(self) -> u8 {
        self.0 >> 4 & 0b11
    }
}

/// Wire layout of the registers. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Bytes 0..=1: start address.
    start: U16Le,
    /// Bytes 2..=3: length.
    len: U16Le,
    /// Byte 4: control byte.
    control: u8,
    /// Byte 5: status byte.
    status: u8,
    /// Byte 6: activate byte.
    activate: u8,
    /// Byte 7: PDI control byte.
    pdi: u8,
}

const _: () = assert!(size_of::<Layout>() == SYNC_MANAGER_LEN && align_of::<Layout>() == 1);

/// The registers of one sync manager.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SyncManager {
    /// Start address of the sync manager's area in the slave's memory.
    pub start: u16,
    /// Length of the sync manager's area, bytes.
    pub len: u16,
    /// Mode, direction, event enables, and watchdog trigger.
    pub control: SmControl,
    /// The state of the buffers.
    pub status: SmStatus,
    /// The master's control bits: enable, repeat request, latching.
    pub activate: SmActivate,
    /// The slave's control bits: deactivate, repeat acknowledge.
    pub pdi: SmPdiControl,
}

impl SyncManager {
    /// The registers of an enabled sync manager as a master writes them.
    pub const fn enabled(start: u16, len: u16, control: SmControl) -> Self {
        let (status, pdi) = (SmStatus::NONE, SmPdiControl::NONE);
        Self { start, len, control, status, activate: SmActivate::ENABLE, pdi }
    }

    /// Decodes the registers. Every bit pattern is valid.
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

    /// Whether the master has enabled the sync manager.
    pub const fn is_enabled(&self) -> bool {
        self.activate.contains(SmActivate::ENABLE)
    }
}
