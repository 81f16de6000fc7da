//! The messages of USB/IP, protocol version 1.1.1. Only this file defines their bytes. Numbers are big endian.
//!
//! Source: Documentation/usb/usbip_protocol.rst of Linux.

use bytemuck::{Pod, Zeroable};

pub use crate::port::usb_board::transfer::{Direction, Status};

/// The version of the protocol in every request before the transfers: 1.1.1.
pub const VERSION: u16 = 0x0111;
/// The TCP port that is registered for USB/IP.
pub const PORT: u16 = 3240;

/// The length in bytes of the part with which every request begins: version, code and status.
pub const OP_LEN: usize = size_of::<RawOp>();
/// The length of a bus id in bytes; shorter ones are padded with zeros.
pub const BUS_ID_LEN: usize = 32;
/// The length in bytes of the header of every command (submit, unlink) and of its answer. The data of a transfer follow
/// it.
pub const HEADER_LEN: usize = size_of::<RawHeader>();

/// The largest transfer that is accepted, in bytes: the largest data stage of a control transfer. \[OURS]
pub const TRANSFER_LIMIT: u32 = 64 * 1024;

const OP_REQ_DEVLIST: u16 = 0x8005;
const OP_REP_DEVLIST: u16 = 0x0005;
const OP_REQ_IMPORT: u16 = 0x8003;
const OP_REP_IMPORT: u16 = 0x0003;

const CMD_SUBMIT: u32 = 1;
const CMD_UNLINK: u32 = 2;
const RET_SUBMIT: u32 = 3;
const RET_UNLINK: u32 = 4;

/// The values of number_of_packets that mark a transfer as not isochronous: Linux sends 0, its USB/IP document names
/// 0xFFFF_FFFF. Both are accepted.
const NO_PACKETS: [u32; 2] = [0, u32::MAX];

/// The code of high speed, 480 Mbit/s (`USB_SPEED_HIGH` of Linux).
pub const HIGH_SPEED: u32 = 3;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawOp {
    version: [u8; 2],
    code: [u8; 2],
    status: [u8; 4],
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawDevice {
    path: [u8; 256],
    bus_id: [u8; BUS_ID_LEN],
    bus: [u8; 4],
    number: [u8; 4],
    speed: [u8; 4],
    vendor: [u8; 2],
    product: [u8; 2],
    release: [u8; 2],
    class: [u8; 3],
    configuration: u8,
    configurations: u8,
    interfaces: u8,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawHeader {
    command: [u8; 4],
    sequence: [u8; 4],
    device: [u8; 4],
    direction: [u8; 4],
    endpoint: [u8; 4],
    /// The word after the common part of the header. Its meaning depends on the command. Submit: the flags. Unlink: the
    /// sequence number of the transfer to unlink. Answers to both: the status.
    first: [u8; 4],
    length: [u8; 4],
    start_frame: [u8; 4],
    packets: [u8; 4],
    /// In a submit the polling interval, in its answer the number of errors.
    interval: [u8; 4],
    setup: [u8; 8],
}

const _: () = assert!(OP_LEN == 8 && size_of::<RawDevice>() == 312 && HEADER_LEN == 48);
const _: () = assert!(align_of::<RawHeader>() == 1 && align_of::<RawDevice>() == 1);

/// The kind of a request that comes before a device is attached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// A request for the list of devices.
    DeviceList,
    /// A request to attach a device; its bus id of [`BUS_ID_LEN`] bytes follows.
    Import,
}

/// Why received bytes are not valid USB/IP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum WireError {
    /// A request has another version of the protocol.
    #[error("the client speaks version {found:#06x} of USB/IP, not {VERSION:#06x} (1.1.1); use a newer client")]
    Version { found: u16 },
    /// No request has this code.
    #[error("no request of USB/IP has the code {found:#06x}; is the client one for USB/IP?")]
    Code { found: u16 },
    /// A bus id is not UTF-8.
    #[error("the bus id is no text; is the client one for USB/IP?")]
    BusId,
    /// No command has this number.
    #[error("no command of USB/IP has the number {found}; is the client one for USB/IP?")]
    Command { found: u32 },
    /// The direction is neither OUT (0) nor IN (1).
    #[error("a transfer has direction {found}, not 0 (out) or 1 (in); is the client one for USB/IP?")]
    Direction { found: u32 },
    /// USB has no endpoint with this number.
    #[error("a transfer has endpoint {found}, not 0 to 15; is the client one for USB/IP?")]
    Endpoint { found: u32 },
    /// A transfer is longer than [`TRANSFER_LIMIT`].
    #[error("a transfer has {found} bytes, more than {TRANSFER_LIMIT}; the board moves 512 at a time")]
    Length { found: u32 },
    /// A transfer is isochronous, but the board has no isochronous endpoint.
    #[error("a transfer has {packets} isochronous packets; the board has no isochronous endpoint")]
    Isochronous { packets: u32 },
}

