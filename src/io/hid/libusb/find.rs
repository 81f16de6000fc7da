//! Lists the devices with the board's ids, and decides by their descriptors which of them can be a board.

use std::sync::Arc;

use super::bus::{Bus, Device, UsbInterface};
use super::{FoundDevice, NotTheBoard, ReportInterface, Sysfs, UsbError};
use crate::io::descriptors::{HID, TO_HOST, carries_reports};

/// All devices with this vendor and product id. Nothing is sent to any of them.
///
/// # Errors
/// [`UsbError`], if libusb cannot list the devices.
pub fn find(bus: &Arc<Bus>, vendor: u16, product: u16) -> Result<Vec<FoundDevice>, UsbError> {
    // The ids of a device that was just unplugged cannot be read, so it is left out.
    let wanted = bus.devices()?.into_iter().filter(|device| device.ids() == Ok((vendor, product)));
    let mut found: Vec<FoundDevice> = wanted.map(look).collect();
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

impl FoundDevice {
    /// The product name and the serial number, as the kernel has read them from the device. Nothing is sent to the
    /// device. `_may_ask` matters on Windows only: there it allows requests to the device.
    pub fn texts(&self, system: &Sysfs, _may_ask: bool) -> (Option<String>, Option<String>) {
        (system.name(&self.path), system.serial(&self.path))
    }
}

fn look(device: Device) -> FoundDevice {
    let interface = match device.interfaces() {
        Ok(interfaces) => report_interface(&interfaces),
        Err(UsbError::NotFound) => Err(NotTheBoard::Unconfigured),
        Err(_) => Err(NotTheBoard::Descriptors),
    };
    let bus_and_address = device.bus_and_address();
    let path = path(bus_and_address.0, &device.ports());
    FoundDevice { path, bus_and_address, high_speed: device.high_speed(), interface, device }
}

fn path(bus: u8, ports: &[u8]) -> String {
    let ports = ports.iter().map(u8::to_string).collect::<Vec<_>>().join(".");
    format!("{bus}-{ports}")
}

fn report_interface(interfaces: &[UsbInterface]) -> Result<ReportInterface, NotTheBoard> {
    let mut why = NotTheBoard::NoHid;
    for interface in interfaces.iter().filter(|interface| interface.class == HID) {
        why = NotTheBoard::OtherReports;
        let endpoint = |to_host: bool| {
            let mut endpoints = interface.endpoints.iter().filter(|endpoint| {
                carries_reports(endpoint.attributes, endpoint.packet) && (endpoint.address & TO_HOST != 0) == to_host
            });
            endpoints.next().map(|endpoint| endpoint.address)
        };
        if let (Some(input), Some(output)) = (endpoint(true), endpoint(false)) {
            return Ok(ReportInterface { number: interface.number, input, output });
        }
    }
    Err(why)
}

#[cfg(test)]
mod tests {
    use super::super::bus::Endpoint;
    use super::*;

    #[test]
    fn a_path_is_that_of_linux() {
        assert_eq!(path(1, &[2, 3]), "1-2.3");
        assert_eq!(path(4, &[1]), "4-1");
    }

    fn endpoint(address: u8, attributes: u8, packet: u16) -> Endpoint {
        Endpoint { address, attributes, packet }
    }

    fn hid(endpoints: &[Endpoint]) -> UsbInterface {
        UsbInterface { number: 1, class: HID, endpoints: endpoints.to_vec() }
    }

    /// SK-9.2, SK-9.3 A board is recognised by the class of an interface and the endpoints of that interface. Interface
    /// and endpoints may be at any position in the descriptors.
    #[test]
    fn a_board_is_known_by_its_reports() {
        let (input, output) = (endpoint(0x81, 3, 512), endpoint(0x02, 3, 512));
        let storage = UsbInterface { number: 0, class: 8, endpoints: vec![input, output] };
        let board = ReportInterface { number: 1, input: 0x81, output: 0x02 };
        assert_eq!(report_interface(&[storage.clone(), hid(&[input, output])]), Ok(board));
        assert_eq!(report_interface(&[hid(&[]), hid(&[output, endpoint(0x83, 2, 512), input])]), Ok(board));
        assert_eq!(report_interface(&[]), Err(NotTheBoard::NoHid));
        assert_eq!(report_interface(&[storage]), Err(NotTheBoard::NoHid));
        let others = [
            vec![],
            vec![input],
            vec![output],
            vec![input, endpoint(0x82, 3, 512)],
            vec![input, endpoint(0x02, 2, 512)],
            vec![endpoint(0x81, 3, 64), endpoint(0x02, 3, 64)],
            vec![input, endpoint(0x02, 3, 513)],
        ];
        for endpoints in others {
            assert_eq!(report_interface(&[hid(&endpoints)]), Err(NotTheBoard::OtherReports), "{endpoints:?}");
        }
    }
}
