//! Registers of the application layer: AL control, AL status, and events for both sides.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::{AlState, AlStatus, U16Le, bits};

/// The state in an AL control or AL status register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestedState {
    /// Init, PreOP, SafeOP or OP.
    State(AlState),
    /// 3: Bootstrap, for firmware.
    Boot,
    /// Another value, 0..=15.
    Unknown(u8),
}

impl RequestedState {
    /// The state with that code; of the code the lower 4 bits count.
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

    /// The state, for a slave without Bootstrap.
    ///
    /// # Errors
    /// The AL status code of such a slave: [`AlStatus::BOOT_UNSUPPORTED`], [`AlStatus::UNKNOWN_STATE`].
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
    /// AL control, 0x0120: the state in bits 0 to 3, and flags.
    AlControl(u16) {
        /// Bit 4: the error is acknowledged.
        ACKNOWLEDGE = 1 << 4;
        /// Bit 5: the master asks for the device's identification.
        REQUEST_ID = 1 << 5;
    }

    /// AL status, 0x0130: the state in bits 0 to 3, and flags.
    AlStatusRegister(u16) {
        /// Bit 4: a change of state was refused, or a state was left; the AL status code says why.
        ERROR = 1 << 4;
        /// Bit 5: the AL status code is the device's identification.
        ID_LOADED = 1 << 5;
    }

    /// Events for the master, 0x0210, its mask, 0x0200, and the field `irq` of a datagram.
    EcatEvents(u16) {
        /// Bit 0: a latch of distributed clocks.
        DC_LATCH = 1 << 0;
        /// Bit 2: DL status has changed.
        DL_STATUS = 1 << 2;
        /// Bit 3: AL status was written.
        AL_STATUS = 1 << 3;
        /// Bits 4 to 11: the events of sync managers 0 to 7.
        SYNC_MANAGER_0 = 1 << 4;
    }

    /// Events for the slave's own controller, 0x0220.
    AlEvents(u32) {
        /// Bit 0: AL control was written.
        AL_CONTROL = 1 << 0;
        /// Bit 1: a latch of distributed clocks.
        DC_LATCH = 1 << 1;
        /// Bit 2: a pulse of SYNC0.
        SYNC0 = 1 << 2;
        /// Bit 3: a pulse of SYNC1.
        SYNC1 = 1 << 3;
        /// Bit 4: a sync manager was enabled, disabled or asked for a repeat.
        SM_ACTIVATION = 1 << 4;
        /// Bit 5: a command for an emulated EEPROM.
        EEPROM = 1 << 5;
        /// Bit 6: the watchdog of process data has expired.
        WATCHDOG = 1 << 6;
        /// Bits 8 to 23: the events of sync managers 0 to 15.
        SYNC_MANAGER_0 = 1 << 8;
    }
}

impl AlControl {
    /// The request for a state.
    pub const fn request(state: RequestedState) -> Self {
        Self(state.code() as u16)
    }

    /// The state that is asked for.
    pub const fn state(self) -> RequestedState {
        RequestedState::from_code(self.0 as u8)
    }
}

impl AlStatusRegister {
    /// The status of a slave in a state, without flags.
    pub const fn of(state: RequestedState) -> Self {
        Self(state.code() as u16)
    }

    /// The state.
    pub const fn state(self) -> RequestedState {
        RequestedState::from_code(self.0 as u8)
    }
}

impl EcatEvents {
    /// The bit of the event of sync manager `n`; none above 7.
    pub const fn sync_manager(n: u8) -> Self {
        if n < 8 { Self(Self::SYNC_MANAGER_0.0 << n) } else { Self::NONE }
    }
}

impl AlEvents {
    /// The bit of the event of sync manager `n`; none above 15.
    pub const fn sync_manager(n: u8) -> Self {
        if n < 16 { Self(Self::SYNC_MANAGER_0.0 << n) } else { Self::NONE }
    }
}

/// AL status with its code, as masters read both: 6 bytes from 0x0130.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AlStatusWithCode {
    /// 0x0130.
    pub status: AlStatusRegister,
    /// 0x0134.
    pub code: AlStatus,
}

/// The two registers and what lies between them.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Layout {
    /// 0.
    status: U16Le,
    /// 2.
    gap: U16Le,
    /// 4.
    code: U16Le,
}

impl AlStatusWithCode {
    /// Decodes the six bytes.
    pub fn decode(bytes: &[u8; 6]) -> Self {
        let layout: &Layout = bytemuck::cast_ref(bytes);
        Self { status: AlStatusRegister(layout.status.get()), code: AlStatus(layout.code.get()) }
    }

    /// The six bytes; those between the registers are 0.
    pub fn encode(&self) -> [u8; 6] {
        bytemuck::cast(Layout { status: self.status.0.into(), gap: 0.into(), code: self.code.0.into() })
    }
}
