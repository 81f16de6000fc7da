//! Categories with a fixed layout: general information, FMMUs, sync managers and distributed clocks.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::registers::SmControl;
use crate::ethercat::{I32Le, U16Le, U32Le, WireError, bits};

bits! {
    /// The CoE features of a slave.
    CoeDetails(u8) {
        /// Bit 0: SDO is supported.
        SDO = 1 << 0;
        /// Bit 1: SDO information is supported.
        SDO_INFO = 1 << 1;
        /// Bit 2: the PDO assignment can be changed.
        PDO_ASSIGN = 1 << 2;
        /// Bit 3: the PDO mapping can be changed.
        PDO_CONFIG = 1 << 3;
        /// Bit 4: at startup the master reads the PDO descriptions from the slave's object dictionary.
        UPLOAD = 1 << 4;
        /// Bit 5: SDO complete access is supported.
        COMPLETE_ACCESS = 1 << 5;
    }

    /// Flags in the general information about a slave.
    SiiGeneralFlags(u8) {
        /// Bit 0: the slave supports SafeOP.
        SAFEOP = 1 << 0;
        /// Bit 1: the slave does not support LRW.
        NO_LRW = 1 << 1;
        /// Bit 2: the mailbox has a data link layer, so that a lost message can be requested again.
        MAILBOX_LINK_LAYER = 1 << 2;
        /// Bit 3: the AL status code register can show the device identification.
        ID_IN_AL_STATUS = 1 << 3;
        /// Bit 4: the device identification is at an address in the slave's memory.
        ID_IN_MEMORY = 1 << 4;
    }

    /// The enable byte of a sync manager in the EEPROM.
    SiiSmEnable(u8) {
        /// Bit 0: the sync manager is enabled.
        ENABLE = 1 << 0;
        /// Bit 1: the content of the sync manager's area is fixed: it cannot be changed by another PDO assignment.
        FIXED = 1 << 1;
        /// Bit 2: a virtual sync manager, without hardware.
        VIRTUAL = 1 << 2;
        /// Bit 3: the sync manager is enabled only in OP.
        OP_ONLY = 1 << 3;
    }
}

/// General information about a slave. Texts are given as numbers of entries in the category of texts; 0: none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiGeneral {
    /// The number of the text with the group name.
    pub group: u8,
    /// The number of the text with the name of the picture with which configuration tools show the slave.
    pub image: u8,
    /// The number of the text with the order number. Some masters show it as the slave's name.
    pub order: u8,
    /// The number of the text with the device name.
    pub name: u8,
    /// The CoE features.
    pub coe: CoeDetails,
    /// 1 if the slave supports FoE.
    pub foe: u8,
    /// 1 if the slave supports EoE.
    pub eoe: u8,
    /// Flags of the slave: supported states, LRW, identification.
    pub flags: SiiGeneralFlags,
    /// The current that the slave draws from EBUS, mA; negative if the slave feeds current.
    pub ebus_current_ma: i16,
    /// The physical layer of ports 0 to 3, 0..=15: 0 none, 1 MII, 3 EBUS.
    pub ports: [u8; 4],
    /// The address of the device identification in the slave's memory.
    pub id_address: u16,
}

/// Wire layout of [`SiiGeneral`]. The comments of the fields give byte offsets.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct GeneralLayout {
    /// Byte 0: group.
    group: u8,
    image: u8,
    order: u8,
    name: u8,
    reserved: u8,
    /// Byte 5: CoE features.
    coe: u8,
    foe: u8,
    eoe: u8,
    /// Bytes 8..=10: SoE channels, DS402 channels and sync manager class; not used.
    channels: [u8; 3],
    /// Byte 11: flags.
    flags: u8,
    /// Bytes 12..=13: EBUS current.
    ebus_current: U16Le,
    /// Byte 14: the group, with the same value as in byte 0.
    group_again: u8,
    reserved_2: u8,
    /// Bytes 16..=17: physical layer, four bits per port.
    ports: U16Le,
    /// Bytes 18..=19: address of the device identification.
    id_address: U16Le,
    reserved_3: [u8; 12],
}

