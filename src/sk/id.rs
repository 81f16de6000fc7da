//! The ids of the 22 commands, and which slot takes which of them (UG17 1.8, table 1.3).
//!
//! A new command of the board begins here: its id, and its slot in [`CommandId::belongs_in`]. The compiler then names the
//! other places.

use core::fmt;

macro_rules! command_ids {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $text:literal;)*) => {
        /// Byte 0 of a command slot. A code that no guide lists is kept as [`CommandId::Unknown`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum CommandId {
            $($(#[$doc])* #[doc = concat!("`", $text, "`, ", stringify!($code), ".")] #[doc(alias = $text)] $name,)*
            /// Any other code.
            Unknown(u8),
        }

        impl CommandId {
            /// The 22 commands in the order of their codes.
            pub const ALL: [Self; 22] = [$(Self::$name,)*];

            /// The id with this code.
            #[inline]
            pub const fn from_code(code: u8) -> Self {
                BY_CODE[code as usize]
            }

            /// The code on the wire.
            #[inline]
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$name => $code,)*
                    Self::Unknown(code) => code,
                }
            }

            /// The name that the guides use, `UNKNOWN` for a code they do not list.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                    Self::Unknown(_) => "UNKNOWN",
                }
            }
        }
    };
}

/// The id of every code, as a table because the engine looks one up for each slot in each cycle.
static BY_CODE: [CommandId; 256] = {
    let mut ids = [CommandId::Unknown(0); 256];
    let mut code = 0;
    while code < ids.len() {
        ids[code] = CommandId::Unknown(code as u8);
        code += 1;
    }
    let mut n = 0;
    while n < CommandId::ALL.len() {
        ids[CommandId::ALL[n].code() as usize] = CommandId::ALL[n];
        n += 1;
    }
    ids
};

command_ids! {
    GetStatus = 0x00, "GET_STATUS";
    SetState = 0x01, "SET_STATE";
    SetAxis = 0x02, "SET_AXIS";
    SetDc = 0x03, "SET_DC";
    SetEx = 0x04, "SET_EX";
    SetFifo = 0x05, "SET_FIFO";
    DriveMode = 0x06, "DRIVE_MODE";
    SdoRead = 0x07, "SDO_RD";
    SdoWrite = 0x08, "SDO_WR";
    AlarmClear = 0x10, "ALM_CLR";
    ServoOn = 0x11, "SV_ON";
    ServoOff = 0x12, "SV_OFF";
    IoRead = 0x13, "IO_RD";
    IoWrite = 0x14, "IO_WR";
    Csp = 0x15, "CSP";
    Csv = 0x16, "CSV";
    Cst = 0x17, "CST";
    GoHome = 0x18, "GO_HOME";
    AbortHome = 0x19, "ABORT_HOME";
    LocalRead = 0x21, "LIO_RD";
    LocalWrite = 0x22, "LIO_WR";
    SoftReset = 0xBB, "SW_RESET";
}

/// What a slot of a frame is for. Each of the three kinds takes its own commands: the columns of the table in UG17 1.8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotKind {
    /// Slot 0: commands for the board itself.
    Master,
    /// Slots 1..=40 (30): commands for one slave each.
    Slave,
    /// The last slot: SDO transfers.
    Sdo,
}

impl SlotKind {
    /// All kinds, in the order of their slots in a frame.
    pub const ALL: [Self; 3] = [Self::Master, Self::Slave, Self::Sdo];
}

impl CommandId {
    /// Whether this command may stand in slots of that kind (UG17 1.8). GET_STATUS may stand in every slot, an unknown code
    /// in none.
    #[inline]
    pub const fn belongs_in(self, slot: SlotKind) -> bool {
        match self {
            Self::GetStatus => true,
            Self::SetState
            | Self::SetAxis
            | Self::SetDc
            | Self::SetEx
            | Self::SetFifo
            | Self::LocalRead
            | Self::LocalWrite
            | Self::SoftReset => matches!(slot, SlotKind::Master),
            Self::SdoRead | Self::SdoWrite => matches!(slot, SlotKind::Sdo),
            Self::DriveMode
            | Self::AlarmClear
            | Self::ServoOn
            | Self::ServoOff
            | Self::IoRead
            | Self::IoWrite
            | Self::Csp
            | Self::Csv
            | Self::Cst
            | Self::GoHome
            | Self::AbortHome => matches!(slot, SlotKind::Slave),
            Self::Unknown(_) => false,
        }
    }
}

impl fmt::Display for CommandId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(code) => write!(f, "UNKNOWN(0x{code:02X})"),
            known => f.write_str(known.name()),
        }
    }
}
