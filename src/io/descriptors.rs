//! Recognises the board's HID interface by its USB descriptors, read either by libusb or from the kernel's files in
//! sysfs.

/// Size of a report in bytes, in either direction.
pub const REPORT_LEN: usize = 512;
/// bInterfaceClass of a HID interface.
pub const HID: u8 = 3;
/// The direction bit of bEndpointAddress: set for an endpoint that sends to the host.
pub const TO_HOST: u8 = 0x80;

/// The bits of bmAttributes that give an endpoint's transfer type.
const TRANSFER_TYPE: u8 = 0x03;
/// The transfer type "interrupt" in bmAttributes.
const INTERRUPT: u8 = 0x03;
/// The bits of wMaxPacketSize that give the size of a packet in bytes. The bits above them count packets per
/// microframe.
const PACKET: u16 = 0x07FF;

/// The interface and the two interrupt endpoints through which a device sends and receives reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportInterface {
    /// The interface's number, bInterfaceNumber.
    pub number: u8,
    /// bEndpointAddress of the endpoint to the host.
    pub input: u8,
    /// bEndpointAddress of the endpoint to the device.
    pub output: u8,
}

/// Why a device with the board's vendor and product id cannot be a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotTheBoard {
    /// The system has not selected any configuration of the device.
    #[error(
        "this machine has not configured it: its port or hub has too little power for it, or it is still being \
         enumerated; plug it into this machine, or into a hub with a power supply of its own"
    )]
    Unconfigured,
    /// The descriptors cannot be read, or are malformed: a length or a number in them is wrong.
    #[error("its descriptors cannot be read")]
    Descriptors,
    /// The device has no HID interface.
    #[error("it has no HID interface")]
    NoHid,
    /// The device's HID interface has no interrupt endpoints for reports of [`REPORT_LEN`] bytes.
    #[error("its HID interface has no interrupt endpoints of {REPORT_LEN} bytes both ways")]
    OtherReports,
}

/// Whether one packet of an endpoint with this bmAttributes and wMaxPacketSize holds a whole report.
pub const fn carries_reports(attributes: u8, packet: u16) -> bool {
    attributes & TRANSFER_TYPE == INTERRUPT && (packet & PACKET) as usize == REPORT_LEN
}
