//! Files of slaves (FoE), which pass through a part of the chip's flash memory.

use super::{FlashAddress, FlashBytes, SlaveNumber};
use crate::xf::Allowed;
use crate::xf::fields::Kind;
use crate::xf::layout::layout;

layout! {
    /// FOE_FUNC_GET, code 140: what [`FoeRequest::ReadFlash`] has read (XF EN 1621).
    pub struct FoeGet;

    /// A file of a slave.
    pub struct FoeFile<'d> {
        /// Which slave.
        pub slave: SlaveNumber = at(0).or(0),
        /// The file's password.
        pub password: u32 = at(4).hex().or(0),
        /// The file's length in bytes.
        pub bytes: u32 = at(8).counts("data"),
        /// How long the chip waits for the slave, in microseconds.
        pub timeout_us: u32 = at(12).or(1_000_000),
        /// Where the file is in the flash memory.
        pub start: FlashAddress = at(16).hex(),
        /// The file's name, without a byte 0.
        pub name: &'d [u8] = tail(20).kind(Kind::Text),
    }

    /// FOE_FUNC_REQ, code 139: moves files, and reads and writes the flash memory that they pass through (XF EN 1598,
    /// XF ZH 1517). 20 bytes and the name or the data: @0 slave, @2 operation, @4 u32 password, @8 u32 bytes, @12 u32 time
    /// limit in us, @16 u32 start in the flash memory, @20 name or data.
    pub enum FoeRequest<'d> by operation: u8 = at(2),
        "FOE_FUNC_REQ operation", "1 upload, 2 download, 3 read flash, 4 write flash"
    {
        /// A file from a slave into the flash memory.
        Upload = 1 (file: FoeFile<'d>),
        /// A file from the flash memory to a slave.
        Download = 2 (file: FoeFile<'d>),
        /// Reads the flash memory, for [`FoeGet`].
        ReadFlash = 3 {
            /// From where on.
            start: FlashAddress = at(16).hex(),
            /// How many bytes.
            bytes: FlashBytes = at(8),
        },
        /// Writes the flash memory.
        WriteFlash = 4 {
            /// From where on.
            start: FlashAddress = at(16).hex(),
            /// The bytes, 256 at most.
            data: &'d [u8] = tail(20).counted(
                at(8).bytes(4),
                "FOE_FUNC_REQ flash bytes",
                Allowed::Between(0, FlashBytes::MAX.get()),
            ),
        },
    }
}