const _: () = assert!(size_of::<GeneralLayout>() == SiiGeneral::LEN && align_of::<GeneralLayout>() == 1);

impl SiiGeneral {
    /// Length of the category in bytes.
    pub const LEN: usize = 32;
    /// Length in bytes of the category in older EEPROMs, which end after the field `ports`.
    const LEN_MIN: usize = 18;

    /// Decodes the category. Fields beyond the end of a short category are 0.
    ///
    /// # Errors
    /// [`WireError::Short`]: fewer than 18 bytes.
    pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        if bytes.len() < Self::LEN_MIN {
            return Err(WireError::Short { part: "general category", needed: Self::LEN_MIN, found: bytes.len() });
        }
        let mut whole = [0; Self::LEN];
        let len = bytes.len().min(Self::LEN);
        whole[..len].copy_from_slice(&bytes[..len]);
        let layout: GeneralLayout = bytemuck::cast(whole);
        Ok(Self {
            group: layout.group,
            image: layout.image,
            order: layout.order,
            name: layout.name,
            coe: CoeDetails(layout.coe),
            foe: layout.foe,
            eoe: layout.eoe,
            flags: SiiGeneralFlags(layout.flags),
            ebus_current_ma: layout.ebus_current.get().cast_signed(),
            ports: [0, 4, 8, 12].map(|bit| (layout.ports.get() >> bit) as u8 & 0x0F),
            id_address: layout.id_address.get(),
        })
    }

    /// The category as bytes.
    pub fn encode(&self) -> [u8; Self::LEN] {
        let ports = self.ports.iter().rev().fold(0, |word, port| word << 4 | u16::from(port & 0x0F));
        bytemuck::cast(GeneralLayout {
            group: self.group,
            image: self.image,
            order: self.order,
            name: self.name,
            reserved: 0,
            coe: self.coe.0,
            foe: self.foe,
            eoe: self.eoe,
            channels: [0; 3],
            flags: self.flags.0,
            ebus_current: self.ebus_current_ma.cast_unsigned().into(),
            group_again: self.group,
            reserved_2: 0,
            ports: ports.into(),
            id_address: self.id_address.into(),
            reserved_3: [0; 12],
        })
    }
}

/// The use of an FMMU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FmmuUsage {
    /// 0 or 0xFF: unused.
    Unused(u8),
    /// 1: outputs.
    Outputs,
    /// 2: inputs.
    Inputs,
    /// 3: the status of the mailbox.
    MailboxState,
    /// Any other value.
    Unknown(u8),
}

impl FmmuUsage {
    /// The use that a code in the EEPROM stands for.
    pub const fn from_code(code: u8) -> Self {
        match code {
            0 | 0xFF => Self::Unused(code),
            1 => Self::Outputs,
            2 => Self::Inputs,
            3 => Self::MailboxState,
            code => Self::Unknown(code),
        }
    }

    /// The code in the EEPROM.
    pub const fn code(self) -> u8 {
        match self {
            Self::Outputs => 1,
            Self::Inputs => 2,
            Self::MailboxState => 3,
            Self::Unused(code) | Self::Unknown(code) => code,
        }
    }
}

/// The use of a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiiSmType {
    /// 0: unused.
    Unused,
    /// 1: the mailbox that the master writes.
    MailboxOut,
    /// 2: the mailbox that the master reads.
    MailboxIn,
    /// 3: outputs.
    Outputs,
    /// 4: inputs.
    Inputs,
    /// Any other value.
    Unknown(u8),
}

impl SiiSmType {
    /// The use that a code in the EEPROM stands for.
    pub const fn from_code(code: u8) -> Self {
        match code {
            0 => Self::Unused,
            1 => Self::MailboxOut,
            2 => Self::MailboxIn,
            3 => Self::Outputs,
            4 => Self::Inputs,
            code => Self::Unknown(code),
        }
    }

    /// The code in the EEPROM.
    pub const fn code(self) -> u8 {
        match self {
            Self::Unused => 0,
            Self::MailboxOut => 1,
            Self::MailboxIn => 2,
            Self::Outputs => 3,
            Self::Inputs => 4,
            Self::Unknown(code) => code,
        }
    }
}

