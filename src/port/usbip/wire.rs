//! The messages of USB/IP, protocol version 1.1.1: the one file with their bytes. Numbers are big endian.
//!
//! Source: Documentation/usb/usbip_protocol.rst of Linux.

use bytemuck::{Pod, Zeroable};

/// The protocol's version in every request before the traffic: 1.1.1.
pub const VERSION: u16 = 0x0111;
/// The TCP port that is registered for it.
pub const PORT: u16 = 3240;

/// Bytes of the start of a request.
pub const OP_LEN: usize = size_of::<RawOp>();
/// Bytes of a bus id, filled up with zeros.
pub const BUS_ID_LEN: usize = 32;
/// Bytes of a command's header; data of an OUT transfer follow.
pub const HEADER_LEN: usize = size_of::<RawHeader>();

/// The largest transfer that is taken, bytes: what one control transfer can ask for. \[OURS]
pub const TRANSFER_LIMIT: u32 = 64 * 1024;

const OP_REQ_DEVLIST: u16 = 0x8005;
const OP_REP_DEVLIST: u16 = 0x0005;
const OP_REQ_IMPORT: u16 = 0x8003;
const OP_REP_IMPORT: u16 = 0x0003;

const CMD_SUBMIT: u32 = 1;
const CMD_UNLINK: u32 = 2;
const RET_SUBMIT: u32 = 3;
const RET_UNLINK: u32 = 4;

/// What a transfer that is not isochronous has instead of a number of packets: the document says all ones, Linux
/// sends 0.
const NO_PACKETS: [u32; 2] = [0, u32::MAX];

/// `USB_SPEED_HIGH` of Linux.
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
    /// Of a submission: flags. Of its answer: the status. Of an unlink: whose sequence; of its answer: the status.
    first: [u8; 4],
    length: [u8; 4],
    start_frame: [u8; 4],
    packets: [u8; 4],
    /// Of a submission: the interval. Of its answer: errors.
    interval: [u8; 4],
    setup: [u8; 8],
}

const _: () = assert!(OP_LEN == 8 && size_of::<RawDevice>() == 312 && HEADER_LEN == 48);
const _: () = assert!(align_of::<RawHeader>() == 1 && align_of::<RawDevice>() == 1);

/// What a client wants before there is traffic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// Which devices there are.
    DeviceList,
    /// A device for itself; its bus id, [`BUS_ID_LEN`] bytes, follows.
    Import,
}

/// Why bytes are no message of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum WireError {
    /// A request of another version.
    #[error("the client speaks version {found:#06x} of USB/IP, not {VERSION:#06x} (1.1.1); use a newer client")]
    Version { found: u16 },
    /// A request that there is not.
    #[error("no request of USB/IP has the code {found:#06x}; is the client one for USB/IP?")]
    Code { found: u16 },
    /// A bus id that is no text.
    #[error("the bus id is no text; is the client one for USB/IP?")]
    BusId,
    /// A command that there is not.
    #[error("no command of USB/IP has the number {found}; is the client one for USB/IP?")]
    Command { found: u32 },
    /// A direction that there is not.
    #[error("a transfer has direction {found}, not 0 (out) or 1 (in); is the client one for USB/IP?")]
    Direction { found: u32 },
    /// An endpoint that there cannot be.
    #[error("a transfer has endpoint {found}, not 0 to 15; is the client one for USB/IP?")]
    Endpoint { found: u32 },
    /// A transfer larger than any of this device.
    #[error("a transfer has {found} bytes, more than {TRANSFER_LIMIT}; the board moves 512 at a time")]
    Length { found: u32 },
    /// An isochronous transfer, for which the board has no endpoint.
    #[error("a transfer has {packets} isochronous packets; the board has no isochronous endpoint")]
    Isochronous { packets: u32 },
}

impl Op {
    /// Reads the start of a request.
    ///
    /// # Errors
    /// [`WireError::Version`], [`WireError::Code`].
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

/// The bus id of an import: the text before the first zero.
///
/// # Errors
/// [`WireError::BusId`].
pub fn bus_id(bytes: &[u8; BUS_ID_LEN]) -> Result<&str, WireError> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(BUS_ID_LEN);
    std::str::from_utf8(&bytes[..end]).map_err(|_| WireError::BusId)
}

/// Which way a transfer goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the device.
    Out,
    /// To the host.
    In,
}

