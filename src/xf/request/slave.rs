//! Sync managers and FMMUs of a slave, and process data of assigned length.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, SlaveNumber, Switch};
use crate::ethercat::U16Le;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

/// The data segment of [`ConfigSyncManager`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SyncManagerLayout {
    /// @0.
    slave: u8,
    /// @1.
    number: u8,
    /// @2.
    start: U16Le,
    /// @4.
    length: U16Le,
    /// @6.
    control: u8,
    /// @7.
    activate: u8,
}

const _: () = assert!(size_of::<SyncManagerLayout>() == 8 && align_of::<SyncManagerLayout>() == 1);

/// ECAT_CONFIG_SM, code 71: sets a sync manager otherwise than the slave's own memory says (XF EN 1388, XF ZH 1297). 8
/// bytes: @0 slave, @1 number, @2 u16 start, @4 u16 length, @6 control, @7 activate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConfigSyncManager {
    /// Which slave.
    pub slave: SlaveNumber,
    /// Which sync manager.
    pub number: u8,
    /// Where its memory starts.
    pub start: u16,
    /// How many bytes it has.
    pub length: u16,
    /// The control byte of the slave's register.
    pub control: u8,
    /// The activate byte of the slave's register.
    pub activate: u8,
}

impl Call<'_> for ConfigSyncManager {
    const CODE: CommandCode = CommandCode::ConfigSyncManager;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let layout = SyncManagerLayout {
            slave: self.slave.get(),
            number: self.number,
            start: self.start.into(),
            length: self.length.into(),
            control: self.control,
            activate: self.activate,
        };
        Ok(Arguments::NONE.len(segment::put(data, &layout)?))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        let layout: SyncManagerLayout = segment::get(data)?;
        Ok(Self {
            slave: SlaveNumber::decode(layout.slave)?,
            number: layout.number,
            start: layout.start.get(),
            length: layout.length.get(),
            control: layout.control,
            activate: layout.activate,
        })
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

impl Call<'_> for ConfigFmmu {
    const CODE: CommandCode = CommandCode::ConfigFmmu;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let [a, b, c, d] = self.functions;
        Ok(Arguments::NONE.len(segment::put(data, &[self.slave.get(), a, b, c, d])?))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        let [slave, functions @ ..] = segment::get::<[u8; 5]>(data)?;
        Ok(Self { slave: SlaveNumber::decode(slave)?, functions })
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

    /// `par` of [`DirectAssign`].
    pub(in crate::xf) DirectAssignOperation(u8), "DIRECT_ASSIGN operation", "0 switch, 1 length" {
        /// 0: the assignment is switched.
        Switch = 0,
        /// 1: a length is assigned.
        Length = 1,
    }
}

/// DIRECT_ASSIGN, code 82: the lengths of a slave's process data are assigned by hand (XF EN 1472, XF ZH 1381).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DirectAssign {
    /// `par` 0; `i0` slave, `i1` 0 off, 1 on.
    Switch {
        /// Which slave.
        slave: SlaveNumber,
        /// The lengths assigned are used.
        on: bool,
    },
    /// `par` 1; `i0` slave, `i1` 0 output, 1 input, `i2`, `i3` u16 bytes.
    Length {
        /// Which slave.
        slave: SlaveNumber,
        /// Outputs or inputs.
        direction: Direction,
        /// How many bytes they have.
        bytes: u16,
    },
}

impl Call<'_> for DirectAssign {
    const CODE: CommandCode = CommandCode::DirectAssign;
    type Answer<'a> = ();

    fn encode(&self, _: &mut [u8]) -> Result<Arguments, Malformed> {
        let (operation, info) = match *self {
            Self::Switch { slave, on } => (DirectAssignOperation::Switch, [slave.get(), on.into(), 0, 0]),
            Self::Length { slave, direction, bytes } => {
                let [low, high] = bytes.to_le_bytes();
                (DirectAssignOperation::Length, [slave.get(), direction.code(), low, high])
            }
        };
        Ok(Arguments::NONE.parameter(operation.code()).info(info))
    }

    fn decode(arguments: &Arguments, _: &[u8]) -> Result<Self, Malformed> {
        let [slave, what, low, high] = arguments.info;
        let operation = DirectAssignOperation::decode(arguments.parameter)?;
        let slave = SlaveNumber::decode(slave)?;
        Ok(match operation {
            DirectAssignOperation::Switch => Self::Switch { slave, on: Switch::decode(what)? == Switch::On },
            DirectAssignOperation::Length => {
                Self::Length { slave, direction: Direction::decode(what)?, bytes: u16::from_le_bytes([low, high]) }
            }
        })
    }
}
