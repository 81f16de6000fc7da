//! Lists the HID devices with the board's ids, and decides by their report lengths which of them can be a board.
//! Windows' device names contain the ids, so that keyboards and other devices need not be opened.

use std::ffi::c_void;
use std::mem;
use std::ptr;
use std::sync::Arc;

use super::api::{
    CR_SUCCESS, Capabilities, DeviceData, DeviceList, Guid, HIDP_SUCCESS, INTERFACE_DETAIL_SIZE, INVALID_HANDLE,
    InterfaceData, InterfaceDetail, PATH_LEN_MAX, PRESENT_INTERFACES,
};
use super::bus::{Bus, Device};
use super::handle::OwnedHandle;
use super::{NUMBERED_LEN, UsbError, codes, names};
use crate::io::hid::NotTheBoard;
#[cfg(windows)]
use crate::io::hid::{FoundDevice, Sysfs};

/// The size of the buffer for a text of a device, in UTF-16 units. A string descriptor has at most 126 units.
const TEXT_LEN: usize = 128;
/// The maximum number of levels from a HID device up to its USB device: the USB device is the parent, or the
/// grandparent if it has several interfaces.
const PARENTS_MAX: usize = 2;

/// Proof that a device's reports have the wanted size in both directions. It contains no interface and no endpoints,
/// because Windows' HID driver does not report them and needs only the device path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportInterface(());

/// A HID device in Windows' list that has the wanted vendor and product id.
pub(super) struct Candidate {
    pub device: Device,
    pub instance: String,
    pub interface: Result<ReportInterface, NotTheBoard>,
}

/// All devices with this vendor and product id. Nothing is sent to any of them.
///
/// # Errors
/// [`UsbError`], if Windows cannot list the devices.
#[cfg(windows)]
pub fn find(bus: &Arc<Bus>, vendor: u16, product: u16) -> Result<Vec<FoundDevice>, UsbError> {
    let found = candidates(bus, vendor, product)?.into_iter().map(|candidate| {
        let Candidate { device, instance, interface } = candidate;
        FoundDevice { device, path: instance, bus_and_address: (0, 0), high_speed: true, interface }
    });
    Ok(found.collect())
}

#[cfg(windows)]
impl FoundDevice {
    /// The product name and the serial number. If `may_ask`, values unknown to Windows are read from the device.
    pub fn texts(&self, _system: &Sysfs, may_ask: bool) -> (Option<String>, Option<String>) {
        self.device.texts(may_ask)
    }

    /// The error with which Windows refuses to open the device for reports; `None` if it can be opened. The device is
    /// closed again.
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
        // If the device was just unplugged, it is left out of the list.
        let interface = match device.capabilities() {
            Ok(capabilities) => report_interface(&capabilities),
            Err(UsbError::NoDevice) => continue,
            Err(_) => Err(NotTheBoard::Descriptors),
        };
        found.push(Candidate { device, instance: named.instance, interface });
    }
    found.sort_by(|a, b| a.instance.cmp(&b.instance));
    Ok(found)
}

fn report_interface(capabilities: &Capabilities) -> Result<ReportInterface, NotTheBoard> {
    let both = [capabilities.input_len, capabilities.output_len].map(usize::from);
    if both == [NUMBERED_LEN; 2] { Ok(ReportInterface(())) } else { Err(NotTheBoard::OtherReports) }
}

