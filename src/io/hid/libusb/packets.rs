//! A device that exchanges packets through two endpoints, bulk or interrupt, one transfer at a time. It need not be a
//! HID device.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use super::UsbError;
use super::api::{BULK, INTERRUPT, TIMEOUT};
use super::backend::InterfaceClaim;
use super::bus::{Bus, Handle, UsbBusError, UsbInterface};
use crate::io::descriptors::TO_HOST;

/// The time limit for one packet in one direction. \[OURS]
const PACKET_LIMIT: Duration = Duration::from_secs(1);
/// The bits of an endpoint's bmAttributes that give its transfer type (USB 2.0 table 9-13).
const KIND: u8 = 3;

/// A device by its USB ids, and the numbers of its two endpoints for packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketPlace {
    /// USB vendor id, idVendor.
    pub vendor: u16,
    /// USB product id, idProduct.
    pub product: u16,
    /// The number of the endpoint to the device, 1..=15.
    pub output: u8,
    /// The number of the endpoint to the host, 1..=15.
    pub input: u8,
}

/// Exchanges packets with one device, and has a clock. Only the owner of this value uses the device.
pub trait PacketWires: Send {
    /// The time in nanoseconds; its zero point is arbitrary.
    fn now_ns(&self) -> u64;

    /// Waits for the duration `time`.
    fn sleep(&mut self, time: Duration);

    /// Sends the packet `tx` and receives an answer of the length of `rx`.
    ///
    /// # Errors
    /// [`UsbPacketError`] if one of the two transfers fails, is not complete within 1 s, or has another length. It is
    /// then unknown whether the device has accepted the packet.
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), UsbPacketError>;
}

