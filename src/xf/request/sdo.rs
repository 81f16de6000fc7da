//! Objects of slaves, by SDO.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, SlaveNumber, WriteOrRead, plain};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{U16Le, U32Le};
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// ECAT_SDO_GET, code 11: the data that [`SdoRequest`] has read (XF EN 606).
    SdoGet, SdoGet -> &'a [u8];
    /// ECAT_SDO_ABORTCODE_GET, code 69: why the last [`SdoRequest`] failed, @0 u32 (XF EN 1358).
    SdoAbortCodeGet, SdoAbortCodeGet -> AbortCode;
}

/// What the head of [`SdoRequest`] looks like; the data to write follow.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SdoLayout {
    /// @0: 0 write, 1 read.
    operation: u8,
    /// @1.
    slave: u8,
    /// @2.
    index: U16Le,
    /// @4.
    sub: u8,
    /// @5: reserved in the manual, the flag of complete access in the vendor's driver (OBS).
    complete: u8,
    /// @6.
    bytes: U16Le,
    /// @8.
    timeout_us: U32Le,
}

const SDO_HEAD: usize = size_of::<SdoLayout>();
const _: () = assert!(SDO_HEAD == 12 && align_of::<SdoLayout>() == 1);

/// The most bytes that [`SdoRequest`] writes.
pub const SDO_DATA_MAX: usize = 256;

/// What [`SdoRequest`] does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SdoOperation<'d> {
    /// Reads; [`SdoGet`] gives the data.
    Read {
        /// How many bytes the object has.
        bytes: u16,
    },
    /// Writes these bytes, [`SDO_DATA_MAX`] at most.
    Write(&'d [u8]),
}

/// ECAT_SDO_REQ, code 10: reads or writes an object of a slave (XF EN 579). If it fails, the answer that ends it has
/// [`Errors::NON_IMMEDIATE`](crate::xf::Errors::NON_IMMEDIATE), and [`SdoAbortCodeGet`] says why.
///
/// 12 bytes and the data to write: @0 0 write, 1 read, @1 slave, @2 u16 index, @4 sub-index, @5 complete access, @6 u16
/// bytes, @8 u32 time limit in us, @12 data (the manual prints 0x12). The data end where the length field says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SdoRequest<'d> {
    /// Which slave.
    pub slave: SlaveNumber,
    /// Which object.
    pub object: ObjectAddress,
    /// The entry alone, or all of them.
    pub scope: SdoScope,
    /// How long the chip waits for the slave, in microseconds.
    pub timeout_us: u32,
    /// Read or write.
    pub operation: SdoOperation<'d>,
}

impl<'d> Call<'d> for SdoRequest<'d> {
    const CODE: CommandCode = CommandCode::SdoRequest;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let (operation, bytes, written) = match self.operation {
            SdoOperation::Read { bytes } => (WriteOrRead::Read, bytes, &[][..]),
            SdoOperation::Write(written) => {
                let bytes = Malformed::at_most("SDO_REQ data length", written.len(), SDO_DATA_MAX)?;
                (WriteOrRead::Write, bytes as u16, written)
            }
        };
        let layout = SdoLayout {
            operation: operation.code(),
            slave: self.slave.get(),
            index: self.object.index.into(),
            sub: self.object.sub,
            complete: (self.scope == SdoScope::Complete).into(),
            bytes: bytes.into(),
            timeout_us: self.timeout_us.into(),
        };
        segment::put(data, &layout)?;
        Ok(Arguments::NONE.len(segment::put_at(data, SDO_HEAD, written)?))
    }

    fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
        let layout: SdoLayout = segment::get(data)?;
        let bytes = layout.bytes.get();
        let operation = match WriteOrRead::decode(layout.operation)? {
            WriteOrRead::Read => SdoOperation::Read { bytes },
            WriteOrRead::Write => SdoOperation::Write(written(arguments, data, bytes.into())?),
        };
        Ok(Self {
            slave: SlaveNumber::decode(layout.slave)?,
            object: ObjectAddress::new(layout.index.get(), layout.sub),
            scope: if layout.complete == 0 { SdoScope::Entry } else { SdoScope::Complete },
            timeout_us: layout.timeout_us.get(),
            operation,
        })
    }
}

/// The data of a write. The length field says where they end, and `bytes` at @6 how many they are.
///
/// `[OURS]` If the length field has more, what is over is left out; if it has less, the request is malformed.
fn written<'d>(arguments: &Arguments, data: &'d [u8], bytes: usize) -> Result<&'d [u8], Malformed> {
    Malformed::at_most("SDO_REQ data length", bytes, SDO_DATA_MAX)?;
    Malformed::at_least("SDO_REQ valid data length", arguments.len.into(), SDO_HEAD + bytes)?;
    segment::get_at(data, SDO_HEAD, bytes)
}
