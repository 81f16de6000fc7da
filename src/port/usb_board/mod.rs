//! The virtual board as a USB device, without I/O: the same device model for both connections to a host, over USB/IP
//! (`usbip`) and on a device controller of this machine (`gadget`).
//!
//! Files:
//!
//! - `descriptors.rs`: its USB descriptors
//! - `setup.rs`: the requests on endpoint 0
//! - `transfer.rs`: transfers as a host submits them, and their ends
//! - `device.rs`, `device/`: the [`Device`](device::Device), transfer by transfer

pub mod descriptors;
pub mod device;
pub mod setup;
pub mod transfer;
