//! Rust types that own libusb's objects and free them on drop: the context, a device, an open handle.

use std::ffi::c_int;
use std::io;
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::Arc;
use std::time::Duration;

use super::UsbError;
use super::api::{
    self, Api, BULK, ConfigurationDescriptor, DeviceDescriptor, HIGH_SPEED, INTERRUPTED, LibusbMissing, RawContext,
    RawDevice, RawHandle,
};
use crate::threads::{self, LetGo};

/// The length of the array for the port numbers from the root hub to a device, as libusb's documentation recommends.
/// USB 2.0 4.1.1 allows five hubs in a row.
const PORTS_MAX: usize = 7;

/// The reason why USB cannot be used on this machine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UsbBusError {
    /// libusb cannot be loaded, for example because it is not installed.
    #[error(transparent)]
    LibusbMissing(#[from] LibusbMissing),
    /// libusb reports an error when it accesses USB.
    #[error("USB cannot be used on this machine ({0}); does it have USB, and /dev/bus/usb?")]
    Usb(#[from] UsbError),
}

/// All USB buses of this machine, as a libusb context.
pub struct Bus {
    api: &'static Api,
    raw: NonNull<RawContext>,
}

// SAFETY: libusb's contexts may be used by any threads at once.
unsafe impl Send for Bus {}
// SAFETY: libusb's contexts may be used by any threads at once.
unsafe impl Sync for Bus {}

impl Bus {
    /// Loads libusb and creates a libusb context.
    ///
    /// # Errors
    /// [`UsbBusError`] if libusb cannot be loaded, or if it cannot access USB.
    pub fn open() -> Result<Arc<Self>, UsbBusError> {
        Ok(Self::over(api::load()?)?)
    }

    /// Creates a context through the functions in `api`: the functions of the real libusb, or of a simulated libusb in
    /// tests.
    pub(super) fn over(api: &'static Api) -> Result<Arc<Self>, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: `raw` receives the new context. libusb starts a thread here that handles hotplug events. Signals are
        // blocked in it, so that the program's signal handlers run in the program's own threads only.
        let code = threads::with_signals_blocked(|| unsafe { (api.init)(&raw mut raw) })
            .map_err(|_| UsbError::NotSupported)?;
        UsbError::check(code)?;
        Ok(Arc::new(Self { api, raw: NonNull::new(raw).ok_or(UsbError::NoMemory)? }))
    }

    /// Lists the devices that are connected to this machine's USB.
    pub(super) fn devices(self: &Arc<Self>) -> Result<Vec<Device>, UsbError> {
        let mut list = ptr::null_mut();
        // SAFETY: `list` receives an array, which is freed below.
        let count = unsafe { (self.api.devices)(self.raw.as_ptr(), &raw mut list) };
        let Ok(count) = usize::try_from(count) else {
            return Err(UsbError::check(c_int::try_from(count).unwrap_or(-1)).err().unwrap_or(UsbError::Io));
        };
        // SAFETY: the array has `count` entries.
        let all = unsafe { entries(list.cast_const(), count) };
        let devices = all.iter().filter_map(|raw| Some(Device { bus: self.clone(), raw: NonNull::new(*raw)? }));
        let devices = devices.collect();
        // SAFETY: the array came from libusb. With 0 the references to its devices are kept, which `Device` drops.
        unsafe { (self.api.free_devices)(list, 0) };
        Ok(devices)
    }

    pub(super) const fn api(&self) -> &'static Api {
        self.api
    }

    /// Waits for events in libusb for at most `limit` and handles them.
    fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        let mut limit = libc::timeval {
            tv_sec: limit.as_secs() as libc::time_t,
            tv_usec: limit.subsec_micros() as libc::suseconds_t,
        };
        // SAFETY: the context is valid until `drop`.
        let code = unsafe { (self.api.handle_events)(self.raw.as_ptr(), &raw mut limit, ptr::null_mut()) };
        // Threads of the program wait here too. A signal to one of them ends the wait, which is no error.
        if code == INTERRUPTED { Ok(()) } else { UsbError::check(code).map(drop) }
    }

    /// Ends the wait in [`Bus::handle_events`], from another thread.
    pub(super) fn interrupt(&self) {
        // SAFETY: the context is valid until `drop`.
        unsafe { (self.api.interrupt)(self.raw.as_ptr()) };
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        // SAFETY: devices and handles hold a reference to the bus, so none of them exists any more.
        unsafe { (self.api.exit)(self.raw.as_ptr()) };
    }
}

