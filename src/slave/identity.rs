//! The identity of a slave.

/// The identity objects that all slaves of one model have in common. The serial number is not among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Device type, 0x1000: the device profile in bits 0 to 15 (402 for a drive), the type of the device in bits 16 to 31.
    pub device_type: u32,
    /// Device name, 0x1008.
    pub name: &'static str,
    /// Vendor ID, 0x1018:1.
    pub vendor_id: u32,
    /// Product code, 0x1018:2.
    pub product_code: u32,
    /// Revision, 0x1018:3.
    pub revision: u32,
}
