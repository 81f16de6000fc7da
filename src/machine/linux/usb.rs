//! USB devices that may be a board, read from sysfs. So they are also found for users who may not open them, and in
//! builds without libusb. The criteria for a board are those of the link `usb:`.

mod descriptors;

pub use descriptors::report_interface;

use super::Machine;
pub use crate::io::descriptors::{NotTheBoard, ReportInterface};
use crate::sk::BOARD_IDS;

/// The folder of all USB devices.
const DEVICES: &str = "/sys/bus/usb/devices";
/// The attribute `speed` of a device at high speed, in Mbit/s.
const HIGH_SPEED: &str = "480";
/// The bit of a configuration's bmAttributes for self-powered devices (USB 2.0 table 9-10).
const SELF_POWERED: u16 = 0x40;

/// A device with the board's vendor and product id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbDevice {
    /// Bus and ports as Linux names them, such as `1-2.3`.
    pub path: String,
    /// The product name; `None` if the device has none.
    pub name: Option<String>,
    /// The serial number; `None` if the device has none.
    pub serial: Option<String>,
    /// The manufacturer; `None` if the device names none.
    pub manufacturer: Option<String>,
    /// The interface with the board's reports, or the reason why the device is not a board.
    pub interface: Result<ReportInterface, NotTheBoard>,
    /// The device file that libusb opens, such as `/dev/bus/usb/001/004`; `None` if the kernel does not report it.
    pub node: Option<String>,
    /// The speed in Mbit/s; `480` is high speed.
    pub speed: Option<String>,
    /// Whether the kernel has chosen a configuration, without which a device cannot be used.
    pub configured: bool,
    /// Whether the kernel allows the device to be used (`authorized`).
    pub authorized: bool,
    /// The largest current that the device requests, such as `100mA`.
    pub max_power: Option<String>,
    /// The drivers of the device and of its interfaces.
    pub drivers: Vec<Driver>,
    /// The hidraw files of the device, such as `/dev/hidraw0`.
    pub hidraw: Vec<String>,
    /// Whether the kernel suspends the device while no program uses it, and after which delay.
    pub autosuspend: Autosuspend,
    /// The hub that the device is connected to; `None` for a port of the machine itself.
    pub hub: Option<Hub>,
    /// How many times the port of the device has cut the power because of an over-current, since its hub was connected.
    pub over_current: u64,
}

/// A driver of a device or of one of its interfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Driver {
    /// The interface, such as `1-2.3:1.0`, or the device, such as `1-2.3`.
    pub interface: String,
    /// The name of the driver, such as `usbhid`. The kernel shows `usbfs` for a program that uses libusb.
    pub name: String,
}

/// Whether the kernel suspends a device that no program uses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Autosuspend {
    /// The value of `power/control`: `on` for never, `auto` for after the delay.
    pub control: Option<String>,
    /// The delay in milliseconds; never if it is negative.
    pub delay_ms: Option<i64>,
    /// The value of `power/runtime_status`, such as `active` or `suspended`.
    pub status: Option<String>,
}

impl Autosuspend {
    /// Whether the kernel may suspend the device while no program uses it.
    pub fn may_sleep(&self) -> bool {
        self.control.as_deref() == Some("auto") && self.delay_ms.is_none_or(|delay| delay >= 0)
    }
}

/// The USB hub that a device is connected to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hub {
    /// Bus and ports of the hub, such as `1-2`.
    pub path: String,
    /// Whether the hub has its own power supply; `None` if its descriptors cannot be read.
    pub self_powered: Option<bool>,
}

impl UsbDevice {
    /// The URI of the link that opens this device.
    pub fn link(&self) -> String {
        format!("usb:?path={}", self.path)
    }

    /// Whether the device runs at high speed, 480 Mbit/s.
    pub fn is_high_speed(&self) -> bool {
        self.speed.as_deref() == Some(HIGH_SPEED)
    }

    /// The device files by which programs may have opened the device: the one for libusb, and the hidraw files.
    pub fn files(&self) -> Vec<String> {
        self.node.iter().chain(&self.hidraw).cloned().collect()
    }

    /// Name and serial number, such as `ECM-SK, serial 7`; `None` if the device has neither.
    pub fn shown(&self) -> Option<String> {
        match (&self.name, &self.serial) {
            (Some(name), Some(serial)) => Some(format!("{name}, serial {serial}")),
            (Some(name), None) => Some(name.clone()),
            (None, Some(serial)) => Some(format!("serial {serial}")),
            (None, None) => None,
        }
    }
}

impl Machine {
    /// Whether the kernel has support for USB.
    pub fn has_usb(&self) -> bool {
        self.has(DEVICES)
    }

