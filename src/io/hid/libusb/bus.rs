//! The USB of this machine, its devices, and a device that is open: libusb's objects with their lifetimes.

use std::ffi::c_int;
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::Arc;
use std::time::Duration;

use super::UsbError;
use super::api::{
    self, Api, ConfigurationDescriptor, DeviceDescriptor, HIGH_SPEED, INTERRUPTED, NoLibrary, RawContext, RawDevice,
    RawHandle,
};
use crate::threads;

/// USB 2.0 4.1.1: hubs stand in a row of five at most, with the root's port and the device's own.
const PORTS_MAX: usize = 7;

/// Why the USB of this machine cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoBus {
    /// libusb is not there.
    #[error(transparent)]
    NoLibrary(#[from] NoLibrary),
    /// libusb finds no USB.
    #[error("the USB of this machine cannot be used ({0}); is there one, and /dev/bus/usb?")]
    Usb(#[from] UsbError),
}

/// The USB of this machine, as libusb sees it.
pub struct Bus {
    api: &'static Api,
    raw: NonNull<RawContext>,
}

// SAFETY: libusb's contexts may be used by any threads at once.
unsafe impl Send for Bus {}
// SAFETY: as above.
unsafe impl Sync for Bus {}

impl Bus {
    /// Looks at the USB of this machine.
    ///
    /// # Errors
    /// [`NoBus`].
    pub fn open() -> Result<Arc<Self>, NoBus> {
        Ok(Self::over(api::load()?)?)
    }

    /// The USB behind these functions.
    pub(super) fn over(api: &'static Api) -> Result<Arc<Self>, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: `raw` takes the new context. libusb starts a thread of its own here, which gets no signal either.
        let code = threads::quietly(|| unsafe { (api.init)(&raw mut raw) }).map_err(|_| UsbError::NotSupported)?;
        UsbError::check(code)?;
        Ok(Arc::new(Self { api, raw: NonNull::new(raw).ok_or(UsbError::NoMemory)? }))
    }

    /// What is plugged in.
    pub(super) fn devices(self: &Arc<Self>) -> Result<Vec<Device>, UsbError> {
        let mut list = ptr::null_mut();
        // SAFETY: `list` takes an array, which is given back below.
        let count = unsafe { (self.api.devices)(self.raw.as_ptr(), &raw mut list) };
        let Ok(count) = usize::try_from(count) else {
            return Err(UsbError::check(c_int::try_from(count).unwrap_or(-1)).err().unwrap_or(UsbError::Io));
        };
        // SAFETY: libusb has made so many entries.
        let all = unsafe { entries(list.cast_const(), count) };
        let devices = all.iter().filter_map(|raw| Some(Device { bus: self.clone(), raw: NonNull::new(*raw)? }));
        let devices = devices.collect();
        // SAFETY: the array is libusb's; the devices in it, each counted once, are ours now.
        unsafe { (self.api.free_devices)(list, 0) };
        Ok(devices)
    }

    pub(super) const fn api(&self) -> &'static Api {
        self.api
    }

    /// Waits that long for something to happen, and does what has to be done then.
    pub(super) fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        let mut limit = libc::timeval {
            tv_sec: limit.as_secs() as libc::time_t,
            tv_usec: limit.subsec_micros() as libc::suseconds_t,
        };
        // SAFETY: the context is there until `drop`.
        let code = unsafe { (self.api.handle_events)(self.raw.as_ptr(), &raw mut limit, ptr::null_mut()) };
        // The program's own threads wait here, and its signals come to them.
        if code == INTERRUPTED { Ok(()) } else { UsbError::check(code).map(drop) }
    }

    /// Ends the wait in [`Bus::handle_events`].
    pub(super) fn interrupt(&self) {
        // SAFETY: the context is there until `drop`.
        unsafe { (self.api.interrupt)(self.raw.as_ptr()) };
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        // SAFETY: devices and handles hold the bus, so that none of them is left.
        unsafe { (self.api.exit)(self.raw.as_ptr()) };
    }
}

/// A device on the bus.
pub(in crate::io::hid) struct Device {
    bus: Arc<Bus>,
    raw: NonNull<RawDevice>,
}

// SAFETY: libusb's devices may be used by any threads at once.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

/// An interface in its first setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Interface {
    pub number: u8,
    pub class: u8,
    pub endpoints: Vec<Endpoint>,
}

/// An endpoint, as its descriptor has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endpoint {
    pub address: u8,
    pub attributes: u8,
    pub packet: u16,
}

impl Device {
    /// idVendor and idProduct.
    pub fn ids(&self) -> Result<(u16, u16), UsbError> {
        let mut descriptor = DeviceDescriptor::default();
        // SAFETY: the device is there until `drop`; `descriptor` takes what is copied.
        UsbError::check(unsafe { (self.bus.api.device_descriptor)(self.raw.as_ptr(), &raw mut descriptor) })?;
        Ok((descriptor.vendor, descriptor.product))
    }

    /// Number of the bus and address on it: those of its node below /dev/bus/usb.
    pub fn node(&self) -> (u8, u8) {
        // SAFETY: the device is there until `drop`.
        unsafe { ((self.bus.api.bus_number)(self.raw.as_ptr()), (self.bus.api.address)(self.raw.as_ptr())) }
    }