impl Op {
    /// Decodes the start of a request.
    ///
    /// # Errors
    /// [`WireError::Version`]: another version of the protocol; [`WireError::Code`]: no request has this code.
    pub fn parse(bytes: &[u8; OP_LEN]) -> Result<Self, WireError> {
        let raw: RawOp = bytemuck::cast(*bytes);
        let version = u16::from_be_bytes(raw.version);
        if version != VERSION {
            return Err(WireError::Version { found: version });
        }
        match u16::from_be_bytes(raw.code) {
            OP_REQ_DEVLIST => Ok(Self::DeviceList),
            OP_REQ_IMPORT => Ok(Self::Import),
            found => Err(WireError::Code { found }),
        }
    }
}

/// The bus id in an import request: the text before the first zero.
///
/// # Errors
/// [`WireError::BusId`]: the text is not UTF-8.
pub fn bus_id(bytes: &[u8; BUS_ID_LEN]) -> Result<&str, WireError> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(BUS_ID_LEN);
    std::str::from_utf8(&bytes[..end]).map_err(|_| WireError::BusId)
}

/// A transfer that a host submits (USBIP_CMD_SUBMIT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submit {
    /// The host's sequence number of the transfer.
    pub sequence: u32,
    /// The number of the device that the transfer is for: the bus in the upper 16 bits, the device on it in the lower
    /// 16 bits.
    pub device: u32,
    /// Whether data go to the device (OUT) or to the host (IN).
    pub direction: Direction,
    /// The number of the endpoint, 0..=15, without the direction bit.
    pub endpoint: u8,
    /// The largest number of bytes to transfer: 0..=[`TRANSFER_LIMIT`]. In an OUT transfer exactly that many follow.
    pub length: u32,
    /// The setup packet of a control transfer.
    pub setup: [u8; 8],
}

/// A command of a host that has attached a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Submits a transfer (USBIP_CMD_SUBMIT).
    Submit(Submit),
    /// Unlinks a pending transfer (USBIP_CMD_UNLINK).
    Unlink {
        /// The sequence number of the unlink command itself.
        sequence: u32,
        /// The number of the device, as in [`Submit::device`].
        device: u32,
        /// The sequence number of the transfer to unlink.
        victim: u32,
    },
}

impl Command {
    /// Decodes the header of a command.
    ///
    /// # Errors
    /// [`WireError`]: the header is invalid. The length of the data after it is then unknown, so the connection cannot
    /// go on.
    pub fn parse(bytes: &[u8; HEADER_LEN]) -> Result<Self, WireError> {
        let raw: RawHeader = bytemuck::cast(*bytes);
        let (sequence, device) = (u32::from_be_bytes(raw.sequence), u32::from_be_bytes(raw.device));
        match u32::from_be_bytes(raw.command) {
            CMD_SUBMIT => Submit::parse(&raw, sequence, device).map(Self::Submit),
            CMD_UNLINK => Ok(Self::Unlink { sequence, device, victim: u32::from_be_bytes(raw.first) }),
            found => Err(WireError::Command { found }),
        }
    }
}

impl Submit {
    fn parse(raw: &RawHeader, sequence: u32, device: u32) -> Result<Self, WireError> {
        let direction = match u32::from_be_bytes(raw.direction) {
            0 => Direction::Out,
            1 => Direction::In,
            found => return Err(WireError::Direction { found }),
        };
        let found = u32::from_be_bytes(raw.endpoint);
        let endpoint = u8::try_from(found).ok().filter(|number| *number < 16).ok_or(WireError::Endpoint { found })?;
        let length = u32::from_be_bytes(raw.length);
        if length > TRANSFER_LIMIT {
            return Err(WireError::Length { found: length });
        }
        let packets = u32::from_be_bytes(raw.packets);
        if !NO_PACKETS.contains(&packets) {
            return Err(WireError::Isochronous { packets });
        }
        Ok(Self { sequence, device, direction, endpoint, length, setup: raw.setup })
    }
}

