//! What a HID device with one pipe looks like in its descriptors, whoever has read them: libusb, or the kernel's own files.

/// Bytes of a report, both ways.
pub const REPORT_LEN: usize = 512;
/// Class code of HID interfaces.
pub const HID: u8 = 3;
/// Bit of an endpoint's address: it sends to the host.
pub const TO_HOST: u8 = 0x80;

/// bmAttributes of an endpoint: how it moves data ..
const TRANSFER_TYPE: u8 = 0x03;
/// .. here by interrupts.
const INTERRUPT: u8 = 0x03;
/// wMaxPacketSize: bytes of a packet; bits above say how many of them in a microframe.
const PACKET: u16 = 0x07FF;

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

/// Why a device with the right ids is another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotOne {
    /// No configuration of it is chosen.
    #[error(
        "this machine has not switched it on: its port or hub gives it too little power, or it is still being looked \
         at; plug it into this machine, or into a hub with a power supply of its own"
    )]
    Unconfigured,
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

/// Whether an endpoint with this bmAttributes and wMaxPacketSize moves whole reports.
pub const fn moves_reports(attributes: u8, packet: u16) -> bool {
    attributes & TRANSFER_TYPE == INTERRUPT && (packet & PACKET) as usize == REPORT_LEN
}
