//! How the board's HID interface is recognised by its USB descriptors, whether libusb has read them or the kernel's files in
//! sysfs have.

/// Bytes of a report, in either direction.
pub const REPORT_LEN: usize = 512;
/// bInterfaceClass of a HID interface.
pub const HID: u8 = 3;
/// The bit in bEndpointAddress that says that the endpoint sends to the host.
pub const TO_HOST: u8 = 0x80;

/// The bits of bmAttributes that hold an endpoint's transfer type.
const TRANSFER_TYPE: u8 = 0x03;
/// The transfer type "interrupt".
const INTERRUPT: u8 = 0x03;
/// The bits of wMaxPacketSize that hold the bytes of a packet. The bits above count packets per microframe.
const PACKET: u16 = 0x07FF;

/// The interface and the two interrupt endpoints by which a device sends and receives reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportInterface {
    /// bInterfaceNumber.
    pub number: u8,
    /// bEndpointAddress of the endpoint to the host.
    pub input: u8,
    /// bEndpointAddress of the endpoint to the device.
    pub output: u8,
}

/// Why a device with the board's vendor and product id cannot be a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotTheBoard {
    /// The system has chosen none of its configurations.
    #[error(
        "this machine has not switched it on: its port or hub gives it too little power, or it is still being looked \
         at; plug it into this machine, or into a hub with a power supply of its own"
    )]
    Unconfigured,
    /// The descriptors cannot be read or contradict each other.
    #[error("its descriptors cannot be read")]
    Descriptors,
    /// No interface of it is a HID interface.
    #[error("it has no HID interface")]
    NoHid,
    /// Its HID interface has no interrupt endpoints for reports of [`REPORT_LEN`] bytes.
    #[error("its HID interface has no interrupt endpoints of {REPORT_LEN} bytes both ways")]
    OtherReports,
}

/// Whether an endpoint with this bmAttributes and wMaxPacketSize carries whole reports.
pub const fn carries_reports(attributes: u8, packet: u16) -> bool {
    attributes & TRANSFER_TYPE == INTERRUPT && (packet & PACKET) as usize == REPORT_LEN
}