/// Appends the answer to a submit. `moved` is the number of bytes transferred; `data` has the bytes of an IN transfer.
pub fn ret_submit(to: &mut Vec<u8>, sequence: u32, status: Status, moved: u32, data: &[u8]) {
    to.extend_from_slice(bytemuck::bytes_of(&reply(RET_SUBMIT, sequence, status, moved)));
    to.extend_from_slice(data);
}

/// Appends the answer to an unlink: [`Status::Unlinked`] if the transfer was unlinked and gets no answer of its own, or
/// [`Status::Done`] if it had been answered before.
pub fn ret_unlink(to: &mut Vec<u8>, sequence: u32, status: Status) {
    to.extend_from_slice(bytemuck::bytes_of(&reply(RET_UNLINK, sequence, status, 0)));
}

fn reply(command: u32, sequence: u32, status: Status, moved: u32) -> RawHeader {
    RawHeader {
        command: command.to_be_bytes(),
        sequence: sequence.to_be_bytes(),
        first: (status as i32).to_be_bytes(),
        length: moved.to_be_bytes(),
        ..RawHeader::zeroed()
    }
}

/// The entry of a device in the device list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceEntry<'a> {
    /// The device's path, as `usbip list` prints it.
    pub path: &'a str,
    /// The bus id, with which a host requests the device: for example `1-1`.
    pub bus_id: &'a str,
    /// The number of the bus.
    pub bus: u16,
    /// The number of the device on the bus.
    pub number: u16,
    /// idVendor.
    pub vendor: u16,
    /// idProduct.
    pub product: u16,
    /// bcdDevice.
    pub release: u16,
    /// bConfigurationValue.
    pub configuration: u8,
    /// Class, subclass and protocol of its only interface.
    pub interface: [u8; 3],
}

/// The device number in commands: the bus in the upper 16 bits, the device on it in the lower 16 bits.
pub const fn device_id(bus: u16, number: u16) -> u32 {
    (bus as u32) << 16 | number as u32
}

/// The reason why a host may not attach a device. The values are the status codes of USB/IP in Linux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Refusal {
    /// Another host has attached the device (`ST_DEV_BUSY`).
    Busy = 2,
    /// The board is not connected (`ST_DEV_ERR`).
    Away = 3,
    /// No device has this bus id (`ST_NODEV`).
    NoDevice = 4,
}

/// Appends the answer to [`Op::DeviceList`] to the bytes in `to`.
pub fn device_list(to: &mut Vec<u8>, devices: &[DeviceEntry<'_>]) {
    op(to, OP_REP_DEVLIST, 0);
    to.extend_from_slice(&(devices.len() as u32).to_be_bytes());
    for device in devices {
        to.extend_from_slice(bytemuck::bytes_of(&raw_device(device)));
        to.extend_from_slice(&device.interface);
        to.push(0);
    }
}

/// Appends the answer to [`Op::Import`] to the bytes in `to`.
pub fn import(to: &mut Vec<u8>, device: Result<&DeviceEntry<'_>, Refusal>) {
    match device {
        Ok(device) => {
            op(to, OP_REP_IMPORT, 0);
            to.extend_from_slice(bytemuck::bytes_of(&raw_device(device)));
        }
        Err(refusal) => op(to, OP_REP_IMPORT, refusal as u32),
    }
}

fn op(to: &mut Vec<u8>, code: u16, status: u32) {
    let op = RawOp { version: VERSION.to_be_bytes(), code: code.to_be_bytes(), status: status.to_be_bytes() };
    to.extend_from_slice(bytemuck::bytes_of(&op));
}

fn raw_device(device: &DeviceEntry<'_>) -> RawDevice {
    RawDevice {
        path: padded(device.path),
        bus_id: padded(device.bus_id),
        bus: u32::from(device.bus).to_be_bytes(),
        number: u32::from(device.number).to_be_bytes(),
        speed: HIGH_SPEED.to_be_bytes(),
        vendor: device.vendor.to_be_bytes(),
        product: device.product.to_be_bytes(),
        release: device.release.to_be_bytes(),
        // bDeviceClass, bDeviceSubClass and bDeviceProtocol 0: the interface has the class, which the list of devices
        // gives after this record.
        class: [0; 3],
        configuration: device.configuration,
        configurations: 1,
        interfaces: 1,
    }
}

/// Puts a text into a field of `N` bytes, padded with zeros. A longer text is cut, so that at least one zero follows.
fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut field = [0; N];
    let len = text.len().min(N - 1);
    field[..len].copy_from_slice(&text.as_bytes()[..len]);
    field
}
