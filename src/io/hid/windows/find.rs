//! Which of the HID devices have the wanted shape. The ids are in the names that Windows gives to devices: keyboards and
//! other devices of the user are not opened.

use std::ffi::c_void;
use std::mem;
use std::ptr;
use std::sync::Arc;

use super::api::{
    CR_SUCCESS, Capabilities, DeviceData, DeviceList, Guid, HIDP_SUCCESS, INTERFACE_DETAIL_SIZE, INVALID_HANDLE,
    InterfaceData, InterfaceDetail, LONGEST_PATH, PRESENT_INTERFACES,
};
use super::bus::{Bus, Device};
use super::handle::Owned;
use super::{NUMBERED_LEN, UsbError, codes, names};
use crate::io::hid::NotOne;
#[cfg(windows)]
use crate::io::hid::{Found, System};

/// Units of UTF-16 in a device's text: a string descriptor has 126 at most.
const TEXT_LEN: usize = 128;
/// A HID device's parent is the USB device, or an interface of it whose parent is.
const PARENTS: usize = 2;

/// Its reports have the wanted size both ways; which endpoints move them is the driver's affair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape(());

/// A device with the wanted ids.
pub(super) struct Candidate {
    pub device: Device,
    pub instance: String,
    pub shape: Result<Shape, NotOne>,
}

/// All devices of that pair. Nothing is sent to any of them.
///
/// # Errors
/// Those of Windows.
#[cfg(windows)]
pub fn find(bus: &Arc<Bus>, vendor: u16, product: u16) -> Result<Vec<Found>, UsbError> {
    let found = candidates(bus, vendor, product)?.into_iter().map(|candidate| {
        let Candidate { device, instance, shape } = candidate;
        Found { device, path: instance, node: (0, 0), high_speed: true, shape }
    });
    Ok(found.collect())
}

#[cfg(windows)]
impl Found {
    /// Its name and its serial number. What Windows does not know without it is asked of the device, if it may be asked.
    pub fn texts(&self, _system: &System, may_ask: bool) -> (Option<String>, Option<String>) {
        self.device.texts(may_ask)
    }

    /// Why Windows does not open it to move reports; it is closed again.
    pub fn refused(&self) -> Option<UsbError> {
        self.device.refused()
    }
}

pub(super) fn candidates(bus: &Arc<Bus>, vendor: u16, product: u16) -> Result<Vec<Candidate>, UsbError> {
    let list = List::of_hid(bus)?;
    let mut found = Vec::new();
    for number in 0.. {
        let Some(interface) = list.interface(number) else { break };
        let Some((path, node)) = list.detail(&interface) else { continue };
        let named = names::text(&path).and_then(|path| names::of_path(&path));
        let Some(named) = named.filter(|named| (named.vendor, named.product) == (vendor, product)) else { continue };
        let device = Device { bus: bus.clone(), path, serial: serial(bus, node) };
        // A device that goes while it is looked at is none.
        let shape = match device.capabilities() {
            Ok(capabilities) => shape(&capabilities),
            Err(UsbError::NoDevice) => continue,
            Err(_) => Err(NotOne::Descriptors),
        };
        found.push(Candidate { device, instance: named.instance, shape });
    }
    found.sort_by(|a, b| a.instance.cmp(&b.instance));
    Ok(found)
}

fn shape(capabilities: &Capabilities) -> Result<Shape, NotOne> {
    let both = [capabilities.input_len, capabilities.output_len].map(usize::from);
    if both == [NUMBERED_LEN; 2] { Ok(Shape(())) } else { Err(NotOne::OtherReports) }
}

/// The serial number of the USB device that a HID device belongs to, as far as Windows' name of it says it.
fn serial(bus: &Bus, node: u32) -> Option<String> {
    let mut node = node;
    for _ in 0..PARENTS {
        let mut parent = 0;
        // SAFETY: `parent` takes a number.
        if unsafe { (bus.api().parent)(&raw mut parent, node, 0) } != CR_SUCCESS {
            return None;
        }
        let mut id = [0; LONGEST_PATH];
        // SAFETY: `id` has room for as much as is said.
        if unsafe { (bus.api().device_id)(parent, id.as_mut_ptr(), LONGEST_PATH as u32, 0) } != CR_SUCCESS {
            return None;
        }
        let id = names::text(&id)?;
        if let Some(serial) = names::serial_of(&id) {
            return Some(serial.to_owned());
        }
        node = parent;
    }
    None
}

