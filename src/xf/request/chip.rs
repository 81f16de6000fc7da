//! Requests for the chip itself: packets, check words, version, resets, error counts, PHY.

use crate::ethercat::bits;
use crate::xf::fields::{FieldKind, Names};
use crate::xf::layout::{field_values, layout};
use crate::xf::{CheckType, DataSize, Malformed};

layout! {
    /// SPI_PACK_SIZE_GET, command code 20: reads n, the size of the data segment (XF EN 704). Answer: u16 at byte 0 of
    /// the data.
    pub struct SpiPackSizeGet;

    /// CRC_ERR_CNT_CLR, command code 24: clears the count of wrong check words. The manuals do not say what the return
    /// byte means (XF EN 730).
    pub struct CrcErrorCountClear;

    /// FW_VERSION_GET, command code 56: reads version and series of the chip (XF EN 1285).
    pub struct FirmwareVersionGet;

    /// WARM_RESET, command code 127: resets the chip as at power-on. The next command has to wait until the chip has
    /// started, for which the vendor's driver allows 1 s (XF EN 1517).
    pub struct WarmReset;

    /// ECAT_WKC_CONTI_ERR_CNT_GET, command code 130: reads the number of wrong working counters in a row, from the
    /// return byte (XF EN 1526).
    pub struct WkcErrorCountGet;

    /// ECAT_WKC_CONTI_ERR_MAX_GET, command code 131: reads how many wrong working counters in a row are allowed, from
    /// the return byte (XF EN 1538).
    pub struct WkcErrorMaxGet;

    /// CRC_TYPE_SET, command code 25: sets the type of check words, from the answer to this command on. The parameter
    /// byte is the type (XF EN 741).
    pub struct CrcTypeSet {
        /// The new type of check words: the fixed word or CRC-32.
        pub kind: CheckType = par(),
    }

    /// SPI_RECONFIG_OP, command code 23: sets another n, the size of the data segment. The length field is the new n,
    /// and the check word of this packet is always the fixed one (XF EN 715). An ECM-XFU keeps its 992 bytes.
    pub struct SpiReconfig {
        /// The new size of the data segment.
        pub size: DataSize = length(),
    }

    /// ASYNCCMD_RESET, command code 75: makes a chip that is busy with a non-immediate command accept another one. The
    /// chip accepts this request even while it is busy. The parameter byte selects the actions: clear the busy flag,
    /// skip the wait for the network port, give up the running command (XF EN 1446).
    pub struct AsyncReset {
        actions: AsyncResetActions = par().named("action"),
    }

    /// ECAT_WKC_CONTI_ERR_MAX_SET, command code 132: sets how many wrong working counters in a row are allowed. Beyond
    /// this limit the chip stops exchanging process data and clears bits 4 and 6 of the status. The parameter byte is
    /// the limit (XF EN 1553).
    pub struct WkcErrorMaxSet {
        limit: WkcErrorLimit = par(),
    }

    /// MDIO, command code 81: writes or reads a register of a PHY (XF EN 1455). Parameter byte: 0 write, 1 read;
    /// information bytes: `i0` register, `i1` PHY, `i2` and `i3` data as u16.
    pub enum Mdio by operation: u8 = par(), "operation", "0 write, 1 read" {
        /// Writes a register of a PHY.
        Write = 0 {
            /// Address of the PHY.
            phy: u8 = info(1),
            /// Number of the register.
            register: u8 = info(0),
            /// The new value of the register.
            value: u16 = info(2).hex().or(0),
        },
        /// Reads a register of a PHY. Answer: u16 at byte 0 of the data.
        Read = 1 {
            /// Address of the PHY.
            phy: u8 = info(1),
            /// Number of the register.
            register: u8 = info(0),
        },
    }
}

/// The names of the actions of [`AsyncReset`], with their bits.
const RESETS: Names = &[("clear_busy", 1), ("skip_port_wait", 2), ("give_up", 4)];