    /// The ports on the way to it, from the root.
    pub fn ports(&self) -> Vec<u8> {
        let mut ports = [0; PORTS_MAX];
        // SAFETY: the device is there until `drop`; the array has room for so many.
        let count = unsafe { (self.bus.api.ports)(self.raw.as_ptr(), ports.as_mut_ptr(), PORTS_MAX as c_int) };
        ports[..usize::try_from(count).unwrap_or(0).min(PORTS_MAX)].to_vec()
    }

    /// Whether it runs at high speed, 480 Mbit/s.
    pub fn high_speed(&self) -> bool {
        // SAFETY: the device is there until `drop`.
        unsafe { (self.bus.api.speed)(self.raw.as_ptr()) == HIGH_SPEED }
    }

    /// The interfaces of the configuration that is chosen; [`UsbError::NotFound`]: none is.
    pub(super) fn interfaces(&self) -> Result<Vec<Interface>, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the device is there until `drop`; `raw` takes a tree of descriptors, which is given back below.
        UsbError::check(unsafe { (self.bus.api.configuration)(self.raw.as_ptr(), &raw mut raw) })?;
        let Some(tree) = NonNull::new(raw) else { return Err(UsbError::NotFound) };
        // SAFETY: libusb has made it, with counts that are those of its arrays.
        let interfaces = unsafe { interfaces(tree.as_ref()) };
        // SAFETY: nothing refers to it any more.
        unsafe { (self.bus.api.free_configuration)(tree.as_ptr()) };
        Ok(interfaces)
    }

    /// Opens it.
    pub(super) fn open(&self) -> Result<Handle, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the device is there until `drop`; `raw` takes the handle.
        UsbError::check(unsafe { (self.bus.api.open)(self.raw.as_ptr(), &raw mut raw) })?;
        Ok(Handle { bus: self.bus.clone(), raw: NonNull::new(raw).ok_or(UsbError::NoMemory)? })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: it was counted for us in `Bus::devices`.
        unsafe { (self.bus.api.unref_device)(self.raw.as_ptr()) };
    }
}

/// A device that is open.
pub(super) struct Handle {
    bus: Arc<Bus>,
    raw: NonNull<RawHandle>,
}

// SAFETY: libusb's handles may be used by any threads at once.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Handle {
    pub const fn bus(&self) -> &Arc<Bus> {
        &self.bus
    }

    pub const fn raw(&self) -> *mut RawHandle {
        self.raw.as_ptr()
    }

    /// An interface that is claimed is taken from the kernel's driver, and given back when it is released.
    pub fn detach_driver_by_itself(&self) -> Result<(), UsbError> {
        // SAFETY: the handle is open until `drop`.
        UsbError::check(unsafe { (self.bus.api.detach_driver_by_itself)(self.raw(), 1) }).map(drop)
    }

    pub fn claim(&self, interface: u8) -> Result<(), UsbError> {
        // SAFETY: the handle is open until `drop`.
        UsbError::check(unsafe { (self.bus.api.claim)(self.raw(), interface.into()) }).map(drop)
    }

    pub fn release(&self, interface: u8) -> Result<(), UsbError> {
        // SAFETY: the handle is open until `drop`.
        UsbError::check(unsafe { (self.bus.api.release)(self.raw(), interface.into()) }).map(drop)
    }

    /// Ends the halt of an endpoint; it has no transfer then.
    pub fn clear_halt(&self, endpoint: u8) -> Result<(), UsbError> {
        // SAFETY: the handle is open until `drop`.
        UsbError::check(unsafe { (self.bus.api.clear_halt)(self.raw(), endpoint) }).map(drop)
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: transfers hold the handle, so that none of them is left.
        unsafe { (self.bus.api.close)(self.raw()) };
    }
}

/// # Safety
/// The tree is one that libusb made.
unsafe fn interfaces(tree: &ConfigurationDescriptor) -> Vec<Interface> {
    // SAFETY: by the caller's promise, here and below.
    let interfaces = unsafe { entries(tree.interfaces, tree.interface_count.into()) };
    let first = interfaces.iter().filter_map(|interface| {
        let count = usize::try_from(interface.count).unwrap_or(0);
        // SAFETY: as above.
        let settings = unsafe { entries(interface.settings, count) };
        settings.iter().find(|setting| setting.alternate == 0)
    });
    first
        .map(|setting| {
            // SAFETY: as above.
            let endpoints = unsafe { entries(setting.endpoints, setting.endpoint_count.into()) };
            let endpoint = |of: &api::EndpointDescriptor| Endpoint {
                address: of.address,
                attributes: of.attributes,
                packet: of.packet,
            };
            let endpoints = endpoints.iter().map(endpoint).collect();
            Interface { number: setting.number, class: setting.class, endpoints }
        })
        .collect()
}

/// An array of C; the null pointer is one without entries.
///
/// # Safety
/// `first` is null or points to `count` entries, which stay as they are for `'a`.
unsafe fn entries<'a, T>(first: *const T, count: usize) -> &'a [T] {
    if first.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: by the caller's promise.
    unsafe { slice::from_raw_parts(first, count) }
}