impl Device {
    fn capabilities(&self) -> Result<Capabilities, UsbError> {
        let handle = Owned::open(&self.bus, &self.path, false)?;
        let api = self.bus.api();
        let mut preparsed = ptr::null_mut();
        // SAFETY: the handle is open; `preparsed` takes what is given back below.
        if unsafe { (api.preparsed)(handle.raw(), &raw mut preparsed) } == 0 {
            return Err(codes::refused(self.bus.last_error()));
        }
        let mut capabilities = Capabilities::default();
        // SAFETY: Windows has just made it; it is given back once.
        let status = unsafe {
            let status = (api.capabilities)(preparsed, &raw mut capabilities);
            (api.free_preparsed)(preparsed);
            status
        };
        if status == HIDP_SUCCESS { Ok(capabilities) } else { Err(UsbError::Other(status)) }
    }

    #[cfg(windows)]
    fn refused(&self) -> Option<UsbError> {
        Owned::open(&self.bus, &self.path, true).err()
    }

    /// Name and serial number; the device is asked for what Windows does not know, if it may be.
    pub(super) fn texts(&self, may_ask: bool) -> (Option<String>, Option<String>) {
        let asked = if may_ask { Owned::open(&self.bus, &self.path, false).ok() } else { None };
        let text = |function: unsafe extern "system" fn(_, *mut c_void, u32) -> u8| {
            let mut text = [0_u16; TEXT_LEN];
            // SAFETY: the handle is open, and the buffer has room for as many bytes as is said.
            let done =
                unsafe { function(asked.as_ref()?.raw(), text.as_mut_ptr().cast(), mem::size_of_val(&text) as u32) };
            if done != 0 { names::text(&text) } else { None }
        };
        let api = self.bus.api();
        (text(api.product_text), self.serial.clone().or_else(|| text(api.serial_text)))
    }
}

/// Windows' list of the HID devices that are present.
struct List<'a> {
    bus: &'a Bus,
    class: Guid,
    raw: DeviceList,
}

impl<'a> List<'a> {
    fn of_hid(bus: &'a Bus) -> Result<Self, UsbError> {
        let mut class = Guid::default();
        // SAFETY: `class` takes what is copied; the list is given back when it is dropped.
        let raw = unsafe {
            (bus.api().hid_class)(&raw mut class);
            (bus.api().list)(&raw const class, ptr::null(), ptr::null_mut(), PRESENT_INTERFACES)
        };
        if raw == INVALID_HANDLE {
            return Err(codes::error(bus.last_error()));
        }
        Ok(Self { bus, class, raw })
    }

    /// `None`: there are no more.
    fn interface(&self, number: u32) -> Option<InterfaceData> {
        let mut data = InterfaceData { size: mem::size_of::<InterfaceData>() as u32, ..InterfaceData::default() };
        let list = self.bus.api().interface;
        // SAFETY: the list is there until `drop`; `data` takes what is copied.
        let there = unsafe { list(self.raw, ptr::null(), &raw const self.class, number, &raw mut data) };
        (there != 0).then_some(data)
    }

    /// The path of an interface, with a zero at its end, and the number of its device. `None`: it has just gone.
    fn detail(&self, interface: &InterfaceData) -> Option<(Vec<u16>, u32)> {
        let mut detail = Box::new(InterfaceDetail { size: INTERFACE_DETAIL_SIZE, path: [0; LONGEST_PATH] });
        let mut device = DeviceData { size: mem::size_of::<DeviceData>() as u32, ..DeviceData::default() };
        let room = mem::size_of::<InterfaceDetail>() as u32;
        // SAFETY: the list is there until `drop`; `detail` has room for as many bytes as is said.
        let done = unsafe {
            (self.bus.api().detail)(self.raw, interface, &raw mut *detail, room, ptr::null_mut(), &raw mut device)
        };
        let end = detail.path.iter().position(|unit| *unit == 0)?;
        (done != 0 && end > 0).then(|| (detail.path[..=end].to_vec(), device.node))
    }
}

impl Drop for List<'_> {
    fn drop(&mut self) {
        // SAFETY: our own list, given back once.
        unsafe { (self.bus.api().free_list)(self.raw) };
    }
}
