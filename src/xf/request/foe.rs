//! Requests for files of slaves (FoE), which are transferred through a part of the chip's flash memory.

use super::{FlashAddress, FlashBytes, SlaveNumber};
use crate::xf::Allowed;
use crate::xf::fields::FieldKind;
use crate::xf::layout::layout;

layout! {
    /// FOE_FUNC_GET, command code 140: returns the data that [`FoeRequest::ReadFlash`] has read (XF EN 1621).
    pub struct FoeGet;

    /// A file to transfer between a slave and the flash memory.
    pub struct FoeFile<'d> {
        /// The slave whose file is transferred.
        pub slave: SlaveNumber = at(0).or(0),
        /// The password for the file, which the slave may require.
        pub password: u32 = at(4).hex().or(0),
        /// The length of the file in the flash memory in bytes, for a download. For an upload the modelled chip takes
        /// it as the maximum length, and 0 as any length.
        pub bytes: u32 = at(8).counts("data"),
        /// The timeout of the slave's answers, in microseconds.
        pub timeout_us: u32 = at(12).or(1_000_000),
        /// The address in the flash memory at which the file begins.
        pub start: FlashAddress = at(16).hex(),
        /// The file's name in the slave, without a terminating 0.
        pub name: &'d [u8] = tail(20).kind(FieldKind::Text),
    }

    /// FOE_FUNC_REQ, command code 139: transfers files, and reads and writes the flash memory through which they pass
    /// (XF EN 1598, XF ZH 1517). Data, 20 bytes and the name or the data (@offset): @0 slave, @2 operation, @4 u32
    /// password, @8 u32 bytes, @12 u32 timeout in us, @16 u32 start in the flash memory, @20 name or data.
    pub enum FoeRequest<'d> by operation: u8 = at(2),
        "FOE_FUNC_REQ operation", "1 upload, 2 download, 3 read flash, 4 write flash"
    {
        /// Transfers a file from a slave into the flash memory.
        Upload = 1 (file: FoeFile<'d>),
        /// Transfers a file from the flash memory to a slave.
        Download = 2 (file: FoeFile<'d>),
        /// Reads the flash memory; [`FoeGet`] then returns the data.
        ReadFlash = 3 {
            /// The first address in the flash memory to read.
            start: FlashAddress = at(16).hex(),
            /// Number of bytes to read.
            bytes: FlashBytes = at(8),
        },
        /// Writes at most 256 bytes into the flash memory.
        WriteFlash = 4 {
            /// The first address in the flash memory to write.
            start: FlashAddress = at(16).hex(),
            /// The bytes to write, at most 256.
            data: &'d [u8] = tail(20).counted(
                at(8).bytes(4),
                "FOE_FUNC_REQ flash bytes",
                Allowed::Between(0, FlashBytes::MAX.get()),
            ),
        },
    }
}
