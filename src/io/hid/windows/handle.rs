//! Handles of Windows that are closed once, when nobody has them any more.

use std::ffi::c_void;
use std::ptr;
use std::sync::Arc;

use super::UsbError;
use super::api::{self, Handle};
use super::bus::Bus;
use super::codes;

/// A handle of ours.
pub struct Owned {
    bus: Arc<Bus>,
    raw: Handle,
}

// SAFETY: Windows' handles may be used by any threads at once.
unsafe impl Send for Owned {}
// SAFETY: as above.
unsafe impl Sync for Owned {}

impl Owned {
    /// Opens the device at a path that ends with a zero. `overlapped`: to move reports; otherwise to ask the driver what
    /// it knows of the device, which is let in whatever other programs do with it.
    pub fn open(bus: &Arc<Bus>, path: &[u16], overlapped: bool) -> Result<Self, UsbError> {
        let (access, flags) = if overlapped { (api::READ_AND_WRITE, api::OVERLAPPED) } else { (0, 0) };
        // SAFETY: the path ends with a zero, by the caller's promise and the check of it.
        let raw = unsafe {
            assert_eq!(path.last(), Some(&0), "a path ends with a zero");
            let create = bus.api().create_file;
            create(
                path.as_ptr(),
                access,
                api::SHARED,
                ptr::null::<c_void>(),
                api::OPEN_EXISTING,
                flags,
                ptr::null_mut(),
            )
        };
        if raw == api::INVALID_HANDLE {
            return Err(codes::error(bus.last_error()));
        }
        Ok(Self { bus: bus.clone(), raw })
    }

    /// A port that the ends of this one's transfers are told at.
    pub fn port(&self) -> Result<Self, UsbError> {
        // SAFETY: the handle is open until `drop`.
        let raw = unsafe { (self.bus.api().create_port)(self.raw, ptr::null_mut(), 0, 1) };
        if raw.is_null() {
            return Err(codes::error(self.bus.last_error()));
        }
        Ok(Self { bus: self.bus.clone(), raw })
    }

    /// An event that one wait takes away.
    pub fn event(bus: &Arc<Bus>) -> Result<Self, UsbError> {
        // SAFETY: without attributes and name.
        let raw = unsafe { (bus.api().create_event)(ptr::null(), 0, 0, ptr::null()) };
        if raw.is_null() {
            return Err(codes::error(bus.last_error()));
        }
        Ok(Self { bus: bus.clone(), raw })
    }

    pub const fn bus(&self) -> &Arc<Bus> {
        &self.bus
    }

    pub const fn raw(&self) -> Handle {
        self.raw
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: our own handle, closed once.
        unsafe { (self.bus.api().close_handle)(self.raw) };
    }
}