/// A device that is connected to USB; any device, not only a board.
pub(in crate::io::hid) struct Device {
    bus: Arc<Bus>,
    raw: NonNull<RawDevice>,
}

// SAFETY: libusb's devices may be used by any threads at once.
unsafe impl Send for Device {}
// SAFETY: libusb's devices may be used by any threads at once.
unsafe impl Sync for Device {}

/// An interface of a device, with the endpoints of its alternate setting 0, which is active after the interface is
/// claimed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct UsbInterface {
    pub number: u8,
    pub class: u8,
    pub endpoints: Vec<Endpoint>,
}

/// The fields of an endpoint descriptor that this crate uses: bEndpointAddress, bmAttributes and wMaxPacketSize.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endpoint {
    pub address: u8,
    pub attributes: u8,
    pub packet: u16,
}

impl Device {
    /// The USB vendor id and product id (idVendor, idProduct).
    pub fn ids(&self) -> Result<(u16, u16), UsbError> {
        let mut descriptor = DeviceDescriptor::default();
        // SAFETY: the device is valid until `drop`; `descriptor` receives the copy.
        UsbError::check(unsafe { (self.bus.api.device_descriptor)(self.raw.as_ptr(), &raw mut descriptor) })?;
        Ok((descriptor.vendor, descriptor.product))
    }

    /// Bus number and device address, which name the device node below /dev/bus/usb.
    pub fn bus_and_address(&self) -> (u8, u8) {
        // SAFETY: the device is valid until `drop`.
        unsafe { ((self.bus.api.bus_number)(self.raw.as_ptr()), (self.bus.api.address)(self.raw.as_ptr())) }
    }

    /// The port numbers on the path from the root hub to the device.
    pub fn ports(&self) -> Vec<u8> {
        let mut ports = [0; PORTS_MAX];
        // SAFETY: the device is valid until `drop`; the array has `PORTS_MAX` entries.
        let count = unsafe { (self.bus.api.ports)(self.raw.as_ptr(), ports.as_mut_ptr(), PORTS_MAX as c_int) };
        ports[..usize::try_from(count).unwrap_or(0).min(PORTS_MAX)].to_vec()
    }

    /// Whether the device runs at high speed, 480 Mbit/s.
    pub fn high_speed(&self) -> bool {
        // SAFETY: the device is valid until `drop`.
        unsafe { (self.bus.api.speed)(self.raw.as_ptr()) == HIGH_SPEED }
    }

    /// The interfaces of the active configuration; [`UsbError::NotFound`] if none is active.
    pub(super) fn interfaces(&self) -> Result<Vec<UsbInterface>, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the device is valid until `drop`; `raw` receives a tree of descriptors, which is freed below.
        UsbError::check(unsafe { (self.bus.api.configuration)(self.raw.as_ptr(), &raw mut raw) })?;
        let Some(tree) = NonNull::new(raw) else { return Err(UsbError::NotFound) };
        // SAFETY: the tree came from libusb, so its counts are those of its arrays.
        let interfaces = unsafe { interfaces(tree.as_ref()) };
        // SAFETY: `interfaces` has copied what it needs.
        unsafe { (self.bus.api.free_configuration)(tree.as_ptr()) };
        Ok(interfaces)
    }

    /// Opens the device for transfers. Fails with [`UsbError::Access`] if this user has no permission, and with
    /// [`UsbError::NoDevice`] if the device was unplugged.
    pub(super) fn open(&self) -> Result<Handle, UsbError> {
        let mut raw = ptr::null_mut();
        // SAFETY: the device is valid until `drop`; `raw` receives the handle.
        UsbError::check(unsafe { (self.bus.api.open)(self.raw.as_ptr(), &raw mut raw) })?;
        let raw = NonNull::new(raw).ok_or(UsbError::NoMemory)?;
        let events = Descriptors::of(&self.bus);
        let let_go = events.all[..events.count].iter().map(|one| LetGo::of(one.fd)).collect();
        Ok(Handle { bus: self.bus.clone(), raw, events, let_go })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the reference to the device was kept when `Bus::devices` freed the list, and is dropped here only.
        unsafe { (self.bus.api.unref_device)(self.raw.as_ptr()) };
    }
}

