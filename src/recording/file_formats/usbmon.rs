//! The header that Linux' usbmon puts before the bytes of a USB transfer. Recordings of this crate have it too.
//!
//! With LINKTYPE_USB_LINUX_MMAPPED (220) the header has 64 bytes, with LINKTYPE_USB_LINUX (189) only the first 48.
//! Numbers have the byte order of the file. Source: Documentation/usb/usbmon.rst of Linux, `struct usbmon_packet`.

use bytemuck::{Pod, Zeroable};
use pcap_file::{DataLink, Endianness};

use super::number;
use super::transfer::{Stage, TransferKind, UsbEvent};
use crate::recording::address::Address;
use crate::sk::{Dir, FRAME_LEN};

/// The length of the header in recordings of this crate, bytes.
pub(crate) const HEADER_LEN: usize = size_of::<RawHeader>();
/// The length of the header without the fields for isochronous transfers, bytes.
const SHORT_HEADER_LEN: usize = 48;

/// The addresses of the board's interrupt endpoints (SK-9): OUT for command frames, IN for reports.
const OUT: u8 = 0x02;
const IN: u8 = 0x81;
/// The bit of an endpoint's address that means "to the host".
const TO_HOST: u8 = 0x80;

/// The types of events: a transfer was handed to the host controller, has ended, or was refused.
const SUBMIT: u8 = b'S';
const COMPLETE: u8 = b'C';
const REFUSED: u8 = b'E';
/// Codes of transfer types. Other codes are bulk and isochronous transfers.
const INTERRUPT: u8 = 1;
const CONTROL: u8 = 2;
/// Values of `flag_setup`: the header has a setup packet, or it has none.
const SETUP_PRESENT: u8 = 0;
const NO_SETUP: u8 = b'-';
/// Value of `flag_data`: data follow the header.
const DATA_PRESENT: u8 = 0;
/// The status of a transfer in flight: -EINPROGRESS.
const IN_PROGRESS: i32 = -115;

/// Bus and device number of the board in a recording of this crate, which has no USB addresses to record. \[OURS]
const BUS: u16 = 1;
const DEVICE: u8 = 1;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawHeader {
    id: [u8; 8],
    event: u8,
    transfer: u8,
    endpoint: u8,
    device: u8,
    bus: [u8; 2],
    flag_setup: u8,
    flag_data: u8,
    seconds: [u8; 8],
    microseconds: [u8; 4],
    status: [u8; 4],
    length: [u8; 4],
    captured: [u8; 4],
    setup: [u8; 8],
    interval: [u8; 4],
    start_frame: [u8; 4],
    transfer_flags: [u8; 4],
    descriptors: [u8; 4],
}

const _: () = assert!(HEADER_LEN == 64 && align_of::<RawHeader>() == 1);
const _: () = assert!(std::mem::offset_of!(RawHeader, interval) == SHORT_HEADER_LEN);

/// The header before a frame, little endian: the submission of an OUT transfer, or the completion of an IN transfer,
/// each with all 512 bytes.
pub(crate) fn header(dir: Dir, id: u64, at_ns: u64) -> [u8; HEADER_LEN] {
    let (event, endpoint, status) = match dir {
        Dir::Write => (SUBMIT, OUT, IN_PROGRESS),
        Dir::Read => (COMPLETE, IN, 0),
    };
    let length = (FRAME_LEN as u32).to_le_bytes();
    bytemuck::cast(RawHeader {
        id: id.to_le_bytes(),
        event,
        transfer: INTERRUPT,
        endpoint,
        device: DEVICE,
        bus: BUS.to_le_bytes(),
        flag_setup: NO_SETUP,
        flag_data: DATA_PRESENT,
        seconds: (at_ns / 1_000_000_000).to_le_bytes(),
        microseconds: ((at_ns % 1_000_000_000 / 1000) as u32).to_le_bytes(),
        status: status.to_le_bytes(),
        length,
        captured: length,
        setup: [0; 8],
        interval: 1_u32.to_le_bytes(),
        start_frame: [0; 4],
        transfer_flags: [0; 4],
        descriptors: [0; 4],
    })
}

/// Whether packets of this link type begin with this header.
pub(super) const fn is_usbmon(link_type: DataLink) -> bool {
    header_len(link_type).is_some()
}

/// Decodes a packet; `None` if this link type is not one of usbmon, the packet is too short for its header, or its type
/// of event is unknown.
pub(super) fn event(link_type: DataLink, order: Endianness, packet: &[u8]) -> Option<UsbEvent<'_>> {
    let (start, data) = packet.split_at_checked(header_len(link_type)?)?;
    let mut bytes = [0; HEADER_LEN];
    bytes[..start.len()].copy_from_slice(start);
    let header: RawHeader = bytemuck::cast(bytes);
    let (stage, length) = match header.event {
        SUBMIT => (Stage::Submitted, number(order, header.length)),
        COMPLETE => (Stage::Ended { done: header.status == [0; 4] }, number(order, header.length)),
        // The host controller refused the transfer, so no bytes were transferred.
        REFUSED => (Stage::Ended { done: false }, 0),
        _ => return None,
    };
    let kind = match header.transfer {
        INTERRUPT => TransferKind::Interrupt,
        CONTROL => TransferKind::Control,
        _ => TransferKind::Other,
    };
    let captured = match header.flag_data {
        DATA_PRESENT => usize::try_from(number(order, header.captured)).ok()?.min(data.len()),
        _ => 0,
    };
    let (bus, id) = match order {
        Endianness::Little => (u16::from_le_bytes(header.bus), u64::from_le_bytes(header.id)),
        Endianness::Big => (u16::from_be_bytes(header.bus), u64::from_be_bytes(header.id)),
    };
    Some(UsbEvent {
        at: Address { bus, device: header.device },
        kind,
        stage,
        to_host: header.endpoint & TO_HOST != 0,
        id,
        setup: (header.flag_setup == SETUP_PRESENT).then_some(header.setup),
        length,
        data: &data[..captured],
    })
}

const fn header_len(link_type: DataLink) -> Option<usize> {
    match link_type {
        DataLink::USB_LINUX => Some(SHORT_HEADER_LEN),
        DataLink::USB_LINUX_MMAPPED => Some(HEADER_LEN),
        _ => None,
    }
}
