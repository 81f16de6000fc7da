//! Sync managers and FMMUs of a slave, and process data of assigned length.

use super::SlaveNumber;
use crate::xf::Malformed;
use crate::xf::layout::{FieldList, Layout, Reader, Spot, Writer, at, layout};
use crate::xf::value::choices;

layout! {
    /// ECAT_CONFIG_SM, code 71: sets a sync manager otherwise than the slave's own memory says (XF EN 1388, XF ZH 1297). 8
    /// bytes: @0 slave, @1 number, @2 u16 start, @4 u16 length, @6 control, @7 activate.
    pub struct ConfigSyncManager {
        /// Which slave.
        pub slave: SlaveNumber = at(0),
        /// Which sync manager.
        pub number: u8 = at(1),
        /// Where its memory starts.
        pub start: u16 = at(2).hex(),
        /// How many bytes it has.
        pub length: u16 = at(4),
        /// The control byte of the slave's register.
        pub control: u8 = at(6).hex(),
        /// The activate byte of the slave's register.
        pub activate: u8 = at(7).hex(),
    }

    /// DIRECT_ASSIGN, code 82: the lengths of a slave's process data are assigned by hand (XF EN 1472, XF ZH 1381).
    pub enum DirectAssign by operation: u8 = par(), "DIRECT_ASSIGN operation", "0 switch, 1 length" {
        /// `par` 0; `i0` slave, `i1` 0 off, 1 on.
        Switch = 0 {
            /// Which slave.
            slave: SlaveNumber = info(0),
            /// The lengths assigned are used.
            on: bool = info(1).or(0),
        },
        /// `par` 1; `i0` slave, `i1` 0 output, 1 input, `i2`, `i3` u16 bytes.
        Length = 1 {
            /// Which slave.
            slave: SlaveNumber = info(0),
            /// Outputs or inputs.
            direction: Direction = info(1).or(0),
            /// How many bytes they have.
            bytes: u16 = info(2).or(0),
        },
    }
}

choices! {
    /// Which process data [`DirectAssign`] means.
    pub Direction(u8), "DIRECT_ASSIGN direction", "0 output, 1 input" {
        /// 0: outputs, the RxPDO.
        Output = 0,
        /// 1: inputs, the TxPDO.
        Input = 1,
    }
}

/// ECAT_CONFIG_FMMU, code 72: without effect, since the chip sets the FMMUs itself (XF EN 1407, XF ZH 1314). 5 bytes:
/// @0 slave, @1..@4 the functions of FMMU 0 to 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConfigFmmu {
    /// Which slave.
    pub slave: SlaveNumber,
    /// The functions of FMMU 0 to 3.
    pub functions: [u8; 4],
}

impl ConfigFmmu {
    const SLAVE: Spot = at(0).of::<SlaveNumber>("slave");
    const FUNCTIONS: [Spot; 4] = [
        at(1).or(0).of::<u8>("fmmu0"),
        at(2).or(0).of::<u8>("fmmu1"),
        at(3).or(0).of::<u8>("fmmu2"),
        at(4).or(0).of::<u8>("fmmu3"),
    ];
}

impl Layout<'_> for ConfigFmmu {
    const FIELDS: FieldList = {
        let [a, b, c, d] = Self::FUNCTIONS;
        FieldList::of(Self::SLAVE).with(a.field).with(b.field).with(c.field).with(d.field)
    };

    fn put(&self, to: &mut Writer<'_>) -> Result<(), Malformed> {
        Self::SLAVE.put(&self.slave, to)?;
        Self::FUNCTIONS[0].put(&self.functions, to)
    }

    fn take(from: &Reader<'_>) -> Result<Self, Malformed> {
        Ok(Self { slave: Self::SLAVE.take(from)?, functions: Self::FUNCTIONS[0].take(from)? })
    }
}
