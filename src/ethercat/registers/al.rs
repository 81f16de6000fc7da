//! Registers of the application layer: AL control, AL status, and the event requests for the master and for the slave.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{AlState, AlStatus, U16Le, bits};

/// The state in an AL control or AL status register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestedState {
    /// Init, PreOP, SafeOP or OP.
    State(AlState),
    /// 3: Bootstrap, for the download of firmware by FoE.
    Boot,
    /// Any other value, 0..=15.
    Unknown(u8),
}

impl RequestedState {
    /// The state with this code in the register. Only the lower 4 bits of the code are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 0x0F {
            1 => Self::State(AlState::Init),
            2 => Self::State(AlState::PreOp),
            3 => Self::Boot,
            4 => Self::State(AlState::SafeOp),
            8 => Self::State(AlState::Op),
            code => Self::Unknown(code),
        }
    }

    /// The requested AL state, for a slave that does not support Bootstrap.
    ///
    /// # Errors
    /// The AL status code with which the slave refuses: [`AlStatus::BOOT_UNSUPPORTED`] or [`AlStatus::UNKNOWN_STATE`].
    pub const fn without_boot(self) -> Result<AlState, AlStatus> {
        match self {
            Self::State(state) => Ok(state),
            Self::Boot => Err(AlStatus::BOOT_UNSUPPORTED),
            Self::Unknown(_) => Err(AlStatus::UNKNOWN_STATE),
        }
    }

    /// The code in the register, 0..=15.
    pub const fn code(self) -> u8 {
        match self {
            Self::State(state) => state as u8,
            Self::Boot => 3,
            Self::Unknown(code) => code & 0x0F,
        }
    }
}

bits! {
    /// AL control, 0x0120: the requested state in bits 0 to 3, and flags.
    AlControl(u16) {
        /// Bit 4: the master acknowledges the error that [`AlStatusRegister::ERROR`] shows.
        ACKNOWLEDGE = 1 << 4;
        /// Bit 5: the master asks for the device's identification. The slave puts it into the AL status code and sets
        /// [`AlStatusRegister::ID_LOADED`].
        REQUEST_ID = 1 << 5;
    }

    /// AL status, 0x0130: the current state in bits 0 to 3, and flags.
    AlStatusRegister(u16) {
        /// Bit 4: error. The slave has refused a change of state or left a state; the AL status code gives the reason.
        ERROR = 1 << 4;
        /// Bit 5: the AL status code is the device's identification.
        ID_LOADED = 1 << 5;
    }

    /// The bits of the ECAT event request 0x0210, of its mask 0x0200, and of the `irq` field of a datagram.
    EcatEvents(u16) {
        /// Bit 0: a latch input has captured the time of an edge.
        DC_LATCH = 1 << 0;
        /// Bit 2: DL status has changed.
        DL_STATUS = 1 << 2;
        /// Bit 3: the slave has written AL status.
        AL_STATUS = 1 << 3;
        /// Bits 4 to 11: the events of sync managers 0 to 7.
        SYNC_MANAGER_0 = 1 << 4;
    }

    /// AL event request, 0x0220: events for the processor of the slave.
    AlEvents(u32) {
        /// Bit 0: the master has written AL control.
        AL_CONTROL = 1 << 0;
        /// Bit 1: a latch input has captured the time of an edge.
        DC_LATCH = 1 << 1;
        /// Bit 2: a pulse of SYNC0.
        SYNC0 = 1 << 2;
        /// Bit 3: a pulse of SYNC1.
        SYNC1 = 1 << 3;
        /// Bit 4: the master has enabled or disabled a sync manager, or has requested a mailbox repeat.
        SM_ACTIVATION = 1 << 4;
        /// Bit 5: a command is pending for an EEPROM that the slave's processor emulates.
        EEPROM = 1 << 5;
        /// Bit 6: the process data watchdog has expired.
        WATCHDOG = 1 << 6;
        /// Bits 8 to 23: the events of sync managers 0 to 15.
        SYNC_MANAGER_0 = 1 << 8;
    }
}

impl AlControl {
    /// The value that requests a state, without flags.
    pub const fn request(state: RequestedState) -> Self {
        Self(state.code() as u16)
    }

    /// The requested state.
    pub const fn state(self) -> RequestedState {
        RequestedState::from_code(self.0 as u8)
    }
}

impl AlStatusRegister {
    /// The value for a state, without flags.
    pub const fn of(state: RequestedState) -> Self {
        Self(state.code() as u16)
    }

    /// The current state.
    pub const fn state(self) -> RequestedState {
        RequestedState::from_code(self.0 as u8)
    }
}

impl EcatEvents {
    /// The event bit of sync manager `n`; no bit for `n` above 7.
    pub const fn sync_manager(n: u8) -> Self {
        if n < 8 { Self(Self::SYNC_MANAGER_0.0 << n) } else { Self::NONE }
    }
}

impl AlEvents {
    /// The event bit of sync manager `n`; no bit for `n` above 15.
    pub const fn sync_manager(n: u8) -> Self {
        if n < 16 { Self(Self::SYNC_MANAGER_0.0 << n) } else { Self::NONE }
    }
}

/// AL status and AL status code. Masters read both with one datagram (6 bytes from 0x0130), so that the code belongs to
/// the status.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AlStatusWithCode {
    /// AL status, register 0x0130.
    pub status: AlStatusRegister,
    /// AL status code, register 0x0134.
    pub code: AlStatus,
}

/// Wire layout of the two registers and the gap between them. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// Bytes 0..=1: AL status.
    status: U16Le,
    /// Bytes 2..=3: reserved.
    gap: U16Le,
    /// Bytes 4..=5: AL status code.
    code: U16Le,
}

impl AlStatusWithCode {
    /// Decodes the six bytes from 0x0130.
    pub fn decode(bytes: &[u8; 6]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        Self { status: AlStatusRegister(layout.status.get()), code: AlStatus(layout.code.get()) }
    }

    /// Encodes the six bytes from 0x0130. The bytes between the registers are 0.
    pub fn encode(&self) -> [u8; 6] {
        bytemuck::cast(Layout { status: self.status.0.into(), gap: 0.into(), code: self.code.0.into() })
    }
}