/// The serial number of the USB device above a HID device, if the USB device's name in Windows contains it.
fn serial(bus: &Bus, node: u32) -> Option<String> {
    let mut node = node;
    for _ in 0..PARENTS_MAX {
        let mut parent = 0;
        // SAFETY: `parent` receives a number.
        if unsafe { (bus.api().parent)(&raw mut parent, node, 0) } != CR_SUCCESS {
            return None;
        }
        let mut id = [0; PATH_LEN_MAX];
        // SAFETY: `id` has room for `PATH_LEN_MAX` units.
        if unsafe { (bus.api().device_id)(parent, id.as_mut_ptr(), PATH_LEN_MAX as u32, 0) } != CR_SUCCESS {
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
        let handle = OwnedHandle::open(&self.bus, &self.path, false)?;
        let api = self.bus.api();
        let mut preparsed = ptr::null_mut();
        // SAFETY: the handle is open; `preparsed` receives a pointer that is freed below.
        if unsafe { (api.preparsed)(handle.raw(), &raw mut preparsed) } == 0 {
            return Err(codes::submit_error(self.bus.last_error()));
        }
        let mut capabilities = Capabilities::default();
        // SAFETY: `preparsed` came from Windows and is freed once.
        let status = unsafe {
            let status = (api.capabilities)(preparsed, &raw mut capabilities);
            (api.free_preparsed)(preparsed);
            status
        };
        if status == HIDP_SUCCESS { Ok(capabilities) } else { Err(UsbError::Other(status)) }
    }

    #[cfg(windows)]
    fn refused(&self) -> Option<UsbError> {
        OwnedHandle::open(&self.bus, &self.path, true).err()
    }

    /// The product name and the serial number. If `may_ask`, values unknown to Windows are read from the device.
    pub(super) fn texts(&self, may_ask: bool) -> (Option<String>, Option<String>) {
        let asked = if may_ask { OwnedHandle::open(&self.bus, &self.path, false).ok() } else { None };
        let text = |function: unsafe extern "system" fn(_, *mut c_void, u32) -> u8| {
            let mut text = [0_u16; TEXT_LEN];
            // SAFETY: the handle is open, and the buffer has room for the stated number of bytes.
            let done =
                unsafe { function(asked.as_ref()?.raw(), text.as_mut_ptr().cast(), mem::size_of_val(&text) as u32) };
            if done != 0 { names::text(&text) } else { None }
        };
        let api = self.bus.api();
        (text(api.product_text), self.serial.clone().or_else(|| text(api.serial_text)))
    }
}

/// Windows' list of the connected HID devices (`HDEVINFO`).
struct List<'a> {
    bus: &'a Bus,
    class: Guid,
    raw: DeviceList,
}

impl<'a> List<'a> {
    fn of_hid(bus: &'a Bus) -> Result<Self, UsbError> {
        let mut class = Guid::default();
        // SAFETY: `class` receives the copy; the list is freed when it is dropped.
        let raw = unsafe {
            (bus.api().hid_class)(&raw mut class);
            (bus.api().list)(&raw const class, ptr::null(), ptr::null_mut(), PRESENT_INTERFACES)
        };
        if raw == INVALID_HANDLE {
            return Err(codes::open_error(bus.last_error()));
        }
        Ok(Self { bus, class, raw })
    }

    /// Entry `number` of the list; `None` if the list is shorter.
    fn interface(&self, number: u32) -> Option<InterfaceData> {
        let mut data = InterfaceData { size: mem::size_of::<InterfaceData>() as u32, ..InterfaceData::default() };
        let list = self.bus.api().interface;
        // SAFETY: the list is valid until `drop`; `data` receives the copy.
        let there = unsafe { list(self.raw, ptr::null(), &raw const self.class, number, &raw mut data) };
        (there != 0).then_some(data)
    }

    /// The path of an interface, terminated by a zero, and the node number of its device; `None` if the device was just
    /// unplugged.
    fn detail(&self, interface: &InterfaceData) -> Option<(Vec<u16>, u32)> {
        let mut detail = Box::new(InterfaceDetail { size: INTERFACE_DETAIL_SIZE, path: [0; PATH_LEN_MAX] });
        let mut device = DeviceData { size: mem::size_of::<DeviceData>() as u32, ..DeviceData::default() };
        let room = mem::size_of::<InterfaceDetail>() as u32;
        // SAFETY: the list is valid until `drop`; `detail` has room for the stated number of bytes.
        let done = unsafe {
            (self.bus.api().detail)(self.raw, interface, &raw mut *detail, room, ptr::null_mut(), &raw mut device)
        };
        let end = detail.path.iter().position(|unit| *unit == 0)?;
        (done != 0 && end > 0).then(|| (detail.path[..=end].to_vec(), device.node))
    }
}

impl Drop for List<'_> {
    fn drop(&mut self) {
        // SAFETY: the list is freed here only.
        unsafe { (self.bus.api().free_list)(self.raw) };
    }
}