/// The settings that a slave wants for a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiiSyncManager {
    /// Start address of the sync manager's area in the slave's memory.
    pub start: u16,
    /// Length of the sync manager's area, bytes.
    pub len: u16,
    /// Mode, direction, event enables, and watchdog trigger.
    pub control: SmControl,
    /// The status byte, not used.
    pub status: u8,
    /// Whether the sync manager is enabled, and whether only in OP.
    pub enable: SiiSmEnable,
    /// The use of the sync manager.
    pub kind: SiiSmType,
}

/// Wire layout of [`SiiSyncManager`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SyncManagerLayout {
    start: U16Le,
    len: U16Le,
    control: u8,
    status: u8,
    enable: u8,
    kind: u8,
}

impl SiiSyncManager {
    /// Length in bytes of the settings of one sync manager.
    pub const LEN: usize = 8;

    /// Decodes the settings of one sync manager.
    pub fn decode(bytes: &[u8; Self::LEN]) -> Self {
        let layout: &SyncManagerLayout = bytemuck::cast_ref(bytes);
        Self {
            start: layout.start.get(),
            len: layout.len.get(),
            control: SmControl(layout.control),
            status: layout.status,
            enable: SiiSmEnable(layout.enable),
            kind: SiiSmType::from_code(layout.kind),
        }
    }

    /// Encodes the settings of one sync manager.
    pub fn encode(&self) -> [u8; Self::LEN] {
        bytemuck::cast(SyncManagerLayout {
            start: self.start.into(),
            len: self.len.into(),
            control: self.control.0,
            status: self.status,
            enable: self.enable.0,
            kind: self.kind.code(),
        })
    }
}

/// A mode of distributed clocks that a slave supports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiDcMode {
    /// The cycle time of SYNC0, ns; 0: SYNC0 follows the cycle time of the master, by [`Self::factor0`].
    pub cycle0_ns: u32,
    /// The shift time of SYNC0, ns.
    pub shift0_ns: i32,
    /// The shift time of SYNC1, ns.
    pub shift1_ns: i32,
    /// The cycle time of SYNC1 as a multiple of that of SYNC0.
    pub factor1: i16,
    /// The value for registers 0x0980 (low byte) and 0x0981 (high byte).
    pub assign_activate: u16,
    /// The cycle time of SYNC0 as a multiple of the master's cycle time.
    pub factor0: i16,
    /// The number of the text with the mode's name; 0: none.
    pub name: u8,
    /// The number of the text with the mode's description; 0: none.
    pub description: u8,
}

/// Wire layout of [`SiiDcMode`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct DcLayout {
    cycle0: U32Le,
    shift0: I32Le,
    shift1: I32Le,
    factor1: U16Le,
    assign_activate: U16Le,
    factor0: U16Le,
    name: u8,
    description: u8,
    reserved: [u8; 4],
}

const _: () = assert!(size_of::<DcLayout>() == SiiDcMode::LEN && align_of::<DcLayout>() == 1);

impl SiiDcMode {
    /// Length in bytes of one mode of distributed clocks.
    pub const LEN: usize = 24;

    /// Decodes one mode of distributed clocks.
    pub fn decode(bytes: &[u8; Self::LEN]) -> Self {
        let layout: &DcLayout = bytemuck::cast_ref(bytes);
        Self {
            cycle0_ns: layout.cycle0.get(),
            shift0_ns: layout.shift0.get(),
            shift1_ns: layout.shift1.get(),
            factor1: layout.factor1.get().cast_signed(),
            assign_activate: layout.assign_activate.get(),
            factor0: layout.factor0.get().cast_signed(),
            name: layout.name,
            description: layout.description,
        }
    }

    /// Encodes one mode of distributed clocks.
    pub fn encode(&self) -> [u8; Self::LEN] {
        bytemuck::cast(DcLayout {
            cycle0: self.cycle0_ns.into(),
            shift0: self.shift0_ns.into(),
            shift1: self.shift1_ns.into(),
            factor1: self.factor1.cast_unsigned().into(),
            assign_activate: self.assign_activate.into(),
            factor0: self.factor0.cast_unsigned().into(),
            name: self.name,
            description: self.description,
            reserved: [0; 4],
        })
    }
}
