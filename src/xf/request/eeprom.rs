//! The EEPROMs of slaves (SII).

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, SlaveNumber, plain};
use crate::ethercat::{U16Le, U32Le};
use crate::xf::response::EepromAnswer;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// EEPROM_GET, code 39: what [`EepromRequest`] has read, up to 8 bytes, and an error code in `ret` (XF EN 1168).
    EepromGet, EepromGet -> EepromAnswer<'a>;
}

choices! {
    /// @0 of [`EepromRequest`].
    pub(in crate::xf) EepromOperationCode(u16), "EEPROM_REQ operation", "0 read, 1 write" {
        /// 0: read, the reverse of SDO_REQ (XF ZH 1096).
        Read = 0,
        /// 1: write.
        Write = 1,
    }
}

/// The data segment of [`EepromRequest`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct EepromLayout {
    /// @0.
    operation: U16Le,
    /// @2.
    slave: U16Le,
    /// @4.
    position: U16Le,
    /// @6.
    value: U16Le,
    /// @8.
    timeout_us: U32Le,
}

const _: () = assert!(size_of::<EepromLayout>() == 12 && align_of::<EepromLayout>() == 1);

/// What [`EepromRequest`] does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EepromOperation {
    /// Reads from the position on; [`EepromGet`] gives the data.
    Read,
    /// Writes this word.
    Write(u16),
}

/// EEPROM_REQ, code 38: reads or writes a slave's EEPROM (XF EN 1144, XF ZH 1096). 12 bytes: @0 u16 operation, @2 u16
/// slave, @4 u16 position, @6 u16 word to write, @8 u32 time limit in us.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EepromRequest {
    /// Which slave.
    pub slave: SlaveNumber,
    /// The position in the EEPROM.
    pub position: u16,
    /// How long the chip waits for the slave, in microseconds.
    pub timeout_us: u32,
    /// Read or write.
    pub operation: EepromOperation,
}

impl Call<'_> for EepromRequest {
    const CODE: CommandCode = CommandCode::EepromRequest;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let (operation, value) = match self.operation {
            EepromOperation::Read => (EepromOperationCode::Read, 0),
            EepromOperation::Write(value) => (EepromOperationCode::Write, value),
        };
        let layout = EepromLayout {
            operation: operation.code().into(),
            slave: u16::from(self.slave.get()).into(),
            position: self.position.into(),
            value: value.into(),
            timeout_us: self.timeout_us.into(),
        };
        Ok(Arguments::NONE.len(segment::put(data, &layout)?))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        let layout: EepromLayout = segment::get(data)?;
        let operation = match EepromOperationCode::decode(layout.operation.get())? {
            EepromOperationCode::Read => EepromOperation::Read,
            EepromOperationCode::Write => EepromOperation::Write(layout.value.get()),
        };
        Ok(Self {
            slave: SlaveNumber::decode_wide(layout.slave.get())?,
            position: layout.position.get(),
            timeout_us: layout.timeout_us.get(),
            operation,
        })
    }
}