/// A transfer that a host hands over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submit {
    /// The host's number for it.
    pub sequence: u32,
    /// For which device, see [`device_id`].
    pub device: u32,
    /// Which way.
    pub direction: Direction,
    /// Number of the endpoint, 0..=15, without the bit of the direction.
    pub endpoint: u8,
    /// Bytes to move at most: 0..=[`TRANSFER_LIMIT`]. If it goes out, so many follow.
    pub length: u32,
    /// The setup packet of a control transfer.
    pub setup: [u8; 8],
}

/// What a host sends once it has a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// A transfer.
    Submit(Submit),
    /// The host wants a transfer back.
    Unlink {
        /// The host's number for this wish.
        sequence: u32,
        /// For which device.
        device: u32,
        /// The number of the transfer.
        victim: u32,
    },
}

impl Command {
    /// Reads a command's header.
    ///
    /// # Errors
    /// [`WireError`]; what follows cannot be told apart then.
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

/// How a transfer ended: 0 or a negative error number of Linux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// As it should.
    Done = 0,
    /// The endpoint refuses it (EPIPE).
    Stall = -32,
    /// The packet was larger than the room for it (EOVERFLOW).
    Overflow = -75,
    /// It was taken back by the host (ECONNRESET).
    Unlinked = -104,
}

/// Appends the answer to a transfer. `moved` is the number of bytes; of a transfer to the host they are `data`.
pub fn ret_submit(to: &mut Vec<u8>, sequence: u32, status: Status, moved: u32, data: &[u8]) {
    to.extend_from_slice(bytemuck::bytes_of(&reply(RET_SUBMIT, sequence, status, moved)));
    to.extend_from_slice(data);
}

/// Appends the answer to an unlink: [`Status::Unlinked`] if the transfer was taken back and gets no answer of its own,
/// [`Status::Done`] if that had gone out before.
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

/// What is said of a device in a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown<'a> {
    /// Its place, as `usbip list` prints it.
    pub path: &'a str,
    /// Its name for an import, such as `1-1`.
    pub bus_id: &'a str,
    /// Number of the bus.
    pub bus: u16,
    /// Number on the bus.
    pub number: u16,
    /// idVendor.
    pub vendor: u16,
    /// idProduct.
    pub product: u16,
    /// bcdDevice.
    pub release: u16,
    /// bConfigurationValue.
    pub configuration: u8,
    /// Class, subclass and protocol of its one interface.
    pub interface: [u8; 3],
}

/// What commands call a device: bus and number on it.
pub const fn device_id(bus: u16, number: u16) -> u32 {
    (bus as u32) << 16 | number as u32
}

/// Why an import is refused, as Linux numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Refusal {
    /// Somebody else has it (`ST_DEV_BUSY`).
    Busy = 2,
    /// The board is away (`ST_DEV_ERR`).
    Away = 3,
    /// There is no device of that bus id (`ST_NODEV`).
    NoDevice = 4,
}

/// Appends the answer to [`Op::DeviceList`].
pub fn device_list(to: &mut Vec<u8>, devices: &[Shown<'_>]) {
    op(to, OP_REP_DEVLIST, 0);
    to.extend_from_slice(&(devices.len() as u32).to_be_bytes());
    for device in devices {
        to.extend_from_slice(bytemuck::bytes_of(&raw_device(device)));
        to.extend_from_slice(&device.interface);
        to.push(0);
    }
}

/// Appends the answer to [`Op::Import`].
pub fn import(to: &mut Vec<u8>, device: Result<&Shown<'_>, Refusal>) {
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

fn raw_device(device: &Shown<'_>) -> RawDevice {
    RawDevice {
        path: padded(device.path),
        bus_id: padded(device.bus_id),
        bus: u32::from(device.bus).to_be_bytes(),
        number: u32::from(device.number).to_be_bytes(),
        speed: HIGH_SPEED.to_be_bytes(),
        vendor: device.vendor.to_be_bytes(),
        product: device.product.to_be_bytes(),
        release: device.release.to_be_bytes(),
        // The class is the interface's.
        class: [0; 3],
        configuration: device.configuration,
        configurations: 1,
        interfaces: 1,
    }
}

/// Text in a field of `N` bytes, cut so that a zero ends it.
fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut field = [0; N];
    let len = text.len().min(N - 1);
    field[..len].copy_from_slice(&text.as_bytes()[..len]);
    field
}
