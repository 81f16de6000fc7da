//! Files of slaves (FoE), which pass through a part of the chip's flash memory.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, FlashAddress, FlashBytes, SlaveNumber, plain};
use crate::ethercat::U32Le;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// FOE_FUNC_GET, code 140: what [`FoeRequest::ReadFlash`] has read (XF EN 1621).
    FoeGet, FoeGet -> &'a [u8];
}

choices! {
    /// @2 of [`FoeRequest`].
    pub(in crate::xf) FoeOperation(u8), "FOE_FUNC_REQ operation", "1 upload, 2 download, 3 read flash, 4 write flash" {
        /// 1: a file from a slave into the flash memory.
        Upload = 1,
        /// 2: a file from the flash memory to a slave.
        Download = 2,
        /// 3: the flash memory is read.
        ReadFlash = 3,
        /// 4: the flash memory is written.
        WriteFlash = 4,
    }
}

/// What the head of [`FoeRequest`] looks like; the name or the data follow.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FoeLayout {
    /// @0: the slave, for a file.
    slave: u8,
    /// @1.
    reserved1: u8,
    /// @2.
    operation: u8,
    /// @3.
    reserved3: u8,
    /// @4: for a file.
    password: U32Le,
    /// @8: of the file or of the flash memory.
    bytes: U32Le,
    /// @12: for a file.
    timeout_us: U32Le,
    /// @16.
    start: U32Le,
}

const FOE_HEAD: usize = size_of::<FoeLayout>();
const _: () = assert!(FOE_HEAD == 20 && align_of::<FoeLayout>() == 1);

/// A file of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FoeFile<'d> {
    /// Which slave.
    pub slave: SlaveNumber,
    /// The file's password.
    pub password: u32,
    /// The file's length in bytes.
    pub bytes: u32,
    /// How long the chip waits for the slave, in microseconds.
    pub timeout_us: u32,
    /// Where the file is in the flash memory.
    pub start: FlashAddress,
    /// The file's name, without a byte 0.
    pub name: &'d [u8],
}

/// FOE_FUNC_REQ, code 139: moves files, and reads and writes the flash memory that they pass through (XF EN 1598,
/// XF ZH 1517). 20 bytes and the name or the data: @0 slave, @2 operation, @4 u32 password, @8 u32 bytes, @12 u32 time
/// limit in us, @16 u32 start in the flash memory, @20 name or data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FoeRequest<'d> {
    /// A file from a slave into the flash memory.
    Upload(FoeFile<'d>),
    /// A file from the flash memory to a slave.
    Download(FoeFile<'d>),
    /// Reads the flash memory, for [`FoeGet`].
    ReadFlash {
        /// From where on.
        start: FlashAddress,
        /// How many bytes.
        bytes: FlashBytes,
    },
    /// Writes the flash memory.
    WriteFlash {
        /// From where on.
        start: FlashAddress,
        /// The bytes, 256 at most.
        data: &'d [u8],
    },
}

impl<'d> Call<'d> for FoeRequest<'d> {
    const CODE: CommandCode = CommandCode::FoeRequest;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let (layout, tail) = match *self {
            Self::Upload(file) => (file.layout(FoeOperation::Upload), checked(file.name)?),
            Self::Download(file) => (file.layout(FoeOperation::Download), checked(file.name)?),
            Self::ReadFlash { start, bytes } => (flash(FoeOperation::ReadFlash, start, bytes), &[][..]),
            Self::WriteFlash { start, data } => {
                let bytes = u32::try_from(data.len()).unwrap_or(u32::MAX);
                (flash(FoeOperation::WriteFlash, start, FlashBytes::decode(bytes)?), data)
            }
        };
        segment::put(data, &layout)?;
        Ok(Arguments::NONE.len(segment::put_at(data, FOE_HEAD, tail)?))
    }

    fn decode(arguments: &Arguments, data: &'d [u8]) -> Result<Self, Malformed> {
        let layout: FoeLayout = segment::get(data)?;
        let start = FlashAddress::decode(layout.start.get())?;
        let bytes = layout.bytes.get();
        Ok(match FoeOperation::decode(layout.operation)? {
            FoeOperation::Upload => Self::Upload(FoeFile::read(&layout, start, name(arguments, data))?),
            FoeOperation::Download => Self::Download(FoeFile::read(&layout, start, name(arguments, data))?),
            FoeOperation::ReadFlash => Self::ReadFlash { start, bytes: FlashBytes::decode(bytes)? },
            FoeOperation::WriteFlash => {
                let bytes = FlashBytes::decode(bytes)?.get() as usize;
                Self::WriteFlash { start, data: segment::get_at(data, FOE_HEAD, bytes)? }
            }
        })
    }
}

impl<'d> FoeFile<'d> {
    fn layout(&self, operation: FoeOperation) -> FoeLayout {
        FoeLayout {
            slave: self.slave.get(),
            reserved1: 0,
            operation: operation.code(),
            reserved3: 0,
            password: self.password.into(),
            bytes: self.bytes.into(),
            timeout_us: self.timeout_us.into(),
            start: self.start.get().into(),
        }
    }

    fn read(layout: &FoeLayout, start: FlashAddress, name: &'d [u8]) -> Result<Self, Malformed> {
        Ok(Self {
            slave: SlaveNumber::decode(layout.slave)?,
            password: layout.password.get(),
            bytes: layout.bytes.get(),
            timeout_us: layout.timeout_us.get(),
            start,
            name,
        })
    }
}

fn flash(operation: FoeOperation, start: FlashAddress, bytes: FlashBytes) -> FoeLayout {
    FoeLayout {
        operation: operation.code(),
        bytes: bytes.get().into(),
        start: start.get().into(),
        ..Zeroable::zeroed()
    }
}

/// The name of a file where the request is read.
///
/// `[OURS]` It ends where the length field says, or before that at the first byte 0; a length field that leaves no name
/// is not believed, since the chip reads fixed layouts whatever the length says.
fn name<'d>(arguments: &Arguments, data: &'d [u8]) -> &'d [u8] {
    let rest = data.get(FOE_HEAD..).unwrap_or_default();
    let named = usize::from(arguments.len).saturating_sub(FOE_HEAD);
    let rest = if named == 0 { rest } else { &rest[..named.min(rest.len())] };
    rest.split(|byte| *byte == 0).next().unwrap_or_default()
}

/// The name, if it has no byte 0.
fn checked(name: &[u8]) -> Result<&[u8], Malformed> {
    if name.contains(&0) { Err(Malformed::only("a byte of the file name", 0, "1 to 255")) } else { Ok(name) }
}