    /// All devices with the board's ids, sorted by their paths as the link `usb:` sorts them.
    pub fn usb_devices(&self) -> Vec<UsbDevice> {
        let names = self.names(DEVICES);
        let devices = names.iter().filter(|name| is_device(name) && self.has_ids(name));
        devices.map(|path| self.usb_device(path, &names)).collect()
    }

    fn has_ids(&self, path: &str) -> bool {
        let id = |name| self.hexadecimal(&format!("{DEVICES}/{path}/{name}"));
        id("idVendor").zip(id("idProduct")) == Some(BOARD_IDS)
    }

    fn usb_device(&self, path: &str, names: &[String]) -> UsbDevice {
        let attribute = |name: &str| self.attribute(&format!("{DEVICES}/{path}/{name}"));
        let number = |name: &str| self.number(&format!("{DEVICES}/{path}/{name}"));
        let configuration = number("bConfigurationValue").and_then(|value| u8::try_from(value).ok());
        let configuration = configuration.filter(|value| *value != 0);
        let bytes = self.bytes(&format!("{DEVICES}/{path}/descriptors")).unwrap_or_default();
        let interfaces: Vec<&String> = names.iter().filter(|name| is_interface(name, path)).collect();
        let [bus, device] = ["busnum", "devnum"].map(|name| number(name).filter(|number| (0..1000).contains(number)));
        UsbDevice {
            path: path.to_owned(),
            name: attribute("product"),
            serial: attribute("serial"),
            manufacturer: attribute("manufacturer"),
            interface: report_interface(&bytes, configuration),
            node: bus.zip(device).map(|(bus, device)| format!("/dev/bus/usb/{bus:03}/{device:03}")),
            speed: attribute("speed"),
            configured: configuration.is_some(),
            authorized: number("authorized") != Some(0),
            max_power: attribute("bMaxPower"),
            drivers: [path]
                .into_iter()
                .chain(interfaces.iter().map(|interface| interface.as_str()))
                .filter_map(|interface| self.driver(interface))
                .collect(),
            hidraw: interfaces.iter().flat_map(|interface| self.hidraw(interface)).collect(),
            autosuspend: Autosuspend {
                control: attribute("power/control"),
                delay_ms: number("power/autosuspend_delay_ms"),
                status: attribute("power/runtime_status"),
            },
            hub: hub_of(path).map(|hub| Hub {
                path: hub.to_owned(),
                self_powered: self
                    .hexadecimal(&format!("{DEVICES}/{hub}/bmAttributes"))
                    .map(|attributes| attributes & SELF_POWERED != 0),
            }),
            over_current: number("port/over_current_count").and_then(|count| u64::try_from(count).ok()).unwrap_or(0),
        }
    }

    fn driver(&self, interface: &str) -> Option<Driver> {
        // The driver `usb`, which is usually bound to a whole device, is left out, because it does not claim any
        // interface.
        let name = self.link_name(&format!("{DEVICES}/{interface}/driver")).filter(|name| name != "usb")?;
        Some(Driver { interface: interface.to_owned(), name })
    }

    /// The hidraw files of an interface. Its folder contains one folder for the HID device, which contains a folder
    /// `hidraw`.
    fn hidraw(&self, interface: &str) -> Vec<String> {
        let folders = self.names(&format!("{DEVICES}/{interface}"));
        let devices = folders.iter().flat_map(|hid| self.names(&format!("{DEVICES}/{interface}/{hid}/hidraw")));
        devices.filter(|name| name.starts_with("hidraw")).map(|name| format!("/dev/{name}")).collect()
    }
}

/// Whether a name is that of a device, such as `1-2.3`, and not of a root hub (`usb1`) or an interface (`1-2.3:1.0`).
fn is_device(name: &str) -> bool {
    let Some((bus, ports)) = name.split_once('-') else { return false };
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    is_number(bus) && ports.split('.').all(is_number)
}

fn is_interface(name: &str, path: &str) -> bool {
    name.strip_prefix(path).is_some_and(|rest| rest.starts_with(':'))
}

/// The path of the hub that the device at `path` is connected to.
fn hub_of(path: &str) -> Option<&str> {
    path.rsplit_once('.').map(|(hub, _)| hub)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_devices() {
        for name in ["1-2", "1-2.3", "10-1.4.11"] {
            assert!(is_device(name), "{name}");
        }
        for name in ["usb1", "1-0:1.0", "1-2:1.0", "1-", "-2", "1-2.", "x-1", "1-2\n"] {
            assert!(!is_device(name), "{name}");
        }
        assert!(is_interface("1-2:1.0", "1-2") && !is_interface("1-2.3:1.0", "1-2") && !is_interface("1-2", "1-2"));
        assert_eq!((hub_of("1-2"), hub_of("1-2.3"), hub_of("1-2.3.4")), (None, Some("1-2"), Some("1-2.3")));
    }
}