/// A device that was opened, as libusb's device handle.
pub(super) struct Handle {
    bus: Arc<Bus>,
    raw: NonNull<RawHandle>,
    events: Descriptors,
    /// Registers the descriptors, so that a forked child closes its copies and releases the device.
    let_go: Vec<LetGo>,
}

/// The file descriptors that signal libusb's events; none if libusb does not provide them.
///
/// A thread that waits inside libusb holds its locks, and programs may end waiting threads by force. So a thread waits
/// for the descriptors, and enters libusb only to handle events that have come.
struct Descriptors {
    all: [libc::pollfd; Self::MAX],
    count: usize,
}

impl Descriptors {
    /// The maximum number of descriptors: libusb has one for itself, one for its timer and one for each device that is
    /// open in its context, which is one device here. With more of them, threads wait inside libusb. \[OURS]
    const MAX: usize = 8;

    fn of(bus: &Bus) -> Self {
        let mut found = Self { all: [libc::pollfd { fd: -1, events: 0, revents: 0 }; Self::MAX], count: 0 };
        // SAFETY: the context is valid; the list ends with a null pointer and is freed below.
        unsafe {
            let list = (bus.api.descriptors)(bus.raw.as_ptr());
            if list.is_null() {
                return found;
            }
            let mut next = list;
            while let Some(one) = (*next).as_ref() {
                if let Some(place) = found.all.get_mut(found.count) {
                    (place.fd, place.events) = (one.descriptor, one.events);
                }
                found.count += 1;
                next = next.add(1);
            }
            (bus.api.free_descriptors)(list);
        }
        if found.count > Self::MAX {
            found.count = 0;
        }
        found
    }

    /// Waits for an event for at most `limit`. Returns `true` if a descriptor is readable: the caller then has to let
    /// libusb handle its events.
    fn wait(&self, limit: Duration) -> Result<bool, UsbError> {
        let mut all = self.all;
        let limit_ms = c_int::try_from(limit.as_micros().div_ceil(1000)).unwrap_or(c_int::MAX);
        // SAFETY: `all` has at least `count` entries.
        let ready = unsafe { libc::poll(all.as_mut_ptr(), self.count as libc::nfds_t, limit_ms) };
        match ready {
            0 => Ok(false),
            1.. => Ok(true),
            // A signal to the program has ended the wait. This is no error.
            _ if io::Error::last_os_error().kind() == io::ErrorKind::Interrupted => Ok(false),
            _ => Err(UsbError::Io),
        }
    }
}

// SAFETY: libusb's handles may be used by any threads at once.
unsafe impl Send for Handle {}
// SAFETY: libusb's handles may be used by any threads at once.
unsafe impl Sync for Handle {}

impl Handle {
    pub const fn bus(&self) -> &Arc<Bus> {
        &self.bus
    }

    pub const fn raw(&self) -> *mut RawHandle {
        self.raw.as_ptr()
    }

