//! Objects 0x1C32 and 0x1C33, the parameters of sync managers 2 and 3 (ETG.1020 21), which masters read of a device that can
//! be synchronized.

use super::device::Model;
use super::dictionary::Object;

/// The rows of one of the two objects, for the object with that index: its first row names it, its second one is the
/// synchronization type with which the device starts. `supported`: the types that the device has, bit 0 free run, bit 1 sync
/// manager event, bit 2 SYNC0, bit 14 a cycle that changes.
///
/// \[OURS] Times and counters read 0: the simulated network has one clock, and no device is ever late.
pub const fn sync_manager_parameters<M: Model>(
    index: u16,
    name: &'static str,
    sync_type: i64,
    supported: i64,
) -> [Object<M>; 12] {
    [
        Object::u8(index, 0, name).default(32),
        Object::u16(index, 1, "Synchronization type").rw().default(sync_type),
        Object::u32(index, 2, "Cycle time"),
        Object::u16(index, 4, "Synchronization types supported").default(supported),
        Object::u32(index, 5, "Minimum cycle time"),
        Object::u32(index, 6, "Calc and copy time"),
        Object::u16(index, 8, "Get cycle time").rw(),
        Object::u32(index, 9, "Delay time"),
        Object::u32(index, 10, "Sync0 cycle time").rw(),
        Object::u16(index, 11, "SM event missed"),
        Object::u16(index, 12, "Cycle time too small"),
        Object::bool(index, 32, "Sync error"),
    ]
}
