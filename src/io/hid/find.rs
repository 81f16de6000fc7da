//! Which devices on the bus have the wanted shape, and why the others have not.

use rusb::{ConfigDescriptor, Context, Device, DeviceDescriptor, Direction, Speed, TransferType, UsbContext};

use super::REPORT_LEN;

/// Class code of HID interfaces.
const HID: u8 = 3;

/// Where a device's reports move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of the interface.
    pub interface: u8,
    /// Address of the endpoint to the host.
    pub input: u8,
    /// Address of the endpoint to the device.
    pub output: u8,
}

/// A device of the wanted pair of ids.
pub struct Found {
    /// The device.
    pub device: Device<Context>,
    /// Bus and ports, as Linux names it: `1-2.3`.
    pub path: String,
    /// Its serial number; `None`: it has none, or this user may not ask.
    pub serial: Option<String>,
    /// Its name; `None` as for the serial number.
    pub name: Option<String>,
    /// Whether the bus runs at high speed.
    pub high_speed: bool,
    /// Where its reports move, or why it is another device.
    pub shape: Result<Shape, NotOne>,
}

/// Why a device with the right ids is another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotOne {
    /// Its descriptors cannot be read or contradict each other.
    #[error("its descriptors cannot be read")]
    Descriptors,
    /// It is no HID device.
    #[error("it has no HID interface")]
    NoHid,
    /// Its reports are other ones.
    #[error("its HID interface has no interrupt endpoints of {REPORT_LEN} bytes both ways")]
    OtherReports,
}

/// All devices of that pair.
///
/// # Errors
/// Those of libusb.
pub fn find(context: &Context, vendor: u16, product: u16) -> Result<Vec<Found>, rusb::Error> {
    let mut found = Vec::new();
    for device in context.devices()?.iter() {
        // A device that goes while it is looked at is none.
        let Ok(descriptor) = device.device_descriptor() else { continue };
        if descriptor.vendor_id() == vendor && descriptor.product_id() == product {
            found.push(look(device, &descriptor));
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

fn look(device: Device<Context>, descriptor: &DeviceDescriptor) -> Found {
    let shape = match device.active_config_descriptor().or_else(|_| device.config_descriptor(0)) {
        Ok(configuration) => shape(&configuration),
        Err(_) => Err(NotOne::Descriptors),
    };
    let [serial, name] = match device.open() {
        Ok(handle) => {
            [handle.read_serial_number_string_ascii(descriptor).ok(), handle.read_product_string_ascii(descriptor).ok()]
        }
        Err(_) => [None, None],
    };
    let path = path(device.bus_number(), &device.port_numbers().unwrap_or_default());
    Found { path, serial, name, high_speed: device.speed() == Speed::High, shape, device }
}

fn path(bus: u8, ports: &[u8]) -> String {
    let ports = ports.iter().map(u8::to_string).collect::<Vec<_>>().join(".");
    format!("{bus}-{ports}")
}

fn shape(configuration: &ConfigDescriptor) -> Result<Shape, NotOne> {
    let mut why = NotOne::NoHid;
    for interface in configuration.interfaces() {
        for setting in interface.descriptors().filter(|setting| setting.class_code() == HID) {
            why = NotOne::OtherReports;
            let endpoint = |direction| {
                let mut endpoints = setting.endpoint_descriptors().filter(|endpoint| {
                    endpoint.transfer_type() == TransferType::Interrupt
                        && usize::from(endpoint.max_packet_size()) == REPORT_LEN
                        && endpoint.direction() == direction
                });
                endpoints.next().map(|endpoint| endpoint.address())
            };
            if let (Some(input), Some(output)) = (endpoint(Direction::In), endpoint(Direction::Out)) {
                return Ok(Shape { interface: interface.number(), input, output });
            }
        }
    }
    Err(why)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_that_of_linux() {
        assert_eq!(path(1, &[2, 3]), "1-2.3");
        assert_eq!(path(4, &[1]), "4-1");
    }
}
