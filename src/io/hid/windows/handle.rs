//! Windows handles that are closed on drop.

use std::ffi::c_void;
use std::ptr;
use std::sync::Arc;

use super::UsbError;
use super::api::{self, Handle};
use super::bus::Bus;
use super::codes;

/// A Windows handle that is closed on drop.
pub struct OwnedHandle {
    bus: Arc<Bus>,
    raw: Handle,
}

// SAFETY: Windows' handles may be used by any threads at once.
unsafe impl Send for OwnedHandle {}
// SAFETY: Windows' handles may be used by any threads at once.
unsafe impl Sync for OwnedHandle {}

impl OwnedHandle {
    /// Opens the device at a path that ends with a zero. With `overlapped` it is opened for reports, otherwise only for
    /// queries to the driver, which succeed whatever other programs do with the device.
    pub fn open(bus: &Arc<Bus>, path: &[u16], overlapped: bool) -> Result<Self, UsbError> {
        let (access, flags) = if overlapped { (api::READ_AND_WRITE, api::OVERLAPPED) } else { (0, 0) };
        // SAFETY: the path is terminated by a zero, which is checked here.
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
        Self::made(bus, raw)
    }

    /// Wraps the handle that a Windows function has returned, or returns the error of that function.
    fn made(bus: &Arc<Bus>, raw: Handle) -> Result<Self, UsbError> {
        if raw.is_null() || raw == api::INVALID_HANDLE {
            return Err(codes::open_error(bus.last_error()));
        }
        Ok(Self { bus: bus.clone(), raw })
    }

    /// Creates a completion port for the transfers of this handle.
    pub fn port(&self) -> Result<Self, UsbError> {
        // SAFETY: the handle is open until `drop`.
        let raw = unsafe { (self.bus.api().create_port)(self.raw, ptr::null_mut(), 0, 1) };
        Self::made(&self.bus, raw)
    }

    /// Creates an event that resets itself when it has ended a wait.
    pub fn event(bus: &Arc<Bus>) -> Result<Self, UsbError> {
        // SAFETY: an event without attributes and without a name has no conditions.
        let raw = unsafe { (bus.api().create_event)(ptr::null(), 0, 0, ptr::null()) };
        Self::made(bus, raw)
    }

    pub const fn bus(&self) -> &Arc<Bus> {
        &self.bus
    }

    pub const fn raw(&self) -> Handle {
        self.raw
    }
}

impl Drop for OwnedHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is closed here only.
        unsafe { (self.bus.api().close_handle)(self.raw) };
    }
}
