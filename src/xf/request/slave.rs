//! Requests for sync managers and FMMUs of a slave, and for process data of manually assigned length.

use super::SlaveNumber;
use crate::xf::Malformed;
use crate::xf::layout::{FieldDecl, FieldLayout, FieldList, FieldReader, FieldWriter, at, layout};
use crate::xf::value::choices;

layout! {
    /// ECAT_CONFIG_SM, command code 71: sets a sync manager differently from the slave's EEPROM (XF EN 1388,
    /// XF ZH 1297). Data, 8 bytes (@offset): @0 slave, @1 number, @2 u16 start, @4 u16 length, @6 control, @7 activate.
    pub struct ConfigSyncManager {
        /// The slave with the sync manager.
        pub slave: SlaveNumber = at(0),
        /// The number of the sync manager.
        pub number: u8 = at(1),
        /// The start address of the sync manager's buffer in the slave's memory.
        pub start: u16 = at(2).hex(),
        /// The length of the sync manager's buffer in bytes.
        pub length: u16 = at(4),
        /// The control byte for the sync manager's register: direction and mode of the buffer.
        pub control: u8 = at(6).hex(),
        /// The activate byte for the sync manager's register; bit 0 enables the sync manager.
        pub activate: u8 = at(7).hex(),
    }

    /// DIRECT_ASSIGN, command code 82: assigns the lengths of a slave's process data manually (XF EN 1472, XF ZH 1381).
    pub enum DirectAssign by operation: u8 = par(), "DIRECT_ASSIGN operation", "0 switch, 1 length" {
        /// Parameter byte 0: switches the manual lengths on or off. Information bytes: `i0` slave, `i1` 0 off, 1 on.
        Switch = 0 {
            /// The slave whose process data have manually assigned lengths.
            slave: SlaveNumber = info(0),
            /// Whether the chip uses the assigned lengths, and not those of the slave's mapping.
            on: bool = info(1).or(0),
        },
        /// Parameter byte 1: assigns a length. Information bytes: `i0` slave, `i1` 0 output, 1 input, `i2` and `i3`
        /// bytes as u16.
        Length = 1 {
            /// The slave to whose process data a length is assigned.
            slave: SlaveNumber = info(0),
            /// Whether the length is assigned to the outputs or to the inputs.
            direction: Direction = info(1).or(0),
            /// The assigned length of the process data, in bytes.
            bytes: u16 = info(2).or(0),
        },
    }
}

choices! {
    /// The direction of the process data in [`DirectAssign`].
    pub Direction(u8), "DIRECT_ASSIGN direction", "0 output, 1 input" {
        /// 0: outputs, the RxPDO.
        Output = 0,
        /// 1: inputs, the TxPDO.
        Input = 1,
    }
}

/// ECAT_CONFIG_FMMU, command code 72: has no effect, since the chip sets the FMMUs itself (XF EN 1407, XF ZH 1314).
/// Data, 5 bytes (@offset): @0 slave, @1..@4 the functions of FMMU 0 to 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConfigFmmu {
    /// The slave with the FMMUs.
    pub slave: SlaveNumber,
    /// The functions of FMMU 0 to 3.
    pub functions: [u8; 4],
}

impl ConfigFmmu {
    const SLAVE: FieldDecl = at(0).of::<SlaveNumber>("slave");
    const FUNCTIONS: [FieldDecl; 4] = [
        at(1).or(0).of::<u8>("fmmu0"),
        at(2).or(0).of::<u8>("fmmu1"),
        at(3).or(0).of::<u8>("fmmu2"),
        at(4).or(0).of::<u8>("fmmu3"),
    ];
}

impl FieldLayout<'_> for ConfigFmmu {
    const FIELDS: FieldList = {
        let [a, b, c, d] = Self::FUNCTIONS;
        FieldList::of(Self::SLAVE).with(a.field).with(b.field).with(c.field).with(d.field)
    };

    fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        Self::SLAVE.put(&self.slave, to)?;
        Self::FUNCTIONS[0].put(&self.functions, to)
    }

    fn take(from: &FieldReader<'_>) -> Result<Self, Malformed> {
        Ok(Self { slave: Self::SLAVE.take(from)?, functions: Self::FUNCTIONS[0].take(from)? })
    }
}