field_values! {
    CheckType, 1, FieldKind::Choice(&[("fixed", 0), ("crc32", 3)]), |kind| kind.code().into(),
        |code| CheckType::from_code(code as u8).ok_or(Malformed::only("CRC_TYPE_SET type", code, "0 fixed, 3 CRC-32"));
    DataSize, 2, FieldKind::Number, |size| size.get().into(), |n| data_size("SPI_RECONFIG_OP size", n as u16);
    AsyncResetActions, 1, FieldKind::Bits(RESETS), |actions| actions.0.into(),
        |bits| AsyncReset::new(AsyncResetActions(bits as u8)).map(AsyncReset::actions).ok_or(Malformed::only(
            "ASYNCCMD_RESET action",
            bits,
            "1 clear busy, 2 skip the port's wait, 4 give up the command, or a sum of them",
        ));
    WkcErrorLimit, 1, FieldKind::Named(WkcErrorLimit::NAMES), |limit| limit.code().into(),
        |code| WkcErrorMaxSet::new(WkcErrorLimit(code as u8)).map(WkcErrorMaxSet::limit).ok_or(Malformed::only(
            "working counter error limit",
            code,
            "1 to 254, or 255 for none",
        ));
}

impl WkcErrorMaxSet {
    /// The request with this limit; `None` for 0, which the chip does not accept.
    pub const fn new(limit: WkcErrorLimit) -> Option<Self> {
        if limit.0 == 0 { None } else { Some(Self { limit }) }
    }

    /// How many wrong working counters in a row the request allows.
    pub const fn limit(self) -> WkcErrorLimit {
        self.limit
    }
}

/// Converts `n` to a size of the data segment.
pub(in crate::xf) fn data_size(field: &'static str, n: u16) -> Result<DataSize, Malformed> {
    DataSize::new(n.into()).ok_or(Malformed::only(field, n.into(), "32 to 1408"))
}

/// A limit for the number of wrong working counters in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WkcErrorLimit(u8);

impl Default for WkcErrorLimit {
    /// The chip's setting at power-on: no limit.
    fn default() -> Self {
        Self::NONE
    }
}

impl WkcErrorLimit {
    /// 255: no limit.
    pub const NONE: Self = Self(0xFF);
    pub(in crate::xf) const NAMES: Names = &[("none", Self::NONE.0 as u32)];

    /// The limit with this code: 0..=254, or 255 for no limit. The chip may report 0 but does not accept it.
    pub const fn from_code(code: u8) -> Self {
        Self(code)
    }

    /// The code on the wire.
    pub const fn code(self) -> u8 {
        self.0
    }

    /// How many wrong working counters in a row are allowed, 0..=254; `None` if there is no limit.
    pub const fn most(self) -> Option<u8> {
        if self.0 == Self::NONE.0 { None } else { Some(self.0) }
    }
}

bits! {
    /// The actions of [`AsyncReset`] on a chip that is busy.
    AsyncResetActions(u8) {
        /// Bit 0: clears the busy flag.
        CLEAR_BUSY = 1 << 0;
        /// Bit 1: skips the wait until the network port is ready after the start of the chip.
        SKIP_PORT_WAIT = 1 << 1;
        /// Bit 2: gives up the running non-immediate command.
        GIVE_UP = 1 << 2;
        /// Bits 0 to 2: all actions.
        ALL = 0x07;
    }
}

impl AsyncReset {
    /// A request for these actions; `None` if there is none, or if a bit is set that is not in the manuals.
    ///
    /// `[OURS]` The manuals list the values 1, 2 and 4, which look like bits. So a sum of these values requests several
    /// actions.
    pub const fn new(actions: AsyncResetActions) -> Option<Self> {
        if actions.0 != 0 && AsyncResetActions::ALL.contains(actions) { Some(Self { actions }) } else { None }
    }

    /// The actions that the chip has to take; at least one.
    pub const fn actions(self) -> AsyncResetActions {
        self.actions
    }
}
