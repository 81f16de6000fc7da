//! Categories of fixed layouts: general information, FMMUs, sync managers, distributed clocks.

use bytemuck::{Pod, Zeroable};

use crate::ethercat::registers::SmControl;
use crate::ethercat::{I32Le, U16Le, U32Le, WireError, bits};

bits! {
    /// What a slave's CANopen over EtherCAT can do.
    CoeDetails(u8) {
        /// Bit 0: SDO.
        SDO = 1 << 0;
        /// Bit 1: SDO information.
        SDO_INFO = 1 << 1;
        /// Bit 2: PDOs can be assigned.
        PDO_ASSIGN = 1 << 2;
        /// Bit 3: PDOs can be configured.
        PDO_CONFIG = 1 << 3;
        /// Bit 4: the dictionary is uploaded at the start.
        UPLOAD = 1 << 4;
        /// Bit 5: complete access.
        COMPLETE_ACCESS = 1 << 5;
    }

    /// Flags of a slave.
    SiiGeneralFlags(u8) {
        /// Bit 0: SafeOP is allowed.
        SAFEOP = 1 << 0;
        /// Bit 1: no LRW.
        NO_LRW = 1 << 1;
        /// Bit 2: the mailbox has a data link layer.
        MAILBOX_LINK_LAYER = 1 << 2;
        /// Bit 3: the identification is shown as AL status code.
        ID_IN_AL_STATUS = 1 << 3;
        /// Bit 4: the identification is at an address in the memory.
        ID_IN_MEMORY = 1 << 4;
    }

    /// Whether a sync manager is enabled.
    SiiSmEnable(u8) {
        /// Bit 0: it is enabled.
        ENABLE = 1 << 0;
        /// Bit 1: its content is fixed.
        FIXED = 1 << 1;
        /// Bit 2: it uses no hardware.
        VIRTUAL = 1 << 2;
        /// Bit 3: it is enabled in OP only.
        OP_ONLY = 1 << 3;
    }
}

/// General information about a slave. Texts are numbers of the category of texts; 0: none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiGeneral {
    /// The text of the group.
    pub group: u8,
    /// The text of the image.
    pub image: u8,
    /// The text of the order number, by which some masters name the slave.
    pub order: u8,
    /// The text of the name.
    pub name: u8,
    /// What its CANopen can do.
    pub coe: CoeDetails,
    /// 1: it has file access.
    pub foe: u8,
    /// 1: it has Ethernet.
    pub eoe: u8,
    /// Flags.
    pub flags: SiiGeneralFlags,
    /// How much it takes from EBUS, mA; negative: it feeds.
    pub ebus_current_ma: i16,
    /// The physical layer of ports 0 to 3: 0 none, 1 MII, 3 EBUS, 0..=15.
    pub ports: [u8; 4],
    /// Where the identification is in the memory.
    pub id_address: u16,
}

/// [`SiiGeneral`] as bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct GeneralLayout {
    /// 0.
    group: u8,
    image: u8,
    order: u8,
    name: u8,
    reserved: u8,
    /// 5.
    coe: u8,
    foe: u8,
    eoe: u8,
    /// 8: channels of SoE and of DS402, and a class of sync managers, of which nothing is used.
    channels: [u8; 3],
    /// 11.
    flags: u8,
    /// 12.
    ebus_current: U16Le,
    /// 14.
    group_again: u8,
    reserved_2: u8,
    /// 16: four bits a port.
    ports: U16Le,
    /// 18.
    id_address: U16Le,
    reserved_3: [u8; 12],
}

const _: () = assert!(size_of::<GeneralLayout>() == SiiGeneral::LEN && align_of::<GeneralLayout>() == 1);

impl SiiGeneral {
    /// Bytes of the category.
    pub const LEN: usize = 32;
    /// Bytes of the category in older EEPROMs: up to the ports.
    const LEN_MIN: usize = 18;

    /// Decodes the category. What a shorter one does not have is 0.
    ///
    /// # Errors
    /// [`WireError::Short`]: less than 18 bytes.
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

/// What an FMMU is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FmmuUsage {
    /// 0 or 0xFF: nothing.
    Unused(u8),
    /// 1: outputs.
    Outputs,
    /// 2: inputs.
    Inputs,
    /// 3: the state of the mailbox.
    MailboxState,
    /// Another value.
    Unknown(u8),
}

impl FmmuUsage {
    /// The use with that code.
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

/// What a sync manager is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiiSmType {
    /// 0: nothing.
    Unused,
    /// 1: the mailbox that the master writes.
    MailboxOut,
    /// 2: the mailbox that the master reads.
    MailboxIn,
    /// 3: outputs.
    Outputs,
    /// 4: inputs.
    Inputs,
    /// Another value.
    Unknown(u8),
}

impl SiiSmType {
    /// The type with that code.
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

/// A sync manager as its slave wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiiSyncManager {
    /// The address of its area.
    pub start: u16,
    /// The length of its area, bytes.
    pub len: u16,
    /// Mode, direction, events, watchdog.
    pub control: SmControl,
    /// Not used.
    pub status: u8,
    /// Whether it is enabled.
    pub enable: SiiSmEnable,
    /// What it is for.
    pub kind: SiiSmType,
}

/// [`SiiSyncManager`] as bytes.
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
    /// Bytes of one of the category.
    pub const LEN: usize = 8;

    /// Decodes one.
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

    /// One as bytes.
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

/// A mode of distributed clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SiiDcMode {
    /// The cycle of SYNC0, ns; 0: that of the master.
    pub cycle0_ns: u32,
    /// The shift of SYNC0, ns.
    pub shift0_ns: i32,
    /// The shift of SYNC1, ns.
    pub shift1_ns: i32,
    /// The factor of SYNC1.
    pub factor1: i16,
    /// What goes into registers 0x0980 (low byte) and 0x0981.
    pub assign_activate: u16,
    /// The factor of SYNC0.
    pub factor0: i16,
    /// The text of its name, 0: none.
    pub name: u8,
    /// The text of its description, 0: none.
    pub description: u8,
}

/// [`SiiDcMode`] as bytes.
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
    /// Bytes of one of the category.
    pub const LEN: usize = 24;

    /// Decodes one.
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

    /// One as bytes.
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