/// The reason why packets cannot be exchanged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum UsbPacketError {
    /// USB cannot be used on this machine.
    #[error(transparent)]
    Bus(#[from] UsbBusError),
    /// No device has these ids.
    #[error("no device has the ids {vendor:04x}:{product:04x}")]
    Missing { vendor: u16, product: u16 },
    /// Several devices have these ids.
    #[error("{count} devices have the ids {vendor:04x}:{product:04x}")]
    Several { vendor: u16, product: u16, count: usize },
    /// No interface of the device has endpoints with both numbers. `there`: the bulk and interrupt endpoints that it
    /// has.
    #[error("no interface of the device has bulk or interrupt endpoints {output} out and {input} in; it has {there}")]
    NoEndpoints { output: u8, input: u8, there: String },
    /// The device cannot be opened or used.
    #[error("{0}")]
    Usb(#[from] UsbError),
    /// The device has not accepted a packet, or has not sent one, within the time limit.
    #[error("the device {what} within {limit:?}")]
    Late { what: &'static str, limit: Duration },
    /// The device has accepted or sent another number of bytes than a packet has.
    #[error("the device {what} {found} bytes and not {wanted}")]
    Length { what: &'static str, found: usize, wanted: usize },
}

/// A device that this process has opened, with its interface claimed. Its monotonic clock is 0 at the opening.
pub struct PacketDevice {
    claim: InterfaceClaim,
    output: Endpoint,
    input: Endpoint,
    opened: Instant,
}

/// The address and the transfer type of an endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Endpoint {
    address: u8,
    kind: u8,
}

impl PacketDevice {
    /// Opens the device, and detaches the kernel's driver from its interface until this value is dropped.
    ///
    /// # Errors
    /// [`UsbPacketError`] if no device or several devices have the ids, if no interface has the endpoints, or if the
    /// system refuses to open the device or to claim the interface.
    pub fn open(bus: &Arc<Bus>, place: PacketPlace) -> Result<Self, UsbPacketError> {
        let PacketPlace { vendor, product, .. } = place;
        let mut found = bus.devices()?;
        // The ids of a device that was just unplugged cannot be read, so it is left out.
        found.retain(|device| device.ids() == Ok((vendor, product)));
        let [device] = &found[..] else {
            return Err(match found.len() {
                0 => UsbPacketError::Missing { vendor, product },
                count => UsbPacketError::Several { vendor, product, count },
            });
        };
        let interfaces = device.interfaces()?;
        let (number, output, input) = endpoints(&interfaces, place)?;
        let handle = Arc::new(device.open()?);
        match handle.detach_driver_by_itself() {
            // libusb cannot detach drivers on this system: here no kernel driver keeps a program from claiming the
            // interface.
            Ok(()) | Err(UsbError::NotSupported) => {}
            Err(error) => return Err(error.into()),
        }
        let claim = InterfaceClaim::new(&handle, number)?;
        Ok(Self { claim, output, input, opened: Instant::now() })
    }

    const fn handle(&self) -> &Arc<Handle> {
        self.claim.handle()
    }
}

impl PacketWires for PacketDevice {
    fn now_ns(&self) -> u64 {
        u64::try_from(self.opened.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn sleep(&mut self, time: Duration) {
        thread::sleep(time);
    }

    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), UsbPacketError> {
        let Endpoint { address, kind } = self.output;
        let (code, moved) = self.handle().send(address, kind, tx, PACKET_LIMIT);
        check(code, moved, tx.len(), ["takes no packet", "takes"])?;
        let Endpoint { address, kind } = self.input;
        let (code, moved) = self.handle().receive(address, kind, rx, PACKET_LIMIT);
        check(code, moved, rx.len(), ["gives no packet", "gives"])
    }
}

/// Converts libusb's return code and the number of bytes transferred to the result of a transfer. `nothing` and `some`
/// are the texts for no bytes in time and for a wrong number of bytes.
fn check(code: i32, found: usize, wanted: usize, [nothing, some]: [&'static str; 2]) -> Result<(), UsbPacketError> {
    if code == TIMEOUT && found == 0 {
        return Err(UsbPacketError::Late { what: nothing, limit: PACKET_LIMIT });
    }
    if code != TIMEOUT {
        UsbError::check(code)?;
    }
    if found == wanted { Ok(()) } else { Err(UsbPacketError::Length { what: some, found, wanted }) }
}

/// The number of the interface that has the two endpoints of `place`, its endpoint to the device, and its endpoint to
/// the host.
fn endpoints(interfaces: &[UsbInterface], place: PacketPlace) -> Result<(u8, Endpoint, Endpoint), UsbPacketError> {
    let carries_packets = |attributes: u8| [BULK, INTERRUPT].contains(&(attributes & KIND));
    let find = |interface: &UsbInterface, address: u8| {
        let endpoint = interface.endpoints.iter().find(|endpoint| endpoint.address == address)?;
        carries_packets(endpoint.attributes).then_some(Endpoint { address, kind: endpoint.attributes & KIND })
    };
    let found = interfaces.iter().find_map(|interface| {
        Some((interface.number, find(interface, place.output)?, find(interface, place.input | TO_HOST)?))
    });
    found.ok_or_else(|| {
        let all = interfaces.iter().flat_map(|interface| &interface.endpoints);
        let usable = all.filter(|endpoint| carries_packets(endpoint.attributes));
        let shown: Vec<String> = usable
            .map(|endpoint| {
                let direction = if endpoint.address & TO_HOST == 0 { "out" } else { "in" };
                format!("{} {direction}", endpoint.address & !TO_HOST)
            })
            .collect();
        let there = if shown.is_empty() { "none".to_owned() } else { shown.join(", ") };
        UsbPacketError::NoEndpoints { output: place.output, input: place.input, there }
    })
}

#[cfg(test)]
mod tests {
    use super::super::bus::Endpoint as Descriptor;
    use super::super::fake::{FakeUsb, PRODUCT, VENDOR};
    use super::*;

    const PLACE: PacketPlace = PacketPlace { vendor: VENDOR, product: PRODUCT, output: 2, input: 1 };

    fn open(usb: &'static FakeUsb, place: PacketPlace) -> Result<PacketDevice, UsbPacketError> {
        PacketDevice::open(&usb.bus().expect("it opens"), place)
    }

    /// XF-16.10 A packet is sent through one endpoint and the answer received through the other. Both have their full
    /// length, and no bytes are left for the next exchange.
    #[test]
    fn packets_go_both_ways() {
        let usb = FakeUsb::new();
        usb.on_packet(|packet| packet.iter().map(|byte| byte ^ 0xFF).collect());
        let mut device = open(usb, PLACE).expect("it is there");
        for number in 0..3 {
            let mut rx = [0; 1024];
            device.exchange(&[number; 1024], &mut rx).expect("it answers");
            assert_eq!(rx, [number ^ 0xFF; 1024]);
        }
        drop(device);
        assert_eq!(usb.leaked(), [0; 5]);
    }

    /// XF-16.11 There are different errors for a device that does not answer, answers too little, or is gone.
    /// Afterwards the device may answer again.
    #[test]
    fn a_device_that_does_not_answer_is_an_error() {
        let usb = FakeUsb::new();
        let mut device = open(usb, PLACE).expect("it is there");
        let mut exchange = || device.exchange(&[1; 1024], &mut [0; 1024]).map_err(|error| error.to_string());
        usb.on_packet(|_| Vec::new());
        assert_eq!(exchange(), Err("the device gives no packet within 1s".to_owned()));
        usb.on_packet(|_| vec![7; 64]);
        assert_eq!(exchange(), Err("the device gives 64 bytes and not 1024".to_owned()));
        usb.answer("send", TIMEOUT);
        assert_eq!(exchange(), Err("the device takes no packet within 1s".to_owned()));
        usb.answers_as_it_is();
        usb.on_packet(<[u8]>::to_vec);
        assert_eq!(exchange(), Ok(()));
        usb.pull();
        assert_eq!(exchange(), Err("no such device".to_owned()));
    }

    /// XF-16.11 The errors of a device that is missing, is not the only one, has no such endpoints or cannot be opened.
    #[test]
    fn a_device_that_cannot_be_opened_is_named() {
        let said = |usb, place| open(usb, place).err().expect("it does not open").to_string();
        let usb = FakeUsb::new();
        assert_eq!(said(usb, PacketPlace { product: 1, ..PLACE }), "no device has the ids 16c0:0001");
        let other = said(usb, PacketPlace { output: 1, input: 2, ..PLACE });
        assert!(other.ends_with("endpoints 1 out and 2 in; it has 1 in, 2 out"), "{other}");
        assert_eq!(usb.leaked(), [0; 5]);
        for (call, code, expected) in
            [("open", -3, "access denied"), ("claim", -6, "busy"), ("configuration", -5, "not found")]
        {
            let usb = FakeUsb::new();
            usb.answer(call, code);
            assert_eq!(said(usb, PLACE), expected);
            assert_eq!(usb.leaked(), [0; 5], "{call}");
        }
    }

    /// XF-16.10 The endpoints must be bulk or interrupt endpoints of one interface.
    #[test]
    fn endpoints_are_of_one_interface() {
        let descriptor = |address, attributes| Descriptor { address, attributes, packet: 512 };
        let interface =
            |number, endpoints: &[Descriptor]| UsbInterface { number, class: 255, endpoints: endpoints.into() };
        let (out, back) = (descriptor(0x02, 2), descriptor(0x81, 3));
        let found = endpoints(&[interface(0, &[out]), interface(3, &[back, out])], PLACE).expect("it has them");
        assert_eq!(found, (3, Endpoint { address: 0x02, kind: BULK }, Endpoint { address: 0x81, kind: INTERRUPT }));
        for others in [
            vec![],
            vec![interface(0, &[out]), interface(1, &[back])],
            vec![interface(0, &[out, descriptor(0x81, 1)])],
            vec![interface(0, &[out, descriptor(0x01, 2)])],
        ] {
            assert!(endpoints(&others, PLACE).is_err(), "{others:?}");
        }
    }
}