    /// Waits for events for at most `limit` and handles them, which calls the transfers' callbacks.
    pub fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        if limit.is_zero() || self.events.count == 0 {
            return self.bus.handle_events(limit);
        }
        if self.events.wait(limit)? { self.bus.handle_events(Duration::ZERO) } else { Ok(()) }
    }

    /// Makes libusb detach the kernel's driver from an interface when it is claimed, and attach the driver again on
    /// release.
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

    /// Sends bytes to an endpoint and waits for at most `limit`. `kind` is the transfer type of the endpoint, [`BULK`]
    /// or interrupt. Returns libusb's return code and the number of bytes sent.
    pub fn send(&self, endpoint: u8, kind: u8, bytes: &[u8], limit: Duration) -> (c_int, usize) {
        // SAFETY: libusb only reads the bytes that it sends.
        unsafe { self.transfer(endpoint, kind, bytes.as_ptr().cast_mut(), bytes.len(), limit) }
    }

    /// Like [`Self::send`], but receives bytes from an endpoint.
    pub fn receive(&self, endpoint: u8, kind: u8, bytes: &mut [u8], limit: Duration) -> (c_int, usize) {
        // SAFETY: the buffer is this function's alone.
        unsafe { self.transfer(endpoint, kind, bytes.as_mut_ptr(), bytes.len(), limit) }
    }

    /// Transfers bytes to or from an endpoint and waits for at most `limit`.
    ///
    /// # Safety
    /// `bytes` points to `len` bytes, which libusb writes to if the endpoint sends to the host.
    unsafe fn transfer(&self, endpoint: u8, kind: u8, bytes: *mut u8, len: usize, limit: Duration) -> (c_int, usize) {
        let api = self.bus.api;
        let transfer = if kind == BULK { api.bulk_transfer } else { api.interrupt_transfer };
        let mut moved = 0;
        // libusb treats a timeout of 0 as "no limit", so the minimum is 1 ms.
        let limit_ms = limit.as_millis().clamp(1, u32::MAX.into()) as u32;
        // SAFETY: the handle is open until `drop`. By the caller's promise `bytes` points to `len` bytes. libusb does
        // not use them any more when it returns.
        let code = unsafe { transfer(self.raw(), endpoint, bytes, len as c_int, &raw mut moved, limit_ms) };
        (code, usize::try_from(moved).unwrap_or(0).min(len))
    }

    /// Clears the halt of a stalled endpoint. No transfer on that endpoint may be submitted meanwhile.
    pub fn clear_halt(&self, endpoint: u8) -> Result<(), UsbError> {
        // SAFETY: the handle is open until `drop`.
        UsbError::check(unsafe { (self.bus.api.clear_halt)(self.raw(), endpoint) }).map(drop)
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.let_go.clear();
        // SAFETY: transfers hold a reference to the handle, so none of them exists any more.
        unsafe { (self.bus.api.close)(self.raw()) };
    }
}

/// Copies the interfaces of a configuration.
///
/// # Safety
/// `tree` came from libusb.
unsafe fn interfaces(tree: &ConfigurationDescriptor) -> Vec<UsbInterface> {
    // SAFETY: by the caller's promise the tree came from libusb, so its counts are those of its arrays.
    let interfaces = unsafe { entries(tree.interfaces, tree.interface_count.into()) };
    let first = interfaces.iter().filter_map(|interface| {
        let count = usize::try_from(interface.count).unwrap_or(0);
        // SAFETY: by the caller's promise the tree came from libusb, so its counts are those of its arrays.
        let settings = unsafe { entries(interface.settings, count) };
        settings.iter().find(|setting| setting.alternate == 0)
    });
    first
        .map(|setting| {
            // SAFETY: by the caller's promise the tree came from libusb, so its counts are those of its arrays.
            let endpoints = unsafe { entries(setting.endpoints, setting.endpoint_count.into()) };
            let endpoint = |of: &api::EndpointDescriptor| Endpoint {
                address: of.address,
                attributes: of.attributes,
                packet: of.packet,
            };
            let endpoints = endpoints.iter().map(endpoint).collect();
            UsbInterface { number: setting.number, class: setting.class, endpoints }
        })
        .collect()
}

/// A C array as a slice; a null pointer gives an empty slice.
///
/// # Safety
/// `first` is null or points to `count` entries, which do not change during `'a`.
unsafe fn entries<'a, T>(first: *const T, count: usize) -> &'a [T] {
    if first.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: by the caller's promise `first` points to `count` entries that do not change.
    unsafe { slice::from_raw_parts(first, count) }
}
