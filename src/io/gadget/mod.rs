//! This machine as a USB device (Linux): a gadget of the kernel's configfs on one of the machine's device controllers,
//! with one function of FunctionFS, whose endpoints are files.
//!
//! Sources: Documentation/usb/gadget_configfs.rst, Documentation/usb/functionfs.rst and
//! include/uapi/linux/usb/functionfs.h of Linux.
//!
//! Files:
//!
//! - `controllers.rs`: the device controllers of this machine, and the claim on one
//! - `configfs.rs`: the gadget as a list of steps, and its removal
//! - `wire.rs`: the bytes of FunctionFS: descriptors, strings, events
//! - `function.rs`: the function: its mount, endpoint 0, and the files of the other endpoints
//! - `transfers.rs`: transfers of the interrupt endpoints

mod configfs;
mod controllers;
mod function;
mod transfers;
pub mod wire;

pub use configfs::{CONFIGFS, DeviceIds, Gadget, Step, StepError, removal, steps};
pub use controllers::{Claim, ControllerError, UDC_CLASS, choose};
pub use function::{ControlEndpoint, Function, MOUNTS};
pub use transfers::{Direction, End, PACKET, Transfers};
