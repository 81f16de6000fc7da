//! The objects that every device has because masters read them: identity (0x1000 to 0x1018), sync manager types (0x1C00),
//! and synchronization (0x1C32 and 0x1C33).

use super::Model;
use crate::ethercat::AlState;
use crate::slave::dictionary::Object;

/// The objects by which programs recognize a device, besides its identity object: 0x1000, 0x1001 and 0x1008.
pub const fn description<M: Model>() -> [Object<M>; 3] {
    [
        Object::u32(0x1000, 0, "Device type").live(|device: &M| device.base().identity.device_type.into()),
        Object::u8(0x1001, 0, "Error register").tx().live(error_register),
        Object::text(0x1008, 0, "Device name", |device: &M| device.base().identity.name),
    ]
}

/// The identity object, 0x1018, and the sync manager types, 0x1C00, with their sub-indices 0 to 4. Every device has
/// them.
pub const fn identity<M: Model>() -> [Object<M>; 10] {
    [
        Object::u8(0x1018, 0, "Identity").default(4),
        Object::u32(0x1018, 1, "Vendor ID").live(|device: &M| device.base().identity.vendor_id.into()),
        Object::u32(0x1018, 2, "Product code").live(|device: &M| device.base().identity.product_code.into()),
        Object::u32(0x1018, 3, "Revision").live(|device: &M| device.base().identity.revision.into()),
        Object::u32(0x1018, 4, "Serial number").live(|device: &M| device.base().serial.into()),
        Object::u8(0x1C00, 0, "Sync manager types").default(4),
        Object::u8(0x1C00, 1, "Mailbox out").default(1),
        Object::u8(0x1C00, 2, "Mailbox in").default(2),
        Object::u8(0x1C00, 3, "Outputs").default(3),
        Object::u8(0x1C00, 4, "Inputs").default(4),
    ]
}

/// Supported synchronization types, 0x1C32:4 and 0x1C33:4. Bit 0: free run, bit 1: sync manager event, bit 2: SYNC0,
/// for devices with distributed clocks only, bit 14: the cycle time may change.
const WITHOUT_DC: i64 = 0x4003;
const WITH_DC: i64 = 0x4007;

/// Objects 0x1C32 and 0x1C33 of a device with distributed clocks, see `sync_types.rs`.
pub const fn synchronization<M: Model>() -> [Object<M>; 24] {
    both(sync_type::<M, 0>(), sync_type::<M, 1>(), WITH_DC)
}

const fn sync_type<M: Model, const N: usize>() -> Object<M> {
    Object::u16([0x1C32, 0x1C33][N], 1, "Synchronization type")
        .rw_up_to(AlState::PreOp)
        .live(|device: &M| device.base().sync_types.shown(N).into())
        .setter(|device: &mut M, code| device.base_mut().sync_types.write(N, code as u16))
}

/// Objects 0x1C32 and 0x1C33 of a device without distributed clocks. Their types are always free run \[OURS].
pub const fn free_run<M: Model>() -> [Object<M>; 24] {
    both(Object::u16(0x1C32, 1, "Synchronization type"), Object::u16(0x1C33, 1, "Synchronization type"), WITHOUT_DC)
}

/// Objects 0x1C32 and 0x1C33 with the given rows for sub-index 1. `supported` is the value of sub-index 4, the supported
/// types.
pub const fn both<M: Model>(outputs: Object<M>, inputs: Object<M>, supported: i64) -> [Object<M>; 24] {
    let mut rows = [outputs; 24];
    let halves = [
        sync_manager_parameters("SM output parameter", outputs, supported),
        sync_manager_parameters("SM input parameter", inputs, supported),
    ];
    let mut n = 0;
    while n < 24 {
        rows[n] = halves[n / 12][n % 12];
        n += 1;
    }
    rows
}

/// The rows of 0x1C32 or 0x1C33 (ETG.1020 21). \[OURS] Times and counters read 0, because a simulated device is never late.
const fn sync_manager_parameters<M: Model>(
    name: &'static str,
    sync_type: Object<M>,
    supported: i64,
) -> [Object<M>; 12] {
    let index = sync_type.address().index;
    [
        Object::u8(index, 0, name).default(32),
        sync_type,
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

/// The error register 0x1001 (CiA 301 7.5.2.2) for the error codes of the axes: bit 0 for any error, and one bit for the
/// group of each error.
fn error_register<M: Model>(device: &M) -> i64 {
    let bits = |code: u16| match code >> 12 {
        0 => 0,
        2 => 1 | 1 << 1,
        3 => 1 | 1 << 2,
        4 => 1 | 1 << 3,
        _ if code >> 8 == 0x81 => 1 | 1 << 4,
        0xF => 1 | 1 << 7,
        _ => 1 | 1 << 5,
    };
    device.axes().iter().fold(0, |register, axis| register | bits(axis.measured().error_code))
}
